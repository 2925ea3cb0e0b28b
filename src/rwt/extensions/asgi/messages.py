"""Wire of a WebSocket behind an ASGI server, whose messages arrive whole, and whose close is one of them."""

from __future__ import annotations

from struct import Struct
from typing import Final

from rwt_transports.api import HEAD_BYTES
from rwt_transports.websocket.close_codes import TOO_BIG
from rwt_transports.wires.whole_messages import BINARY, CLOSE, HEADER, MessageWire

_CODE: Final = Struct(">H")


def close_bytes(code: int, reason: str) -> bytes:
    """Return a close as a message."""
    text = reason.encode("utf-8", "replace")[:123].decode("utf-8", "ignore").encode()
    return _CODE.pack(code) + text


def close_of(data: bytes) -> tuple[int, str]:
    """Return code and reason of a close."""
    return _CODE.unpack_from(data)[0], data[_CODE.size :].decode("utf-8", "replace")


class AsgiWire(MessageWire):
    """Wire of one WebSocket. The driver feeds a header, then a whole message."""

    __slots__ = ()

    def feed(self, data: bytes) -> None:
        if self._over:
            return
        if self._wanted < 0:
            self._kind, self._wanted = HEADER.unpack(data)
            return
        self._wanted = -1
        if self._kind == CLOSE:
            self._over = True
            self._events.ended(*close_of(data), agreed=True)
        elif len(data) <= self._max_size:
            self.message(data, self._kind == BINARY)
        elif self._events.oversized(len(data)):
            self._events.oversized_head(len(data), data[:HEAD_BYTES])
        else:
            reason = f"a message of {len(data)} bytes; the limit is {self._max_size} (max_message_size)"
            self._events.answer(_close_message(TOO_BIG, reason))
            self._end(TOO_BIG, reason)

    def close(self, code: int, reason: str) -> bytes:
        """Return the message that the driver reads as a close; only once."""
        if self._over:
            return b""
        super().close(code, reason)
        return _close_message(code, reason)


def _close_message(code: int, reason: str) -> bytes:
    data = close_bytes(code, reason)
    return HEADER.pack(CLOSE, len(data)) + data
