"""Connections to a TURN server, which is the operator's, or one that a robot names for its clients.

Borrows :class:`aioice.turn.TurnClientUdpProtocol` and :class:`aioice.turn.TurnClientTcpProtocol`, which parse
what a server sends without validation and without limits. aioice looks the classes up in its module when it
connects, and takes no others, so the import of this module replaces them there. It uses no private names.
"""

from __future__ import annotations

import asyncio
import logging
from struct import Struct
from time import monotonic
from typing import Any, Final

from aioice import stun, turn

from rwt_transports.limits import RateLimit
from rwt_webrtc.packets.ice_guard import DATAGRAM_BYTES
from rwt_webrtc.packets.stun import TURN_METHODS, BadStun, check_stun

logger = logging.getLogger("rwt_webrtc.transport")

TURN_REQUESTS_PER_SECOND: Final = 20
"""Requests to a TURN server, after a burst of :data:`TURN_REQUESTS`; it determines when they are repeated."""
TURN_REQUESTS: Final = 100
TURN_MESSAGES: Final = 500
"""Messages of a TURN server over TCP in one turn of the event loop."""
TURN_BYTES: Final = DATAGRAM_BYTES + 64
"""Maximum size of a message of a TURN server: a datagram, and what describes it."""


_TURN_HEAD: Final = Struct("!HH")


class _GuardedTurn(turn.TurnClientMixin):
    """Validation and rate limit of a connection to a TURN server."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._requests = RateLimit(TURN_REQUESTS_PER_SECOND, TURN_REQUESTS)

    def datagram_received(self, data: bytes | str, addr: tuple[str, int]) -> None:
        """Hand over a message of the server, or drop it unless it is valid."""
        assert isinstance(data, bytes)
        try:
            if not data or data[0] >> 6 != 1:  # Not channel data.
                check_stun(data, TURN_METHODS, TURN_BYTES)
            super().datagram_received(data, addr)
        except BadStun as bad:
            logger.debug("discarded %s of a TURN server", bad)

    def send_stun(self, message: stun.Message, addr: tuple[str, int]) -> None:
        """Send a request. One over the rate limit is dropped, and counts as lost."""
        if self._requests.take(monotonic()):
            super().send_stun(message, addr)


class GuardedTurnUdp(_GuardedTurn, turn.TurnClientUdpProtocol):
    """Connection to a TURN server over UDP."""


class GuardedTurnTcp(_GuardedTurn, turn.TurnClientTcpProtocol):
    """Connection to a TURN server over TCP or TLS. aioice copies all that waits for each message."""

    _waiting = b""

    def data_received(self, data: bytes) -> None:
        """Split what has come into messages."""
        self._waiting += data
        at, end, address = 0, len(self._waiting), self.transport.get_extra_info("peername")
        for _ in range(TURN_MESSAGES):
            if at + _TURN_HEAD.size > end:
                break
            kind, size = _TURN_HEAD.unpack_from(self._waiting, at)
            size = (size + 3 & ~3) + (4 if kind >> 14 == 1 else 20)  # Channel data, or STUN.
            if size > TURN_BYTES:
                self.transport.abort()
                return
            if at + size > end:
                break
            self.datagram_received(self._waiting[at : at + size], address)
            at += size
        else:
            self.transport.pause_reading()
            asyncio.get_running_loop().call_soon(self._go_on)
        self._waiting = self._waiting[at:]

    def _go_on(self) -> None:
        if not self.transport.is_closing():
            self.transport.resume_reading()
            self.data_received(b"")


turn.TurnClientUdpProtocol = GuardedTurnUdp  # type: ignore[misc]  # mypy rejects assignments to names of classes
turn.TurnClientTcpProtocol = GuardedTurnTcp  # type: ignore[misc]  # mypy rejects assignments to names of classes
