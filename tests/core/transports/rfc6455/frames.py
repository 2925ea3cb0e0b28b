"""WebSocket frames as raw bytes, made and read without the code under test."""

from __future__ import annotations

import struct

KEY = bytes.fromhex("37fa213d")

CONTINUATION, TEXT, BINARY, CLOSE, PING, PONG = 0x0, 0x1, 0x2, 0x8, 0x9, 0xA
FIN = 0x80

ReadFrame = tuple[int, bytes]
"""First byte (FIN, reserved bits, opcode) and payload."""


def mask(payload: bytes, key: bytes = KEY) -> bytes:
    """RFC 6455 section 5.3."""
    size = len(payload)
    whole = (key * (size // 4 + 1))[:size]
    return (int.from_bytes(payload, "big") ^ int.from_bytes(whole, "big")).to_bytes(size, "big")


def frame(
    opcode: int,
    payload: bytes = b"",
    *,
    fin: bool = True,
    reserved: int = 0,
    masked: bool = True,
    key: bytes = KEY,
    form: int = 0,
) -> bytes:
    """One frame as a client sends it (RFC 6455 section 5.2).

    Args:
        reserved: the bits RSV1 to RSV3 as a number, RSV1 worth 4.
        form: bits of the length field, 7, 16 or 64; 0 takes the shortest.
    """
    size = len(payload)
    first = (FIN if fin else 0) | reserved << 4 | opcode
    bit = 0x80 if masked else 0
    form = form or (7 if size < 126 else 16 if size < 65536 else 64)
    if form == 7:
        head = bytes((first, bit | size))
    elif form == 16:
        head = struct.pack("!BBH", first, bit | 126, size)
    else:
        head = struct.pack("!BBQ", first, bit | 127, size)
    return head + key + mask(payload, key) if masked else head + payload


def text(payload: str | bytes) -> bytes:
    """A whole text message."""
    return frame(TEXT, payload.encode() if isinstance(payload, str) else payload)


def fragments(opcode: int, *pieces: bytes) -> bytes:
    """One message in as many frames as there are pieces."""
    last = len(pieces) - 1
    return b"".join(
        frame(opcode if at == 0 else CONTINUATION, piece, fin=at == last) for at, piece in enumerate(pieces)
    )


def close(code: int | None = None, reason: bytes = b"") -> bytes:
    """A close frame; without a code it is empty."""
    return frame(CLOSE, b"" if code is None else struct.pack("!H", code) + reason)


def close_body(code: int, reason: bytes = b"") -> bytes:
    """The payload of a close frame."""
    return struct.pack("!H", code) + reason


def read_frames(data: bytes) -> list[ReadFrame]:
    """Return the frames that a server sent.

    Raises:
        AssertionError: they are not whole, are masked, or have longer lengths than needed.
    """
    found: list[ReadFrame] = []
    at = 0
    while at < len(data):
        first, second = data[at], data[at + 1]
        assert second < 128, "a server must not mask"
        at += 2
        size = second
        if second == 126:
            (size,) = struct.unpack_from("!H", data, at)
            at += 2
            assert size > 125, "not the shortest length"
        elif second == 127:
            (size,) = struct.unpack_from("!Q", data, at)
            at += 8
            assert size > 65535, "not the shortest length"
        assert at + size <= len(data), "the last frame is cut short"
        found.append((first, data[at : at + size]))
        at += size
    return found
