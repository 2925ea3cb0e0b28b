"""auth: the op by which a client proves its role."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final, Never, Protocol

from rwt.access.errors import NotAuthenticated
from rwt_protocol.errors import Refused
from rwt_protocol.ops import Auth, Op
from rwt_transports.websocket.close_codes import POLICY

if TYPE_CHECKING:
    from rwt.access.credentials import Rosauth
    from rwt.access.roles import Role
    from rwt_transports.endpoint import Sink


class _Authenticates(Protocol):
    @property
    def rosauth(self) -> Rosauth | None: ...
    @property
    def sink(self) -> Sink: ...
    def take_role(self, role: Role) -> None: ...


def on_auth(client: _Authenticates, op: Auth) -> None:
    """Give a client that came in without credentials, or with others, the role that `op` proves (AUT-03).

    Where no secret is configured nobody needs to authenticate (AUT-04).
    """
    rosauth = client.rosauth
    if rosauth is None:
        raise Refused("auth: this server has no authentication; go on without", level="warning")
    try:
        client.take_role(rosauth.authenticate(op))
    except NotAuthenticated as error:
        client.sink.close(POLICY, str(error))
        raise Refused(str(error)) from None


HANDLERS: Final[Mapping[type[Op], Callable[[_Authenticates, Never], None]]] = {Auth: on_auth}
