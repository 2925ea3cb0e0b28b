"""Base of wires without handshake, pings and close."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Final

from rwt_protocol.frames import Buffer, Frame, Framing
from rwt_transports.api import WireEvents, drop_message
from rwt_transports.limits import Limits
from rwt_transports.websocket.close_codes import POLICY, TOO_BIG
from rwt_transports.wires.receive_buffer import STAGING_BYTES, ReceiveBufferPool

PART_BYTES = 64 * 1024
"""Maximum size of one read of a large message."""

_STEPS_PER_TURN: Final = 512
"""Maximum number of steps in one turn of the event loop, each of less than a microsecond or a message."""


def framing_of(pieces: Callable[[Frame], tuple[Buffer, ...]]) -> Framing:
    """Return a framing that joins the pieces of a frame where it needs the whole."""
    return Framing(lambda frame: b"".join(pieces(frame)), pieces)


class StreamWire(ABC):
    """Buffer of received bytes, from which a subclass takes messages."""

    __slots__ = ("_buffer", "_buffers", "_events", "_max_size", "_over", "_part", "message")

    framing: ClassVar[Framing]

    def __init__(self, events: WireEvents, limits: Limits, buffers: ReceiveBufferPool) -> None:
        self._buffers = buffers
        self._part: bytearray | None = None  # where the next bytes of a large message are received
        self._events = events
        self._max_size = limits.message_bytes
        self.message: Callable[[bytes, bool], None] = drop_message
        self._buffer = bytearray()
        self._over = False

    def limit(self, size: int) -> None:
        self._max_size = size

    def close(self, code: int, reason: str) -> bytes:
        """End the connection. Returns nothing to send: the protocol has no close."""
        self._over = True
        self.message = drop_message
        return b""

    def give_up(self, reason: str) -> None:
        self._buffer.clear()
        self._end(POLICY, reason)

    def _end(self, code: int, reason: str) -> None:
        self._over = True
        self._events.ended(code, reason, agreed=False)

    def _may_skip(self, size: int) -> bool:
        """Report a message over the limit. Returns False if it cannot be skipped: the connection ends."""
        if self._events.oversized(size):
            return True
        self._end(TOO_BIG, f"a message of {size} bytes; the limit is {self._max_size} (max_message_size)")
        return False

    def _count_held(self) -> None:
        size = len(self._buffer)
        if size >= STAGING_BYTES:
            # From this size on, the driver receives into a buffer of this wire, in turns of the scheduler.
            self._part = self._part or bytearray(PART_BYTES)
            self._buffers.hold(self, size, self._events.holder)
        elif self._part is not None:
            # Freed between large messages: a connection that is idle holds no buffer.
            self._part = None
            self._buffers.release(self)

    def ping(self) -> bytes:
        """Return nothing to send: the protocol has no ping."""
        return b""

    def get_buffer(self) -> memoryview | None:
        return None if self._part is None else memoryview(self._part)

    def buffer_updated(self, count: int) -> None:
        if self._part is not None:
            # A copy: the driver writes the next bytes to the same place.
            self.feed(bytes(memoryview(self._part)[:count]))

    def feed(self, data: bytes) -> None:
        self._buffer += data
        self._take_steps()
        if self._over:
            self._buffer.clear()
        self._count_held()

    def _take_steps(self) -> None:
        while not self._over and self._step():
            pass

    @abstractmethod
    def _step(self) -> bool:
        """Take one message or a part of it from the buffer; return False if more bytes are needed."""

    def _hand_on(self, message: bytes, binary: bool) -> None:
        if len(message) < STAGING_BYTES:
            self.message(message, binary)
        else:
            self._buffers.hand_on(self.message, message, binary)


class ByteStreamWire(StreamWire):
    """Wire of a stream that keeps no boundaries: one read may have thousands of messages, or of steps.

    Implements :class:`rwt_transports.api.HoldableWire`.
    """

    __slots__ = ("_is_held",)

    def __init__(self, events: WireEvents, limits: Limits, buffers: ReceiveBufferPool) -> None:
        super().__init__(events, limits, buffers)
        self._is_held = False

    def hold(self) -> None:
        """Deliver no more messages until :meth:`go_on`, even of the same read."""
        self._is_held = True

    def go_on(self) -> None:
        self._is_held = False
        self.feed(b"")

    def _take_steps(self) -> None:
        """Take the steps that one turn of the event loop admits."""
        for _ in range(_STEPS_PER_TURN):
            if self._over or self._is_held or not self._step():
                return
        self._is_held = True
        self._events.read_on_later()
