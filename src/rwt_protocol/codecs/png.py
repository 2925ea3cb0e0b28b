"""A message as a picture (PNG): its text in the pixels, so that PNG's compression compresses it.

Every row is written with filter 0: text does not look like its neighbours above and to the left, and other
filters make it longer. Reading takes any filter.
"""

from __future__ import annotations

import binascii
import math
import re
import struct
import zlib
from collections.abc import Callable
from functools import cache
from io import BytesIO
from typing import Final

from rwt_protocol.codecs.base import PublishEncoder
from rwt_protocol.codecs.json import publish_frame, publish_prefix
from rwt_protocol.errors import Refused
from rwt_protocol.payloads import Sample
from rwt_protocol.transport import Frame

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_HEADER: Final = struct.Struct(">IIBBBBB")
_RGB8: Final = (8, 2, 0, 0, 0)
"""Bit depth 8, colour type 2, and no other compression, filter method or interlacing (PNG-02)."""

_HEAD: Final = b'{"op":"png","data":"'
_END: Final = b'"}'

_SMALL: Final = 128 * 1024
"""Bytes that are compressed without a look at a sample."""
_LARGE: Final = 2 * 1024 * 1024
"""Bytes above which a text without matches is not compressed at all, for want of time."""
_SAMPLE: Final = 16 * 1024
_MANY_MATCHES: Final = 12
_SOME_MATCHES: Final = 4
"""How many times smaller the sample becomes, from which a long or a short search for matches pays."""

_BEYOND_ASCII: Final = re.compile(r"[^\x00-\x7f]+")


def encode(frame: Frame) -> Frame:
    """The JSON message `frame` as a `png` message.

    It is done at once, on the thread that asks, so that a topic keeps its order: a thread of its own would
    have to queue what follows. How hard the text is compressed follows from how well a sample of it does, and
    from its size: what compresses well takes about 5 ms for each megabyte, and what does not up to 14 ms, or
    9 ms with the extra `fast`. That is two to three times as long as it took to write the message as JSON.
    """
    import pybase64  # only for those who use it

    return Frame(_HEAD, pybase64.b64encode(_picture(_ascii(frame.data))), _END)


def publish_encoder(topic: str) -> PublishEncoder:
    """An encoder for the samples of `topic`: the JSON message in the pixels of a picture (PNG-01)."""
    prefix = publish_prefix(topic)

    def in_picture(sample: Sample) -> Frame:
        return encode(publish_frame(prefix, sample.payload.json()))

    return in_picture


def decode(data: str, max_size: int) -> bytes:
    """The JSON text in a picture. The padding at its end is white space in JSON (PNG-07).

    Args:
        data: `Png.data`.
        max_size: most bytes of text; checked before anything is decompressed.

    Raises:
        Refused: not base64, not such a picture, or too large.
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
    if len(rows) != row * height:
        raise Refused("png.data: the picture is cut short")
    if any(rows[::row]):
        return _filtered(picture)
    return b"".join(rows[start + 1 : start + row] for start in range(0, len(rows), row))


def _ascii(text: bytes) -> bytes:
    """JSON text with everything beyond ASCII as escapes: clients read the pixels byte by byte (PNG-05)."""
    return text if text.isascii() else _BEYOND_ASCII.sub(_escape, text.decode()).encode()


def _escape(found: re.Match[str]) -> str:
    units = found[0].encode("utf-16-be").hex()
    return "".join(f"\\u{units[start : start + 4]}" for start in range(0, len(units), 4))


def _picture(text: bytes) -> bytes:
    """`text` as the pixels of a nearly square picture, padded with newlines (PNG-03)."""
    width = max(1, int(math.sqrt(len(text) / 3)))
    height = math.ceil(len(text) / 3 / width)
    row = width * 3
    text = text.ljust(row * height, b"\n")
    rows = b"".join(b"\x00" + text[start : start + row] for start in range(0, len(text), row))
    header = _HEADER.pack(width, height, *_RGB8)
    return b"".join(
        (
            _SIGNATURE,
            _chunk(b"IHDR", header),
            _chunk(b"IDAT", _compress(rows)),
            _chunk(b"IEND", b""),
        )
    )


def _compress(rows: bytes) -> bytes:
    """The rows in zlib's format, as small as the time for them allows.

    Searching long for matches pays where there are many and is then quick (a map: 4 ms for a megabyte, 150
    times smaller); where there are few it takes 60 ms and gains next to nothing, so there the search is
    short, and where a sample has none (octets of an image in base64) only how often each character occurs
    is used, and in a large text not even that.
    """
    if len(rows) <= _SMALL:
        return _quick(rows, 4)
    middle = len(rows) // 2
    ratio = _SAMPLE / len(zlib.compress(rows[middle : middle + _SAMPLE], 1))
    if ratio >= _MANY_MATCHES:
        return zlib.compress(rows, 6)
    return _quick(rows, 1 if ratio >= _SOME_MATCHES else None)


def _quick(rows: bytes, level: int | None) -> bytes:
    """Compressed by the fast library where there is one (the extra `fast`), else by zlib.

    Args:
        rows: what to compress.
        level: of zlib; None for no search for matches at all.
    """
    fast = _fast_library()
    if fast is not None:
        return fast(rows)
    if level is not None:
        return zlib.compress(rows, level)
    packer = zlib.compressobj(1 if len(rows) <= _LARGE else 0, strategy=zlib.Z_HUFFMAN_ONLY)
    return packer.compress(rows) + packer.flush()


@cache
def _fast_library() -> Callable[[bytes], bytes] | None:
    try:
        from isal import isal_zlib  # loaded by the first picture
    except ImportError:
        return None
    compress: Callable[[bytes, int], bytes] = isal_zlib.compress
    return lambda rows: compress(rows, 2)


def _chunk(kind: bytes, body: bytes) -> bytes:
    checksum = zlib.crc32(body, zlib.crc32(kind))
    return b"".join((struct.pack(">I", len(body)), kind, body, struct.pack(">I", checksum)))


def _read_picture(picture: bytes) -> tuple[int, int, bytes]:
    """Width, height and compressed rows.

    Raises:
        Refused: not a PNG picture of 8-bit RGB.
    """
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
    """The pixels of a picture whose rows are filtered, and whose size has been checked."""
    from PIL import Image  # heavy, and few pictures need it

    try:
        with Image.open(BytesIO(picture), formats=["PNG"]) as image:
            return image.tobytes()
    except (OSError, ValueError, SyntaxError):
        raise Refused("png.data: the picture is damaged") from None
