"""Messages of a transport that keeps their boundaries itself: WebRTC data channels, WebSockets behind ASGI.

Between the wire and the driver, a header that never leaves the process precedes each message: its kind and
size. Thus the outbox can join and split messages as for other drivers.

A message that is larger than the limit is announced by its header, and what follows is no more than its first
:data:`~rwt_transports.api.HEAD_BYTES`: the driver has kept no more.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from struct import Struct
from typing import Final

from rwt_protocol.frames import Buffer, Frame
from rwt_transports.api import HEAD_BYTES, WireEvents
from rwt_transports.limits import Limits
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.stream import StreamWire, framing_of

HEADER: Final = Struct(">BI")
"""Header of a message: its kind, and its size in bytes."""

TEXT, BINARY, CLOSE = 0, 1, 2
"""Kinds of messages; only ASGI's drivers exchange :data:`CLOSE`, whose bytes are a code and a reason."""


def _pieces(frame: Frame) -> tuple[Buffer, ...]:
    return (HEADER.pack(BINARY if frame.binary else TEXT, frame.size), *frame.parts)


WHOLE_MESSAGES = framing_of(_pieces)
"""One frame after its header."""


class MessageWire(StreamWire):
    """Messages of one peer."""

    __slots__ = ("_kind", "_size", "_wanted")

    framing = WHOLE_MESSAGES

    def __init__(self, events: WireEvents, limits: Limits, buffers: ReceiveBufferPool) -> None:
        super().__init__(events, limits, buffers)
        self._wanted = -1  # bytes that follow the header; -1 before it
        self._size = 0
        self._kind = TEXT

    def limit(self, size: int) -> None:
        """No-op: the driver has received the whole message, or dropped what is beyond its own limit."""

    def feed(self, data: bytes) -> None:
        if not self._over and self._wanted == len(data) and not self._buffer:
            self._finish(data)  # The driver's own message, uncopied.
            return
        super().feed(data)

    def _step(self) -> bool:
        wanted = HEADER.size if self._wanted < 0 else self._wanted
        if len(self._buffer) < wanted:
            return False
        data = bytes(self._buffer[:wanted])
        del self._buffer[:wanted]
        if self._wanted >= 0:
            self._finish(data)
            return True
        self._kind, self._size = HEADER.unpack(data)
        self._wanted = self._size
        if self._size > self._max_size:
            # The driver has dropped the rest, see the module.
            self._wanted = min(self._size, HEAD_BYTES)
            self._may_skip(self._size)
        return True

    def _finish(self, data: bytes) -> None:
        self._wanted = -1
        if self._size > self._max_size:
            self._events.oversized_head(self._size, data)
        else:
            self._hand_on(data, self._kind == BINARY)


class MessageCutter:
    """Splits the connection's bytes into messages for its driver.

    Args:
        take: returns the next pieces of the connection; see :class:`~rwt_transports.api.DriverCallbacks`.
    """

    __slots__ = ("_buffer", "_kind", "_size", "_take", "_wanted")

    def __init__(self, take: Callable[[], tuple[Sequence[Buffer], bool]]) -> None:
        self._take = take
        self._buffer: deque[memoryview] = deque()
        self._size = 0
        self._wanted = -1
        self._kind = TEXT

    @property
    def held(self) -> int:
        """Number of bytes taken from the connection that do not form a message yet."""
        return self._size

    def next(self) -> tuple[bytes, int] | None:
        """Return the next message and its kind; None if there is no complete one."""
        if self._wanted < 0:
            header = self._read(HEADER.size)
            if header is None:
                return None
            self._kind, self._wanted = HEADER.unpack(header)
        message = self._read(self._wanted)
        if message is None:
            return None
        self._wanted = -1
        return message, self._kind

    def _read(self, count: int) -> bytes | None:
        while self._size < count:
            pieces, _ = self._take()
            if not pieces:
                return None
            self._buffer.extend(map(memoryview, pieces))
            self._size += sum(map(len, pieces))
        self._size -= count
        read = []
        while count:
            first = self._buffer.popleft()
            if len(first) > count:
                self._buffer.appendleft(first[count:])
                first = first[:count]
            read.append(first)
            count -= len(first)
        return b"".join(read)
