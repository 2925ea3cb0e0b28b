"""auth: the op by which a client proves its role."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final, Never

from rwt.access.errors import NotAuthenticated
from rwt_protocol.errors import Refused
from rwt_protocol.ops import Auth, Op
from rwt_transports.websocket.close_codes import POLICY

if TYPE_CHECKING:
    from rwt.gateways.rosbridge.peer import Peer


def on_auth(client: Peer, op: Auth) -> None:
    """Give a client that came in without credentials, or with others, the role that `op` proves (AUT-03).

    Where no secret is configured nobody needs to authenticate (AUT-04).
    """
    rosauth = client.rosauth
    if rosauth is None:
        raise Refused("auth: this server has no authentication; go on without", level="warning")
    try:
        client.authenticated(rosauth.authenticate(op))
    except NotAuthenticated as error:
        client.sink.close(POLICY, str(error))
        raise Refused(str(error)) from None


HANDLERS: Final[Mapping[type[Op], Callable[[Peer, Never], None]]] = {Auth: on_auth}
