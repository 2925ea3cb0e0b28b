"""set_level, status, auth, fragment, png: ops about the connection itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_access.credentials import NotAuthenticated
from rwt_protocol.errors import Refused
from rwt_transports.websocket.close_codes import POLICY

if TYPE_CHECKING:
    from rwt_bridge.peer import Peer
    from rwt_protocol import ops


def on_auth(peer: Peer, op: ops.Auth) -> None:
    """Give a client that came in without credentials, or with others, the role that `op` proves (AUT-03).

    Where no secret is configured nobody needs to authenticate (AUT-04).
    """
    rosauth = peer.bridge.admission.rosauth
    if rosauth is None:
        raise Refused("auth: this server has no authentication; go on without", level="warning")
    try:
        peer.take_role(rosauth.authenticate(op))
    except NotAuthenticated as error:
        peer.sink.close(POLICY, str(error))
        raise Refused(str(error)) from None
