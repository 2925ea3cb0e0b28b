"""WebSocket wire with the extension permessage-deflate (RFC 7692).

Incoming messages are inflated with or without the context of those before them, as was agreed, and never to
more than a message may have: one that would become larger ends the connection with 1009, for what follows
could not be read without it.

Outgoing messages are compressed in one of two ways. Without context the bytes of a message are the same for
every peer, so that it is compressed once however many read it; with context each connection compresses by
itself, which makes small messages much smaller and costs time and memory for each connection.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Generator, Iterator
from functools import cache, partial
from itertools import count
from typing import Final

from rwt_protocol.frames import Buffer, Frame, Framing
from rwt_transports.api import TakeSteps, WireEvents
from rwt_transports.limits import Limits
from rwt_transports.websocket.close_codes import INVALID_DATA, TOO_BIG
from rwt_transports.websocket.extensions import DeflateTerms
from rwt_transports.websocket.wire import (
    BINARY,
    CONTINUATION,
    TEXT,
    ProtocolViolation,
    WebSocketWire,
    pack,
    server_pieces,
    server_whole,
)
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

_COMPRESSED: Final = 0x40
"""The bit RSV1 in the first byte of a message's first frame (RFC 7692 section 6)."""
_TAIL: Final = b"\x00\x00\xff\xff"
"""End of a flushed block, omitted from messages (section 7.2.1)."""
_WINDOW_BYTES: Final = 32 * 1024
_SMALL_BYTES: Final = 1024
"""Maximum size of compressed messages that are inflated at once, to a megabyte at most."""
_EAGER_STEPS: Final = 2
"""Number of steps in which most messages are inflated."""
_STEP_BYTES: Final = 64 * 1024
"""Bytes of input and output of a step."""
_MOST_BLOCKS: Final = 16
"""Maximum number of final blocks in a message; known compressors write at most one."""

SMALLEST_BYTES: Final = 100
"""Minimum size of a message that is compressed without context; smaller ones would not shrink."""
LARGEST_BYTES: Final = 1024 * 1024
"""Maximum size of a message that is compressed: compressing a larger one would block the event loop."""
_LEVEL: Final = 3
_MEMORY: Final = 5
"""Memory level of zlib, 1 to 9: at 5, with a window of 12 bits, a context takes 32 KiB."""


class _Deflater:
    """Compressor with context across messages."""

    __slots__ = ("_packer",)

    def __init__(self, bits: int) -> None:
        self._packer = zlib.compressobj(_LEVEL, zlib.DEFLATED, -bits, _MEMORY)

    def pack(self, frame: Frame) -> bytes:
        packer = self._packer
        packed = b"".join((*map(packer.compress, frame.parts), packer.flush(zlib.Z_SYNC_FLUSH)))
        return packed[: -len(_TAIL)]

    def whole(self, frame: Frame) -> bytes:
        # Permitted within a compressed connection: RSV1 says for each message whether it is compressed.
        if frame.size > LARGEST_BYTES:
            return server_whole(frame)
        return _compressed_frame(self.pack(frame), frame.binary)


def _compressed_frame(packed: bytes, binary: bool) -> bytes:
    return pack(_COMPRESSED | (BINARY if binary else TEXT), packed, masked=False)


# One framing per window size: connections with the same object share the compressed bytes of a frame.
@cache
def shared_framing(bits: int) -> Framing:
    """Framing of messages compressed without context in a window of that many bits; shared by all peers."""

    def whole(frame: Frame) -> bytes:
        if not SMALLEST_BYTES <= frame.size <= LARGEST_BYTES:
            return server_whole(frame)
        packed = _Deflater(bits).pack(frame)
        return server_whole(frame) if len(packed) >= frame.size else _compressed_frame(packed, frame.binary)

    return _framing(whole, shared=True)


def _framing(whole: Callable[[Frame], bytes], *, shared: bool) -> Framing:
    def pieces(frame: Frame) -> tuple[Buffer, ...]:
        if frame.size > LARGEST_BYTES:
            return server_pieces(frame)
        return (frame.framed(whole) if shared else whole(frame),)

    return Framing(whole, pieces, shared)


