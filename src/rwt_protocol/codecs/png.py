"""PNG encoding: a message's text as the pixels of an image, compressed by PNG.

Rows are written with filter 0, because other filters make text longer. The decoder accepts all filters.
"""

from __future__ import annotations

import binascii
import codecs
import math
import re
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from io import BytesIO
from typing import Final, Protocol

from rwt_protocol.codecs.base import SteppedEncoder, Steps, finished
from rwt_protocol.codecs.json import publish_prefix
from rwt_protocol.errors import Refused
from rwt_protocol.frames import Buffer, Frame
from rwt_protocol.payloads import PublishedMessage

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_HEADER: Final = struct.Struct(">IIBBBBB")
_RGB8: Final = (8, 2, 0, 0, 0)
"""Bit depth 8, colour type 2, default compression and filter methods, no interlacing (PNG-02)."""

_HEAD: Final = b'{"op":"png","data":"'
_END: Final = b'"}'

_SMALL: Final = 128 * 1024
"""Maximum bytes that are compressed without a sample."""
_LARGE: Final = 2 * 1024 * 1024
"""Bytes above which text without matches is stored uncompressed."""
_SAMPLE: Final = 16 * 1024
_MANY_MATCHES: Final = 12
_SOME_MATCHES: Final = 4
"""Compression ratios of the sample that justify a long or a short match search."""

_STEP: Final = 32 * 1024
"""Bytes that are compressed per step."""
_PART: Final = 192 * 1024
"""Minimum bytes of an image that form a separate part of the message."""

_PIXELS: Final = b"IDAT"

_BEYOND_ASCII: Final = re.compile(r"[^\x00-\x7f]+")
_AMBIGUOUS: Final = re.compile(r"\\x|[\U00010000-\U0010ffff]")
"""Text whose Python escapes differ from JSON's: a second backslash before an x, and non-BMP characters."""


class _Packer(Protocol):
    def compress(self, data: bytes, /) -> bytes: ...
    def flush(self) -> bytes: ...


def encode(frame: Frame) -> Frame:
    """Encode the JSON message `frame` as a `png` message.

    The compression level depends on the size and on how well a sample compresses. Compressible text takes
    about 5 ms per MB, other text up to 14 ms, or 9 ms with the extra `fast`.
    """
    return finished(_image_frame(frame.data))


def _joined(parts: Sequence[Buffer]) -> Steps[bytearray]:
    """Join the parts of a text, one per step: filling much new memory at once is slow."""
    text = bytearray()  # A bytearray grows in place where the C library has room or can move pages.
    for part in parts:
        text += part
        yield
    return text


def _image_frame(data: bytes | bytearray) -> Steps[Frame]:
    """Encode a JSON text as a `png` message, in steps of a millisecond at most."""
    text = yield from _ascii(data)
    width = max(1, int(math.sqrt(len(text) / 3)))
    height = math.ceil(len(text) / 3 / width)
    picture = yield from _picture(width, height, _compressed(text, width * 3, height))
    return Frame(_HEAD, *picture, _END)


class PngEncoder(SteppedEncoder):
    """Encoder for the samples of one topic: the JSON message as the pixels of an image (PNG-01)."""

    def __init__(self, prefix: bytes) -> None:
        super().__init__()
        self._prefix = prefix

    def encode_in_steps(self, sample: PublishedMessage) -> Steps[Frame]:
        """Encode a sample in steps of a millisecond at most."""
        text = yield from _joined((self._prefix, *sample.payload.json_parts(), b"}"))
        return (yield from _image_frame(text))


def publish_encoder(topic: str) -> PngEncoder:
    """Return an encoder for the samples of `topic`."""
    return PngEncoder(publish_prefix(topic))


def decode(data: str, max_size: int) -> bytes:
    """Return the JSON text in an image. Its padding is white space in JSON (PNG-07).

    Args:
        max_size: maximum bytes of text; checked before decompression.

    Raises:
        Refused: not base64, not such an image, or too large.
    """
    try:
        picture = binascii.a2b_base64(data, strict_mode=True)
    except ValueError:
        raise Refused("png.data: expected base64") from None
    width, height, compressed = _read_picture(picture)
    if width * height * 3 > max_size:
        raise Refused(f"png.data: the picture holds {width * height * 3} bytes; the limit is {max_size}")
    row = 1 + width * 3
    unpacker = zlib.decompressobj()
    try:
        rows = unpacker.decompress(compressed, row * height)
    except zlib.error:
        raise Refused("png.data: the picture is damaged") from None
    # decompress() stops at the limit, so a bomb yields no more than its header announces.
    if len(rows) != row * height:
        raise Refused("png.data: the picture is cut short")
    if any(rows[::row]):
        # Filtered rows depend on their neighbours: Pillow reads them far faster than a loop here.
        return _filtered(picture)
    return b"".join(rows[start + 1 : start + row] for start in range(0, len(rows), row))


def _ascii(text: bytes | bytearray) -> Steps[bytes | bytearray]:
    """Escape everything beyond ASCII: clients read the pixels byte by byte (PNG-05)."""
    if text.isascii():
        return text
    # Incremental, because a step may end within a character.
    decode = codecs.getincrementaldecoder("utf-8")().decode
    pieces = []
    for start in range(0, len(text), _STEP):
        pieces.append(_escaped(decode(text[start : start + _STEP], start + _STEP >= len(text))))
        yield
    return b"".join(pieces)


