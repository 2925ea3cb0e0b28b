"""set_level, status, auth, fragment, png: ops about the connection itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_protocol.errors import Refused

if TYPE_CHECKING:
    from rwt_bridge.peer import Peer
    from rwt_protocol import ops


def on_auth(peer: Peer, op: ops.Auth) -> None:
    """Nobody needs to authenticate here (AUT-04)."""
    raise Refused("auth: this server has no authentication; go on without", level="warning")
