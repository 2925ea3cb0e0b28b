"""A connection that must authenticate first: nothing of it reaches the graph before (AUT-01, AUT-08)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rwt.access.errors import NotAuthenticated
from rwt_protocol.ops import Auth
from rwt_transports.websocket.close_codes import POLICY

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.admission import Admission
    from rwt.access.roles import Role
    from rwt.gateways.rosbridge.peer import Peer
    from rwt_graph.clock import Clock
    from rwt_participant.timers import Timer
    from rwt_protocol.session import Session
    from rwt_transports.endpoint import PeerInfo, Sink


#: Bytes that an `auth` op may take; strangers are not worth more memory.
_LONGEST_AUTH: Final = 16 * 1024


class PendingAuth:
    """The endpoint of a connection until its first valid `auth`, which hands over to a peer.

    Anything but `auth` closes the connection: another op, an op that the session itself would do, a piece of
    a fragmented message, bytes that are no message, silence for `auth.seconds`.
    """

    def __init__(
        self,
        join: Callable[[Role], Peer],
        sink: Sink,
        info: PeerInfo,
        session: Session,
        admission: Admission,
        clock: Clock,
        patience: float,
    ) -> None:
        self._join = join
        self._sink = sink
        self._info = info
        self._session = session
        self._admission = admission
        self._monotonic = clock.monotonic
        self._shut = False
        self._timer: Timer | None = clock.call_later(patience, self._too_late)

    def receive(self, data: bytes, binary: bool) -> None:
        """Take the first message, which decides; one frame holds the `auth` and nothing else."""
        if not self._shut:
            self._first(data, binary)

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        """A message was too large to be taken from the wire."""
        self._turn_away("this server wants `auth` as the first message")

    def closed(self, code: int, reason: str) -> None:
        """The connection has ended."""
        self._stop_timer()
        self._shut = True

    def _first(self, data: bytes, binary: bool) -> None:
        if len(data) > _LONGEST_AUTH:
            self._turn_away("this server wants `auth` as the first message")
            return
        items = self._session.decode(data, binary, self._monotonic())
        rosauth = self._admission.rosauth
        if rosauth is None or len(items) != 1 or not isinstance(items[0], Auth):
            self._turn_away("this server wants `auth` as the first message")
            return
        try:
            role = rosauth.authenticate(items[0])
        except NotAuthenticated as refused:
            self._turn_away(str(refused))
            return
        self._stop_timer()
        self._shut = True
        self._sink.hand_over(self._join(role))

    def _turn_away(self, reason: str) -> None:
        self._shut = True
        self._stop_timer()
        self._admission.log_refusal(self._info, reason)
        self._sink.close(POLICY, reason)

    def _too_late(self) -> None:
        self._timer = None
        self._turn_away("no `auth` came in time (auth.seconds)")

    def _stop_timer(self) -> None:
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
