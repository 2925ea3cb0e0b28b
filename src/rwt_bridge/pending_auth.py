"""A connection that must authenticate first: nothing of it reaches the bridge before (AUT-01, AUT-08)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rwt_access.credentials import NotAuthenticated
from rwt_protocol.ops import Auth
from rwt_transports.websocket.close_codes import POLICY

if TYPE_CHECKING:
    from rwt_access.credentials import Rosauth
    from rwt_bridge.bridge import Bridge
    from rwt_bridge.peer import Peer
    from rwt_graph.clock import Timer
    from rwt_protocol.session import Session
    from rwt_protocol.transport import PeerInfo, Sink


#: Bytes that an `auth` op may take; strangers are not worth more memory.
_LONGEST_AUTH: Final = 16 * 1024


class Doorstep:
    """Stands where a peer will stand, and becomes one with the first valid `auth`.

    Whatever else comes closes the connection: another op, an op that the session itself would do, a piece of
    a fragmented message, bytes that are no message, silence for `auth.seconds`.

    Attributes:
        peer: the client, None before it has authenticated.
    """

    def __init__(
        self, bridge: Bridge, sink: Sink, info: PeerInfo, session: Session, rosauth: Rosauth, patience: float
    ) -> None:
        self._bridge = bridge
        self._sink = sink
        self._info = info
        self._session = session
        self._rosauth = rosauth
        self.peer: Peer | None = None
        self._shut = False
        self._timer: Timer | None = bridge.graph.clock.call_later(patience, self._too_late)

    def receive(self, data: bytes, binary: bool) -> None:
        """Take one message from the wire."""
        if self.peer is not None:
            self.peer.receive(data, binary)
        elif not self._shut:
            self._first(data, binary)

    def oversized(self, size: int, limit: int) -> None:
        """A message was too large to be taken from the wire."""
        if self.peer is not None:
            self.peer.oversized(size, limit)
        else:
            self._turn_away("this server wants `auth` as the first message")

    def closed(self, code: int, reason: str) -> None:
        """The connection has ended."""
        self._stop_timer()
        if self.peer is not None:
            self.peer.closed(code, reason)
        else:
            self._shut = True
            self._bridge.admission.left(self._info)

    def _first(self, data: bytes, binary: bool) -> None:
        """The first message, which decides; one frame holds the `auth` and nothing else."""
        if len(data) > _LONGEST_AUTH:
            self._turn_away("this server wants `auth` as the first message")
            return
        items = self._session.decode(data, binary, self._bridge.graph.clock.monotonic())
        if len(items) != 1 or not isinstance(items[0], Auth):
            self._turn_away("this server wants `auth` as the first message")
            return
        try:
            role = self._rosauth.authenticate(items[0])
        except NotAuthenticated as refused:
            self._turn_away(str(refused))
            return
        self._stop_timer()
        self.peer = self._bridge.join(self._sink, self._info, self._session, role)

    def _turn_away(self, reason: str) -> None:
        self._shut = True
        self._stop_timer()
        self._bridge.admission.log_refusal(self._info, reason)
        self._sink.close(POLICY, reason)

    def _too_late(self) -> None:
        self._timer = None
        self._turn_away("no `auth` came in time (auth.seconds)")

    def _stop_timer(self) -> None:
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
