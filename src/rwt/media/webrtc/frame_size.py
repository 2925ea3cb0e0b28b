"""Size of encoded images, read from their headers before a decoder allocates memory for it."""

from __future__ import annotations

from typing import Final

from rwt_transports.errors import TransportError

MAX_MACROBLOCKS: Final = 184_320
"""Macroblocks of all reference images of an H.264 stream: MaxDpbMbs of level 5.2 (H.264 table A-1)."""
MAX_UNITS: Final = 1024
"""NAL units of a frame; encoders make at most some dozens."""
MAX_PARAMETER_SETS: Final = 4
"""Sequence parameter sets of a frame."""

_SPS: Final = 7
_CHROMA_PROFILES: Final = frozenset({44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 244})
_SPS_BYTES: Final = 512


class BadFrame(TransportError):
    """The header of an encoded image is invalid."""


def vp8_area(data: bytes) -> int:
    """Return the number of pixels of a VP8 frame (RFC 6386 section 9.1); 0 for an interframe.

    Raises:
        BadFrame: a key frame has no valid header.
    """
    if not data or data[0] & 1:
        return 0
    if len(data) < 10 or data[3:6] != b"\x9d\x01\x2a":
        raise BadFrame("a VP8 key frame without a start code")
    width = int.from_bytes(data[6:8], "little") & 0x3FFF
    height = int.from_bytes(data[8:10], "little") & 0x3FFF
    return width * height


def h264_area(data: bytes) -> int:
    """Return the largest number of pixels that the parameter sets of an H.264 frame name; 0 without a set.

    Raises:
        BadFrame: a set is invalid, or its reference images need more memory than a stream of level 5.2.
    """
    largest, count, units = 0, 0, 0
    at = data.find(b"\0\0\1")
    while at >= 0:
        units += 1
        if units > MAX_UNITS:
            raise BadFrame(f"a frame with more than {MAX_UNITS} units")
        following = data.find(b"\0\0\1", at + 3)
        if at + 3 < len(data) and data[at + 3] & 0x1F == _SPS:
            count += 1
            if count > MAX_PARAMETER_SETS:
                raise BadFrame(f"a frame with more than {MAX_PARAMETER_SETS} sequence parameter sets")
            unit = data[at + 4 : following if following >= 0 else len(data)]
            largest = max(largest, _sps_area(unit[:_SPS_BYTES]))
        at = following
    return largest


class _Bits:
    def __init__(self, data: bytes) -> None:
        plain = data.replace(b"\0\0\3", b"\0\0")  # Without emulation prevention.
        self._value, self._left = int.from_bytes(plain, "big"), 8 * len(plain)

    def take(self, count: int) -> int:
        if count > self._left:
            raise BadFrame("a sequence parameter set that ends early")
        self._left -= count
        return (self._value >> self._left) & ((1 << count) - 1)

    def unsigned(self) -> int:
        """Exponential-Golomb code (H.264 section 9.1)."""
        zeros = 0
        while not self.take(1):
            zeros += 1
            if zeros > 32:
                raise BadFrame("a sequence parameter set with a number beyond 32 bits")
        return (1 << zeros) - 1 + self.take(zeros)

    def signed(self) -> int:
        code = self.unsigned()
        return (code + 1) // 2 if code & 1 else -(code // 2)


def _sps_area(data: bytes) -> int:
    """Return the pixels of a sequence parameter set (H.264 section 7.3.2.1.1)."""
    bits = _Bits(data)
    profile = bits.take(8)
    bits.take(16)
    bits.unsigned()
    if profile in _CHROMA_PROFILES:
        _skip_chroma(bits)
    bits.unsigned()
    order = bits.unsigned()
    if order == 0:
        bits.unsigned()
    elif order == 1:
        bits.take(1)
        bits.signed()
        bits.signed()
        cycle = bits.unsigned()
        if cycle > 255:
            raise BadFrame("a sequence parameter set with a long cycle")
        for _ in range(cycle):
            bits.signed()
    references = bits.unsigned()
    bits.take(1)
    width, height = bits.unsigned() + 1, bits.unsigned() + 1
    fields = 1 if bits.take(1) else 2
    blocks = width * height * fields
    if references > 16 or (references + 1) * blocks > MAX_MACROBLOCKS:
        raise BadFrame(f"{references} reference images of {16 * width} x {16 * height * fields}")
    return 256 * blocks


def _skip_chroma(bits: _Bits) -> None:
    chroma = bits.unsigned()
    if chroma == 3:
        bits.take(1)
    bits.unsigned()
    bits.unsigned()
    bits.take(1)
    if not bits.take(1):
        return
    for number in range(12 if chroma == 3 else 8):
        if bits.take(1):
            last = following = 8
            for _ in range(16 if number < 6 else 64):
                if following:
                    following = (last + bits.signed()) % 256
                last = following or last