def _escaped(text: str) -> bytes:
    """Escape what is beyond ASCII; nothing else in the text needs it."""
    if not _AMBIGUOUS.search(text):
        return text.encode("ascii", "backslashreplace").replace(b"\\x", b"\\u00")
    return _BEYOND_ASCII.sub(_escape, text).encode()


def _escape(found: re.Match[str]) -> str:
    from json.encoder import encode_basestring_ascii  # Rarely needed: only for png messages beyond ASCII.

    return encode_basestring_ascii(found[0])[1:-1]


def _picture(width: int, height: int, packed: Iterator[bytes]) -> Steps[list[bytes]]:
    """Return the parts of an image in base64; its compressed pixels come in pieces, one per step."""
    import pybase64  # optional import: slow to load

    checksum = zlib.crc32(_PIXELS)
    size = 0
    waiting: list[bytes] = []
    waits = 0
    parts = [b""]
    first = b""
    for piece in packed:
        checksum = zlib.crc32(piece, checksum)
        size += len(piece)
        waiting.append(piece)
        waits += len(piece)
        if waits >= _PART:
            # The head contains the length, and its last four letters have room for one more byte.
            data = b"".join(waiting)
            begin = 0 if first else 1
            first = first or data[:1]
            whole = begin + (len(data) - begin) // 3 * 3
            parts.append(pybase64.b64encode(memoryview(data)[begin:whole]))
            waiting, waits = [data[whole:]], len(data) - whole
        yield
    header = _chunk(b"IHDR", _HEADER.pack(width, height, *_RGB8))
    head = b"".join((_SIGNATURE, header, struct.pack(">I", size), _PIXELS, first))
    tail = b"".join((*waiting, struct.pack(">I", checksum), _chunk(b"IEND", b"")))
    if len(parts) == 1:
        return [pybase64.b64encode(head + tail)]
    parts[0] = pybase64.b64encode(head)
    parts.append(pybase64.b64encode(tail))
    return parts


def _compressed(text: bytes | bytearray, row: int, height: int) -> Iterator[bytes]:
    """Return the rows of an image in zlib's format, each with filter 0, in pieces.

    Args:
        text: content of the pixels; the last row is padded with newlines (PNG-03).
    """
    packer = _packer(text)
    together = max(1, _STEP // row)
    for first in range(0, height, together):
        begin, end = first * row, min(first + together, height) * row
        part = text[begin:end].ljust(end - begin, b"\n")
        rows = b"".join(b"\x00" + part[start : start + row] for start in range(0, len(part), row))
        yield packer.compress(rows)
    yield packer.flush()


def _packer(text: bytes | bytearray) -> _Packer:
    """Return the compressor for a text.

    A long match search pays where a sample has many matches, up to 4 MiB (a map: 4 ms per MB, ratio 150).
    With few matches it takes 60 ms and gains almost nothing, so the search is short. Without matches (base64)
    only Huffman coding is used, and large texts are stored.
    """
    if len(text) <= _SMALL:
        return _quick(4, len(text))
    middle = len(text) // 2
    ratio = _SAMPLE / len(zlib.compress(text[middle : middle + _SAMPLE], 1))
    if ratio >= _MANY_MATCHES and len(text) <= 2 * _LARGE:
        return zlib.compressobj(6)
    return _quick(1 if ratio >= _SOME_MATCHES else None, len(text))


def _quick(level: int | None, size: int) -> _Packer:
    """Return a compressor of the fast library (extra `fast`), else of zlib; level None: no match search."""
    fast = fast_library()
    if fast is not None:
        return fast()
    if level is not None:
        return zlib.compressobj(level)
    return zlib.compressobj(1 if size <= _LARGE else 0, strategy=zlib.Z_HUFFMAN_ONLY)


@cache
def fast_library() -> Callable[[], _Packer] | None:
    """Return the factory of the fastest compressor; None if it is not installed."""
    try:
        from isal import isal_zlib  # loaded by the first picture
    except ImportError:
        return None
    packer: Callable[[int], _Packer] = isal_zlib.compressobj
    return lambda: packer(2)


def _chunk(kind: bytes, body: bytes) -> bytes:
    checksum = zlib.crc32(body, zlib.crc32(kind))
    return b"".join((struct.pack(">I", len(body)), kind, body, struct.pack(">I", checksum)))


def _read_picture(picture: bytes) -> tuple[int, int, bytes]:
    """Return width, height and compressed rows; raises Refused unless it is 8-bit RGB."""
    wrong = Refused("png.data: expected a PNG picture of 8-bit RGB, not interlaced")
    if not picture.startswith(_SIGNATURE):
        raise wrong
    size: tuple[int, int] | None = None
    rows: list[bytes] = []
    position = len(_SIGNATURE)
    while position + 12 <= len(picture):
        length = int.from_bytes(picture[position : position + 4], "big")
        kind = picture[position + 4 : position + 8]
        body = picture[position + 8 : position + 8 + length]
        position += 12 + length
        if kind == b"IHDR" and len(body) == _HEADER.size:
            width, height, *rest = _HEADER.unpack(body)
            size = (width, height) if tuple(rest) == _RGB8 and width and height else None
        elif kind == b"IDAT":
            rows.append(body)
        elif kind == b"IEND":
            break
    if size is None:
        raise wrong
    return *size, b"".join(rows)


def _filtered(picture: bytes) -> bytes:
    """Return the pixels of an image with filtered rows, whose size has been checked."""
    from PIL import Image  # slow import, rarely needed

    try:
        with Image.open(BytesIO(picture), formats=["PNG"]) as image:
            return image.tobytes()
    except (OSError, ValueError, SyntaxError):
        raise Refused("png.data: the picture is damaged") from None
