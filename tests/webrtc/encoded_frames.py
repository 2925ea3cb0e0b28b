"""Encoded images, and headers that claim some size."""

from __future__ import annotations

from fractions import Fraction

import av
import numpy as np


def vp8_header(width: int, height: int) -> bytes:
    """Return the header of a key frame and some bytes."""
    sizes = width.to_bytes(2, "little") + height.to_bytes(2, "little")
    return b"\x10\0\0\x9d\x01\x2a" + sizes + bytes(40)


def encoded(codec: str, width: int, height: int, **options: str) -> list[bytes]:
    encoder = av.CodecContext.create(codec, "w")
    assert isinstance(encoder, av.VideoCodecContext)
    encoder.width, encoder.height, encoder.pix_fmt = width, height, "yuv420p"
    encoder.time_base, encoder.options = Fraction(1, 30), options
    frames: list[av.VideoFrame | None] = []
    for number in range(3):
        frame = av.VideoFrame.from_ndarray(np.zeros((height, width, 3), np.uint8), "rgb24")
        frame.pts = number
        frames.append(frame)
    return [bytes(packet) for frame in (*frames, None) for packet in encoder.encode(frame)]


def bits(*codes: int | str) -> bytes:
    """Return bits: numbers as exponential-Golomb codes, texts as they are."""
    text = "".join(
        each if isinstance(each, str) else "0" * ((each + 1).bit_length() - 1) + f"{each + 1:b}"
        for each in codes
    )
    text += "1" + "0" * (-(len(text) + 1) % 8)
    return bytes(int(text[at : at + 8], 2) for at in range(0, len(text), 8))


def sequence_parameters(width: int, height: int, references: int = 1) -> bytes:
    """Return a sequence parameter set; sizes in macroblocks."""
    return b"\0\0\0\1\x67\x42\0\x34" + bits(0, 0, 0, 0, references, "0", width - 1, height - 1, "1")
