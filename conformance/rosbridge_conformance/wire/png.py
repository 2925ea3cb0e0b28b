"""Small PNG reader for the `png` op: 8-bit RGB, no alpha, no palette, not interlaced (PNG-02)."""

from __future__ import annotations

import base64
import binascii
import struct
import zlib
from dataclasses import dataclass

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOUR_MANAGEMENT = {b"gAMA", b"iCCP", b"sRGB", b"cHRM", b"tRNS"}


class NotPng(ValueError):
    """Data is not an image that rosbridge clients can read; the text gives reason and rule."""


@dataclass(frozen=True, slots=True)
class Picture:
    """Image: width and height in pixels, and three bytes per pixel in row order."""

    width: int
    height: int
    pixels: bytes


def read_data(data: str) -> Picture:
    """Decode the `data` of a `png` op.

    Raises:
        NotPng: it breaks one of PNG-02, PNG-04 or PNG-06.
    """
    try:
        raw = base64.b64decode(data, validate=True)
    except (binascii.Error, ValueError) as error:
        raise NotPng(f"data is not padded standard base64 without breaks (PNG-04): {error}") from error
    return read_png(raw)


def read_png(raw: bytes) -> Picture:
    """Decode a PNG file; raises NotPng as `read_data` does."""
    if not raw.startswith(_SIGNATURE):
        raise NotPng("data has no PNG signature")
    header, packed = b"", b""
    at = len(_SIGNATURE)
    while at + 12 <= len(raw):
        (length,) = struct.unpack_from(">I", raw, at)
        kind, body = raw[at + 4 : at + 8], raw[at + 8 : at + 8 + length]
        if len(raw) < at + 12 + length:
            raise NotPng(f"chunk {kind!r} is cut short")
        (checksum,) = struct.unpack_from(">I", raw, at + 8 + length)
        if checksum != zlib.crc32(kind + body):
            raise NotPng(f"chunk {kind!r} has a wrong checksum")
        if kind in _COLOUR_MANAGEMENT:
            raise NotPng(f"chunk {kind!r} changes colours in a browser (PNG-06)")
        header = body if kind == b"IHDR" else header
        packed += body if kind == b"IDAT" else b""
        at += 12 + length
    if len(header) != 13:
        raise NotPng("no IHDR chunk")
    width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", header)
    if (depth, colour, interlaced) != (8, 2, 0):
        raise NotPng(f"depth {depth}, colour type {colour}, interlace {interlaced}; want 8, 2, 0 (PNG-02)")
    try:
        rows = zlib.decompress(packed)
    except zlib.error as error:
        raise NotPng(f"pixels do not inflate: {error}") from error
    return Picture(width, height, _unfilter(rows, width * 3, height))


def _unfilter(rows: bytes, stride: int, height: int) -> bytes:
    if len(rows) != (stride + 1) * height:
        raise NotPng(f"{len(rows)} bytes of rows, {(stride + 1) * height} expected")
    pixels = bytearray()
    above = bytes(stride)
    for start in range(0, len(rows), stride + 1):
        kind, row = rows[start], bytearray(rows[start + 1 : start + 1 + stride])
        for index in range(stride):
            left = row[index - 3] if index >= 3 else 0
            corner = above[index - 3] if index >= 3 else 0
            row[index] = (row[index] + _predicted(kind, left, above[index], corner)) & 255
        pixels += row
        above = bytes(row)
    return bytes(pixels)


def _predicted(kind: int, left: int, up: int, corner: int) -> int:
    match kind:
        case 0:
            return 0
        case 1:
            return left
        case 2:
            return up
        case 3:
            return (left + up) // 2
        case 4:
            guess = left + up - corner
            return min((left, up, corner), key=lambda near: abs(guess - near))
    raise NotPng(f"row filter {kind} does not exist")
