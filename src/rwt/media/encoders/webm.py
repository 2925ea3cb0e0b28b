"""Live WebM: a header, then one block for each frame (RFC 8794, RFC 9559).

The writers of the libraries delay each frame until the next one, and do not support viewers that join late;
with a slow camera either would cost a second of delay. This module writes the small part of the format that a
live stream of one track needs.
"""

from __future__ import annotations

from importlib.metadata import version
from typing import Final

from rwt.media.encoders import colours

_UNKNOWN_SIZE: Final = b"\x01\xff\xff\xff\xff\xff\xff\xff"
#: Maximum length of a cluster, in milliseconds: times of blocks are relative to it, in 16 signed bits.
_MAX_CLUSTER_MS: Final = 30_000
_CODECS: Final = {"vp8": b"V_VP8", "vp9": b"V_VP9"}


class Webm:
    """Writer of one viewer's stream; its time starts at 0.

    Args:
        codec: `vp8` or `vp9`.
    """

    def __init__(self, codec: str, width: int, height: int) -> None:
        self._codec = _CODECS[codec]
        self._width = width
        self._height = height
        self._cluster_ms: int | None = None

    def header(self) -> bytes:
        """Return the bytes before the first frame."""
        app = f"robot-web-tools {version('robot-web-tools')}".encode()
        ebml = (
            _number(0x4286, 1)  # EBMLVersion
            + _number(0x42F7, 1)  # EBMLReadVersion
            + _number(0x42F2, 4)  # EBMLMaxIDLength
            + _number(0x42F3, 8)  # EBMLMaxSizeLength
            + _element(0x4282, b"webm")  # DocType
            + _number(0x4287, 4)  # DocTypeVersion: 4 has colours
            + _number(0x4285, 2)  # DocTypeReadVersion
        )
        info = _number(0x2AD7B1, 1_000_000) + _element(0x4D80, app) + _element(0x5741, app)
        segment = _id(0x18538067) + _UNKNOWN_SIZE
        return _element(0x1A45DFA3, ebml) + segment + _element(0x1549A966, info) + self._tracks()

    def _tracks(self) -> bytes:
        colour = (
            _number(0x55B1, colours.MATRIX)
            + _number(0x55B9, colours.RANGE)
            + _number(0x55BA, colours.TRANSFER)
            + _number(0x55BB, colours.PRIMARIES)
        )
        video = _number(0xB0, self._width) + _number(0xBA, self._height) + _element(0x55B0, colour)
        track = (
            _number(0xD7, 1)  # TrackNumber
            + _number(0x73C5, 1)  # TrackUID
            + _number(0x83, 1)  # TrackType: video
            + _number(0x9C, 0)  # FlagLacing
            # DefaultDuration, a guess: players that do not know it read dozens of frames before they begin.
            + _number(0x23E383, 33_333_333)
            + _element(0x86, self._codec)
            + _element(0xE0, video)
        )
        return _element(0x1654AE6B, _element(0xAE, track))

    def frame(self, data: bytes, at_ms: int, *, key: bool) -> bytes:
        """Return a block with one frame; a key frame begins a cluster."""
        opening = b""
        if key or self._cluster_ms is None or at_ms - self._cluster_ms > _MAX_CLUSTER_MS:
            self._cluster_ms = at_ms
            opening = _id(0x1F43B675) + _UNKNOWN_SIZE + _number(0xE7, at_ms)
        after = (at_ms - self._cluster_ms).to_bytes(2, "big", signed=True)
        flags = b"\x80" if key else b"\x00"
        return opening + _element(0xA3, b"\x81" + after + flags + data)


def _id(number: int) -> bytes:
    """Return the ID of an element; its first bits encode its length."""
    return number.to_bytes((number.bit_length() + 7) // 8, "big")


def _element(number: int, payload: bytes) -> bytes:
    # Sizes of four bytes: 28 bits are more than any frame.
    return _id(number) + (len(payload) | 0x1000_0000).to_bytes(4, "big") + payload


def _number(number: int, value: int) -> bytes:
    return _element(number, value.to_bytes(max(1, (value.bit_length() + 7) // 8), "big"))
