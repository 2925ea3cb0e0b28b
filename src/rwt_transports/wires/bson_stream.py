"""Wire of consecutive BSON documents (BSN-03).

Each begins with its length, a little-endian int32 that counts itself. An invalid length ends the connection,
because the next document cannot be found. Text frames are logged and dropped.
"""

from __future__ import annotations

import logging
import struct
from typing import Final

from rwt_protocol.frames import Buffer, Frame
from rwt_transports.api import HEAD_BYTES, WireEvents
from rwt_transports.limits import Limits
from rwt_transports.websocket.close_codes import PROTOCOL_ERROR
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.stream import ByteStreamWire, framing_of

logger = logging.getLogger("rwt_transports.bson_stream")

_LENGTH: Final = struct.Struct("<i")

#: An empty document: its length, and the zero byte that ends it.
SMALLEST: Final = 5


def _pieces(frame: Frame) -> tuple[Buffer, ...]:
    if frame.binary:
        return frame.parts
    logger.warning("a text message of %d bytes has no place on a BSON stream; left out", frame.size)
    return ()


DOCUMENTS = framing_of(_pieces)


class BsonStreamWire(ByteStreamWire):
    """Documents of one connection."""

    __slots__ = ("_to_skip",)

    framing = DOCUMENTS

    def __init__(self, events: WireEvents, limits: Limits, buffers: ReceiveBufferPool) -> None:
        super().__init__(events, limits, buffers)
        self._to_skip = 0

    def _step(self) -> bool:
        buffer = self._buffer
        if self._to_skip:
            skipped = min(self._to_skip, len(buffer))
            del buffer[:skipped]
            self._to_skip -= skipped
            return self._to_skip == 0
        if len(buffer) < _LENGTH.size:
            return False
        (length,) = _LENGTH.unpack_from(buffer)
        if length < SMALLEST:
            self._end(PROTOCOL_ERROR, f"a BSON document of {length} bytes; {SMALLEST} is the smallest")
            return False
        if length > self._max_size:
            return self._skip(length)
        # The buffer grows with received bytes, not to the announced length, which costs the sender nothing.
        if len(buffer) < length:
            return False
        document = bytes(buffer[:length])
        del buffer[:length]
        self._hand_on(document, True)
        return True

    def _skip(self, length: int) -> bool:
        if not self._may_skip(length):
            return False
        self._events.oversized_head(length, bytes(self._buffer[:HEAD_BYTES]))
        # Includes the four bytes of the length, which are still in the buffer.
        self._to_skip = length
        return True
