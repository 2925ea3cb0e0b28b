"""Messages compressed one by one: permessage-deflate (RFC 7692), the server's side.

What goes out is always compressed by itself (``server_no_context_takeover``): then its bytes depend on
nothing but the frame and the window, and a sample is compressed once for all clients. What comes in may build
on the client's earlier messages (context takeover) or not, as the client wishes. Inflating stops at the
message limit.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import cache, partial
from struct import Struct
from typing import Protocol, runtime_checkable

from rwt_protocol.frames import Buffer, Frame

from ..api import Framing

LEVEL = 3
"""Of zlib. For JSON the higher ones cost several times the time for a few percent of the size."""
SMALLEST_BYTES = 128
"""A smaller message is sent as it is: it would not become much smaller."""

_TAIL = b"\x00\x00\xff\xff"
"""What both sides leave out at a message's end (RFC 7692 section 7.2.1)."""
_COMPRESSED = 0xC0
_TEXT, _BINARY = 0x1, 0x2
_SHORT = Struct("!BB").pack
_MEDIUM = Struct("!BBH").pack
_LONG = Struct("!BBQ").pack


@dataclass(frozen=True, slots=True)
class Deflate:
    """What was agreed with one client (RFC 7692 section 7.1).

    Attributes:
        window_bits: of the window for what is sent, 9 to 15.
        peer_window_bits: of the window for what comes, 8 to 15.
        peer_keeps_context: whether a message that comes may refer to earlier ones.
    """

    window_bits: int = 15
    peer_window_bits: int = 15
    peer_keeps_context: bool = True


@runtime_checkable
class Deflating(Protocol):
    """A wire that can compress."""

    def deflate(self, agreed: Deflate | None) -> None:
        """Compress from the first message on, or do not."""


class TooLarge(Exception):
    """More comes out than a message may have."""


class Malformed(Exception):
    """What came is not compressed as agreed."""


class Inflater:
    """Takes one client's messages apart.

    Attributes:
        keeps_context: whether a message may refer to earlier ones, so that none can be left out.
    """

    __slots__ = ("_bits", "_state", "keeps_context")

    def __init__(self, agreed: Deflate) -> None:
        # zlib reads a window of 8 bits with one of 9.
        self._bits = -max(agreed.peer_window_bits, 9)
        self.keeps_context = agreed.peer_keeps_context
        self._state = zlib.decompressobj(self._bits)

    def inflate(self, payload: bytes, most: int) -> bytes:
        """The message whose compressed form is `payload` (RFC 7692 section 7.2.2).

        Raises:
            TooLarge: it has more than `most` bytes; no more than that were made.
            Malformed: these are not the bytes of a deflated message.
        """
        state = self._state
        if not self.keeps_context:
            state = zlib.decompressobj(self._bits)
        try:
            data = state.decompress(payload, most + 1)
            if not state.eof and len(data) <= most:
                data += state.decompress(state.unconsumed_tail + _TAIL, most + 1 - len(data))
        except zlib.error:
            raise Malformed from None
        if len(data) > most:
            raise TooLarge
        if state.eof:
            # The last block says that it is the last: nothing but an empty one may follow (section 7.2.3.4).
            if state.unused_data not in (b"", b"\0", _TAIL, b"\0" + _TAIL):
                raise Malformed
            self._state = zlib.decompressobj(self._bits)
        return data


@cache
def deflating(window_bits: int) -> Framing:
    """How a server's frames become compressed ones; one object for each window, so that frames are shared."""
    whole = partial(_whole, window_bits)
    return Framing(whole, lambda frame: (frame.framed(whole),))


def _whole(window_bits: int, frame: Frame) -> bytes:
    opcode = _BINARY if frame.binary else _TEXT
    payload = _deflated(frame.parts, window_bits) if frame.size >= SMALLEST_BYTES else b""
    if not payload or len(payload) >= frame.size:
        return b"".join((_header(0x80 | opcode, frame.size), *frame.parts))
    return _header(_COMPRESSED | opcode, len(payload)) + payload


def _deflated(parts: tuple[Buffer, ...], window_bits: int) -> bytes:
    compressor = zlib.compressobj(LEVEL, zlib.DEFLATED, -window_bits)
    pieces = [compressor.compress(part) for part in parts]
    pieces.append(compressor.flush(zlib.Z_SYNC_FLUSH))
    return b"".join(pieces).removesuffix(_TAIL)


def _header(first: int, size: int) -> bytes:
    if size < 126:
        return _SHORT(first, size)
    if size < 65536:
        return _MEDIUM(first, 126, size)
    return _LONG(first, 127, size)
