"""Wrapping of frames for a client library: CBOR, png, fragments."""

from __future__ import annotations

import base64
import json
import math
import struct
import zlib
from collections.abc import Sequence

from rosbridge_conformance.suite.values import Json

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def wrap(frame: Json, via: Sequence[str], fragment_size: int, fragment_id: str) -> list[str | bytes]:
    """Return the frames to send for one frame and its wrappings, innermost first.

    Args:
        frame: the frame; for CBOR, bytes are `{"$bytes": hex}` and tags `{"$tag": n, "$content": …}`.
        via: wrappings: png, cbor and fragments.
        fragment_size: characters of text in each fragment.
        fragment_id: non-empty string.
    """
    texts = [json.dumps(frame)]
    for wrapping in via:
        if wrapping == "cbor":
            return [cbor(frame)]
        if wrapping == "png":
            texts = [
                json.dumps({"op": "png", "data": base64.b64encode(png(text)).decode()}) for text in texts
            ]
        else:
            texts = [part for text in texts for part in fragments(text, fragment_size, fragment_id)]
    return list(texts)


def fragments(text: str, size: int, mark: str) -> list[str]:
    """Return the text as `fragment` ops, in order, numbered from zero (FRG-01, FRG-02)."""
    parts = [text[start : start + size] for start in range(0, len(text), size)]
    return [
        json.dumps({"op": "fragment", "id": mark, "data": part, "num": number, "total": len(parts)})
        for number, part in enumerate(parts)
    ]


def png(text: str) -> bytes:
    """Return a PNG whose pixels are the text: 8-bit RGB, padded with line breaks (PNG-02, PNG-03)."""
    data = text.encode()
    width = max(1, math.isqrt(len(data) // 3))
    height = math.ceil(len(data) / 3 / width)
    data = data.ljust(width * height * 3, b"\n")
    rows = (data[start : start + 3 * width] for start in range(0, len(data), 3 * width))
    pixels = zlib.compress(b"".join(b"\0" + row for row in rows))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return _SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", pixels) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def cbor(value: Json) -> bytes:
    """Encode in CBOR: definite lengths, shortest integers, floats of 64 bits (RFC 8949; CBR-01, CBR-05)."""
    if value is None or isinstance(value, bool):
        return {None: b"\xf6", False: b"\xf4", True: b"\xf5"}[value]
    if isinstance(value, int):
        return _head(0, value) if value >= 0 else _head(1, -1 - value)
    if isinstance(value, float):
        return b"\xfb" + struct.pack(">d", value)
    if isinstance(value, str):
        return _head(3, len(value.encode())) + value.encode()
    if isinstance(value, list):
        return _head(4, len(value)) + b"".join(cbor(item) for item in value)
    if "$bytes" in value:
        data = bytes.fromhex(str(value["$bytes"]))
        return _head(2, len(data)) + data
    if "$tag" in value:
        tag = value["$tag"]
        return _head(6, tag if isinstance(tag, int) else 0) + cbor(value["$content"])
    return _head(5, len(value)) + b"".join(cbor(key) + cbor(item) for key, item in value.items())


def _head(major: int, count: int) -> bytes:
    """Encode a major type and a count in the fewest bytes (RFC 8949 section 3)."""
    first = major << 5
    if count < 24:
        return bytes([first | count])
    for code, letter in ((24, "B"), (25, "H"), (26, "I"), (27, "Q")):
        if count < 1 << 8 * struct.calcsize(letter):
            return bytes([first | code]) + struct.pack(f">{letter}", count)
    raise ValueError(f"{count} does not fit into 64 bits")
