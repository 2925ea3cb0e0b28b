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
from collections.abc import Callable, Generator, Iterator
from functools import cache
from io import BytesIO
from typing import Final, Protocol

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

_STEP: Final = 32 * 1024
"""Bytes that are compressed in one step."""

_BEYOND_ASCII: Final = re.compile(r"[^\x00-\x7f]+")


class _Packer(Protocol):
    def compress(self, data: bytes, /) -> bytes: ...
    def flush(self) -> bytes: ...


def encode(frame: Frame) -> Frame:
    """The JSON message `frame` as a `png` message, made at once.

    How hard the text is compressed follows from how well a sample of it does, and from its size: what
    compresses well takes about 5 ms for each megabyte, and what does not up to 14 ms, or 9 ms with the extra
    `fast`. That is two to three times as long as it took to write the message as JSON.
    """
    steps = encode_in_steps(frame)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            made: Frame = end.value
            return made


def encode_in_steps(frame: Frame) -> Generator[None, None, Frame]:
    """The same in steps of a millisecond at most, between which others may be served."""
    import pybase64  # only for those who use it

    text = yield from _ascii(frame.data)
    picture = yield from _picture(text)
    return Frame(_HEAD, pybase64.b64encode(picture), _END)


class PictureEncoder:
    """An encoder for the samples of one topic: the JSON message in the pixels of a picture (PNG-01)."""

    __slots__ = ("_prefix", "_ready")

    def __init__(self, prefix: bytes) -> None:
        self._prefix = prefix
        self._ready: tuple[Sample, Frame] | None = None

    def __call__(self, sample: Sample) -> Frame:
        """The frame of a sample, which subscribers share."""
        ready, self._ready = self._ready, None
        if ready is not None and ready[0] is sample:
            return ready[1]
        return encode(publish_frame(self._prefix, sample.payload.json()))

    def steps(self, sample: Sample) -> Iterator[None]:
        """Make the frame of a sample in steps; the next call has it, if it is for this sample."""
        text = sample.payload.json()
        yield
        frame = yield from encode_in_steps(publish_frame(self._prefix, text))
        self._ready = (sample, frame)


def publish_encoder(topic: str) -> PictureEncoder:
    """An encoder for the samples of `topic`."""
    return PictureEncoder(publish_prefix(topic))


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


def _ascii(text: bytes) -> Generator[None, None, bytes]:
    """JSON text with everything beyond ASCII as escapes: clients read the pixels byte by byte (PNG-05)."""
    if text.isascii():
        return text
    whole = text.decode()
    pieces = []
    for start in range(0, len(whole), _STEP):
        pieces.append(_BEYOND_ASCII.sub(_escape, whole[start : start + _STEP]).encode())
        yield
    return b"".join(pieces)


def _escape(found: re.Match[str]) -> str:
    from json.encoder import encode_basestring_ascii  # Needed by few: who asks for png texts beyond ASCII.

    # Nothing in it needs another escape than those of what is beyond ASCII.
    return encode_basestring_ascii(found[0])[1:-1]


def _picture(text: bytes) -> Generator[None, None, bytes]:
    """`text` as the pixels of a nearly square picture, padded with newlines (PNG-03)."""
    width = max(1, int(math.sqrt(len(text) / 3)))
    height = math.ceil(len(text) / 3 / width)
    header = _HEADER.pack(width, height, *_RGB8)
    packed = yield from _compress(text, width * 3, height)
    return b"".join(
        (
            _SIGNATURE,
            _chunk(b"IHDR", header),
            _chunk(b"IDAT", packed),
            _chunk(b"IEND", b""),
        )
    )


def _compress(text: bytes, row: int, height: int) -> Generator[None, None, bytes]:
    """The rows of a picture in zlib's format, each begun by its filter (0), as small as the time allows.

    Args:
        text: what is in the pixels; the last row is padded.
        row: octets in each row.
        height: how many rows.
    """
    packer = _packer(text)
    together = max(1, _STEP // row)
    pieces = []
    for first in range(0, height, together):
        if first:
            yield
        begin, end = first * row, min(first + together, height) * row
        part = text[begin:end].ljust(end - begin, b"\n")
        rows = b"".join(b"\x00" + part[start : start + row] for start in range(0, len(part), row))
        pieces.append(packer.compress(rows))
    pieces.append(packer.flush())
    return b"".join(pieces)


def _packer(text: bytes) -> _Packer:
    """What compresses a text.

    Searching long for matches pays where there are many and is then quick (a map: 4 ms for a megabyte, 150
    times smaller) up to 4 MiB; where there are few it takes 60 ms and gains next to nothing, so there the
    search is short, and where a sample has none (octets of an image in base64) only how often each character
    occurs is used, and in a large text not even that.
    """
    if len(text) <= _SMALL:
        return _quick(4, len(text))
    middle = len(text) // 2
    ratio = _SAMPLE / len(zlib.compress(text[middle : middle + _SAMPLE], 1))
    if ratio >= _MANY_MATCHES and len(text) <= 2 * _LARGE:
        return zlib.compressobj(6)
    return _quick(1 if ratio >= _SOME_MATCHES else None, len(text))


def _quick(level: int | None, size: int) -> _Packer:
    """The fast library where there is one (the extra `fast`), else zlib.

    Args:
        level: of zlib; None for no search for matches at all.
        size: bytes of the text.
    """
    fast = _fast_library()
    if fast is not None:
        return fast()
    if level is not None:
        return zlib.compressobj(level)
    return zlib.compressobj(1 if size <= _LARGE else 0, strategy=zlib.Z_HUFFMAN_ONLY)


@cache
def _fast_library() -> Callable[[], _Packer] | None:
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