class _Inflater:
    """Decompressor of messages.

    Args:
        keep: True if each is in the context of those before it.

    Attributes:
        most: bytes that one may have.
    """

    __slots__ = ("_keep", "_unpacker", "most")

    def __init__(self, keep: bool) -> None:
        self._keep = keep
        self.most = 0
        # Negative: raw DEFLATE. The window of 15 bits reads what peers compress with any smaller one.
        self._unpacker = zlib.decompressobj(-15)

    def unpack(self, payload: bytes) -> Generator[None, None, bytes]:
        if not self._keep:
            self._unpacker = zlib.decompressobj(-15)
        packed = memoryview(payload + _TAIL)
        found: list[bytes] = []
        # One byte more, so that a message of exactly the limit is not mistaken for a larger one.
        most = self.most
        left, blocks, place = most + 1, 1, 0
        piece: bytes | memoryview = b""
        is_full = False
        while piece or is_full or place < len(packed):
            if not (piece or is_full):
                piece = packed[place : place + _STEP_BYTES]
                place += len(piece)
            room = min(_STEP_BYTES, left)
            try:
                inflated = self._unpacker.decompress(piece, room)
            except zlib.error:
                raise ProtocolViolation(INVALID_DATA, "a compressed message is damaged") from None
            found.append(inflated)
            left -= len(inflated)
            if left <= 0:
                raise ProtocolViolation(
                    TOO_BIG,
                    f"a message inflates to more than {most} bytes, the limit (max_message_size)",
                )
            # At the maximum, more output may be pending, even if all input was consumed.
            is_full = len(inflated) == room
            piece = self._unpacker.unconsumed_tail
            if self._unpacker.eof:
                # A final block within the stream (section 7.2.3.4): a new one begins, with the window of the
                # old.
                blocks += 1
                if blocks > _MOST_BLOCKS:
                    raise ProtocolViolation(
                        INVALID_DATA, f"a compressed message has more than {_MOST_BLOCKS} final blocks"
                    )
                piece, is_full = self._unpacker.unused_data, False
                window = _end_of(found)
                self._unpacker = zlib.decompressobj(-15, zdict=window) if window else zlib.decompressobj(-15)
            yield
        return b"".join(found)


def _end_of(parts: list[bytes]) -> bytes:
    end = b""
    for part in reversed(parts):
        end = part + end
        if len(end) >= _WINDOW_BYTES:
            break
    return end[-_WINDOW_BYTES:]


class DeflateWire(WebSocketWire):
    """WebSocket wire of a server with permessage-deflate.

    Attributes:
        take_steps: runs the steps in which a large message is inflated; None: without steps, it is
            inflated at once.
    """

    __slots__ = ("_compressed", "_inflater", "take_steps")

    def __init__(
        self, terms: DeflateTerms, events: WireEvents, limits: Limits, buffers: ReceiveBufferPool
    ) -> None:
        self._inflater = _Inflater(terms.peer_keeps_context)
        super().__init__(events, limits, buffers)
        self.take_steps: TakeSteps | None = None
        self._compressed = False  # the message under way is
        self.framing = (
            _framing(_Deflater(terms.window_bits).whole, shared=False)
            if terms.keeps_context
            else shared_framing(terms.window_bits)
        )

    def limit(self, size: int) -> None:
        super().limit(size)
        self._inflater.most = size

    def _check(self, first: int, size: int, *, masked: bool) -> None:
        if first & _COMPRESSED and first & 0x0F in (TEXT, BINARY):
            first &= ~_COMPRESSED
        # RSV1 is permitted on the first frame of a data message only; the base rejects it elsewhere.
        super()._check(first, size, masked=masked)

    def _admit(self, first: int, size: int) -> bool:
        total = len(self._parts) + size
        if (first & _COMPRESSED or self._compressed) and total > self._max_size:
            # Not skipped, as an uncompressed one is: the context of later messages would be incomplete.
            raise self._too_big(total)
        return super()._admit(first, size)

    def _data_frame(self, first: int, payload: bytes) -> None:
        if first & 0x0F != CONTINUATION:
            self._compressed = bool(first & _COMPRESSED)
        super()._data_frame(first, payload)

    def _deliver(self, payload: bytes, binary: bool) -> None:
        compressed, self._compressed = self._compressed, False
        if not compressed:
            super()._deliver(payload, binary)
            return
        steps = self._inflater.unpack(payload)
        take = self.take_steps if len(payload) > _SMALL_BYTES else None
        for _ in range(_EAGER_STEPS) if take is not None else count():
            try:
                next(steps)
            except StopIteration as end:
                super()._deliver(end.value, binary)
                return
        assert take is not None  # Else all steps are taken.
        # Later messages must not overtake this one, and may need its context.
        self._is_held = True
        self._buffers.count_unread(self, len(payload))
        take(self._deliver_later(steps, binary), partial(self._buffers.may_inflate, self, self._max_size))

    def _deliver_later(self, steps: Generator[None, None, bytes], binary: bool) -> Iterator[None]:
        try:
            message = yield from steps
            self._buffers.count_unread(self, len(message))
            super()._deliver(message, binary)
        except ProtocolViolation as violation:
            self._fail(violation.code, str(violation))
