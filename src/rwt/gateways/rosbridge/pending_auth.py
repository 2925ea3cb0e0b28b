"""Connections that must authenticate before they reach the graph (AUT-01, AUT-08)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rwt.access.errors import NotAuthenticated
from rwt_protocol.ops import Auth
from rwt_transports.websocket.close_codes import POLICY

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.admission import Admission
    from rwt.access.roles import Role
    from rwt_graph.clock import Clock
    from rwt_participant.timers import Timer
    from rwt_protocol.session import Session
    from rwt_transports.endpoint import Endpoint, PeerInfo, Sink


#: Size limit of an `auth` op, in bytes. It bounds the memory of connections without credentials.
_MAX_AUTH_BYTES: Final = 16 * 1024

_NO_AUTH: Final = "this server wants `auth` as the first message"


class PendingAuth:
    """Endpoint of a connection until its first message, which must be a valid `auth` op.

    Life cycle::

        waiting ── valid `auth` ──────────────────> handed over to a peer
           │
           └── anything else, or `auth.seconds` ──> closed

    Anything else is: another op, an op that the session itself would handle, a fragment, an invalid message.

    Args:
        timeout: seconds until the connection is closed.
    """

    def __init__(
        self,
        join: Callable[[Role], Endpoint],
        sink: Sink,
        info: PeerInfo,
        session: Session,
        admission: Admission,
        clock: Clock,
        timeout: float,
    ) -> None:
        self._join = join
        self._sink = sink
        self._info = info
        self._session = session
        self._admission = admission
        self._monotonic = clock.monotonic
        self._timer: Timer | None = clock.call_later(
            timeout, self._too_late
        )  # None once the outcome is known.

    def receive(self, data: bytes, binary: bool) -> None:
        """Read the first message: one frame with the `auth` op and nothing else."""
        if self._timer is None:
            return
        rosauth = self._admission.rosauth
        if rosauth is not None and len(data) <= _MAX_AUTH_BYTES:
            items = self._session.decode(data, binary, self._monotonic())
            if len(items) == 1 and isinstance(items[0], Auth):
                try:
                    role = rosauth.authenticate(items[0])
                except NotAuthenticated as refused:
                    self._turn_away(str(refused))
                    return
                self._decide()
                self._sink.hand_over(self._join(role))
                return
        self._turn_away(_NO_AUTH)

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        """Called for a message over the size limit."""
        self._turn_away(_NO_AUTH)

    def closed(self, code: int, reason: str) -> None:
        """Called when the connection has ended."""
        self._decide()

    def _turn_away(self, reason: str) -> None:
        self._decide()
        self._admission.log_refusal(self._info, reason)
        self._sink.close(POLICY, reason)

    def _too_late(self) -> None:
        self._turn_away("no `auth` came in time (auth.seconds)")

    def _decide(self) -> None:
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
