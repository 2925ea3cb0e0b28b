"""Wire of a WebSocket behind an ASGI server: whole messages, marked as text or binary.

Between connection and driver, a process-internal header precedes each message, so that the outbox can join
and split messages as for other drivers.
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct
from typing import Final

from rwt_protocol.frames import Buffer, Frame
from rwt_transports.api import HEAD_BYTES, Framing, WireEvents
from rwt_transports.limits import Limits
from rwt_transports.websocket.close_codes import TOO_BIG
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.whole_messages import MessageCutter

HEADER: Final = Struct(">BI")
"""The kind of a message, and its size in bytes."""

TEXT, BINARY, CLOSE = 0, 1, 2
"""The kinds; the bytes of a close are its code and its reason."""

_CODE: Final = Struct(">H")


def close_bytes(code: int, reason: str) -> bytes:
    """Return a close as a message."""
    text = reason.encode("utf-8", "replace")[:123].decode("utf-8", "ignore").encode()
    return _CODE.pack(code) + text


def close_of(data: bytes) -> tuple[int, str]:
    """Code and reason of a close."""
    return _CODE.unpack_from(data)[0], data[_CODE.size :].decode("utf-8", "replace")


def _pieces(frame: Frame) -> tuple[Buffer, ...]:
    return (HEADER.pack(BINARY if frame.binary else TEXT, frame.size), *frame.parts)


FRAMING: Final = Framing(lambda frame: b"".join(_pieces(frame)), _pieces)
"""One frame after its header."""


class AsgiWire:
    """Messages of one WebSocket. The driver feeds a header, then a whole message.

    Args:
        events: what the wire reports to, messages excepted.
        max_size: largest message in bytes.
    """

    __slots__ = ("_events", "_kind", "_max_size", "_over", "message")

    def __init__(self, events: WireEvents, max_size: int) -> None:
        self._events = events
        self._max_size = max_size
        self._kind: int | None = None
        self._over = False
        self.message: Callable[[bytes, bool], None] = _ignore

    @property
    def framing(self) -> Framing:
        return FRAMING

    def feed(self, data: bytes) -> None:
        """Take a header, or the message that it announced."""
        if self._over:
            return
        kind, self._kind = self._kind, None
        if kind is None:
            self._kind = HEADER.unpack(data)[0]
        elif kind == CLOSE:
            self._over = True
            self._events.ended(*close_of(data), agreed=True)
        elif len(data) <= self._max_size:
            self.message(data, kind == BINARY)
        elif self._events.oversized(len(data)):
            self._events.oversized_head(len(data), data[:HEAD_BYTES])
        else:
            self._over = True
            reason = f"a message of {len(data)} bytes; the limit is {self._max_size} (max_message_size)"
            self._events.answer(_message(CLOSE, close_bytes(TOO_BIG, reason)))
            self._events.ended(TOO_BIG, reason, agreed=False)

    def get_buffer(self) -> None:
        """Messages come whole."""

    def buffer_updated(self, count: int) -> None:
        """No-op: there is no buffer."""

    def give_up(self, reason: str) -> None:
        """No-op: there are no incomplete messages."""

    def close(self, code: int, reason: str) -> bytes:
        """Return the message that the driver reads as a close; only once."""
        if self._over:
            return b""
        self._over = True
        self.message = _ignore
        return _message(CLOSE, close_bytes(code, reason))

    def ping(self) -> bytes:
        return b""


def _message(kind: int, data: bytes) -> bytes:
    return HEADER.pack(kind, len(data)) + data


def _ignore(_data: bytes, _binary: bool) -> None:
    """Drop a message: the endpoint is missing or closing."""


def asgi_messages(events: WireEvents, limits: Limits, buffers: ReceiveBufferPool) -> AsgiWire:
    """Return the wire of one WebSocket."""
    return AsgiWire(events, limits.message_bytes)


class KindCutter(MessageCutter):
    """Takes the messages apart that a connection has for its driver, and tells their kinds."""

    __slots__ = ("_kind",)

    def next_of_kind(self) -> tuple[int, bytes] | None:
        """Return the kind of the next message, and the message; None if there is no complete one."""
        if self._wanted < 0:
            header = self._read(HEADER.size)
            if header is None:
                return None
            self._kind, self._wanted = HEADER.unpack(header)
        data = self._read(self._wanted)
        if data is None:
            return None
        self._wanted = -1
        return self._kind, data
