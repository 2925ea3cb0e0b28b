"""Live fragmented MP4 with H.264: a header, then one fragment for each frame.

ISO/IEC 14496-12 (boxes and fragments) and 14496-15 (H.264 in them). :mod:`rwt.media.encoders.webm` gives the
reason for a writer of our own.
"""

from __future__ import annotations

import re
import struct
from typing import Final

_TIMESCALE: Final = 1000
_IDENTITY: Final = struct.pack(">9I", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)
#: Flags of a sample: independent; dependent on others and not a sync sample (8.8.3.1).
_KEY_SAMPLE, _OTHER_SAMPLE = 0x02000000, 0x01010000
#: How long a frame lasts until it is known when the next one comes, milliseconds.
_GUESSED_DURATION: Final = 33
_START_CODE: Final = re.compile(rb"\x00*\x00\x00\x01")
_SPS, _PPS = 7, 8


class Mp4:
    """Writer of one viewer's stream; its time starts at 0.

    Args:
        parameters: sequence and frame parameter sets, each after a start code.
    """

    def __init__(self, width: int, height: int, parameters: bytes) -> None:
        self._width = width
        self._height = height
        self._units = units(parameters)
        self._sequence = 0
        self._last_ms: int | None = None

    def header(self) -> bytes:
        """Return the bytes before the first frame."""
        ftyp = _box(b"ftyp", b"iso5", struct.pack(">I", 512), b"iso5", b"iso6", b"mp41")
        trex = _box(b"trex", _version(0), struct.pack(">5I", 1, 1, 0, 0, 0))
        moov = _box(b"moov", self._mvhd(), self._trak(), _box(b"mvex", trex))
        return ftyp + moov

    def frame(self, data: bytes, at_ms: int, *, key: bool) -> bytes:
        """Return a fragment with one frame; `data` has units after start codes."""
        self._sequence += 1
        duration = _GUESSED_DURATION if self._last_ms is None else max(1, at_ms - self._last_ms)
        self._last_ms = at_ms
        sample = b"".join(struct.pack(">I", len(unit)) + unit for unit in units(data))
        mfhd = _box(b"mfhd", _version(0), struct.pack(">I", self._sequence))
        tfhd = _box(b"tfhd", _version(0, 0x020000), struct.pack(">I", 1))  # offsets are relative to the moof
        tfdt = _box(b"tfdt", _version(1), struct.pack(">Q", at_ms))
        flags = _KEY_SAMPLE if key else _OTHER_SAMPLE

        def moof(offset: int) -> bytes:
            # Present: the data's offset, and duration, size and flags of each sample.
            fields = struct.pack(">Ii3I", 1, offset, duration, len(sample), flags)
            return _box(b"moof", mfhd, _box(b"traf", tfhd, tfdt, _box(b"trun", _version(0, 0x701), fields)))

        return moof(len(moof(0)) + 8) + _box(b"mdat", sample)

    def _mvhd(self) -> bytes:
        times = struct.pack(">4I", 0, 0, _TIMESCALE, 0)
        rate_and_volume = struct.pack(">IH10x", 0x10000, 0x100)
        return _box(b"mvhd", _version(0), times, rate_and_volume, _IDENTITY, bytes(24), struct.pack(">I", 2))

    def _trak(self) -> bytes:
        size = struct.pack(">2I", self._width << 16, self._height << 16)
        tkhd = _box(b"tkhd", _version(0, 3), struct.pack(">5I16x", 0, 0, 1, 0, 0), _IDENTITY, size)
        mdhd = _box(b"mdhd", _version(0), struct.pack(">4I2H", 0, 0, _TIMESCALE, 0, 0x55C4, 0))
        hdlr = _box(b"hdlr", _version(0), struct.pack(">I4s12x", 0, b"vide"), b"video\0")
        dref = _box(b"dref", _version(0), struct.pack(">I", 1), _box(b"url ", _version(0, 1)))
        minf = _box(
            b"minf", _box(b"vmhd", _version(0, 1), bytes(8)), _box(b"dinf", dref), self._sample_table()
        )
        return _box(b"trak", tkhd, _box(b"mdia", mdhd, hdlr, minf))

    def _sample_table(self) -> bytes:
        entry = struct.pack(">6xH16x2H2II", 1, self._width, self._height, 0x480000, 0x480000, 0)
        avc1 = _box(b"avc1", entry, struct.pack(">H32xHh", 1, 24, -1), self._avc_configuration())
        stsd = _box(b"stsd", _version(0), struct.pack(">I", 1), avc1)
        empty = [_box(name, _version(0), bytes(4)) for name in (b"stts", b"stsc", b"stco")]
        return _box(b"stbl", stsd, *empty, _box(b"stsz", _version(0), bytes(8)))

    def _avc_configuration(self) -> bytes:
        """`avcC` (14496-15, 5.3.3.1): profile and level, lengths of four bytes, the parameter sets."""
        sps = [unit for unit in self._units if unit[0] & 31 == _SPS]
        pps = [unit for unit in self._units if unit[0] & 31 == _PPS]
        return _box(
            b"avcC",
            bytes((1, *sps[0][1:4], 0xFF, 0xE0 | len(sps))),
            *(struct.pack(">H", len(unit)) + unit for unit in sps),
            bytes((len(pps),)),
            *(struct.pack(">H", len(unit)) + unit for unit in pps),
        )


def units(stream: bytes) -> list[bytes]:
    """Split a byte stream into units without start codes (H.264 annex B)."""
    return [unit for unit in _START_CODE.split(stream) if unit]


def _box(name: bytes, *parts: bytes) -> bytes:
    payload = b"".join(parts)
    return struct.pack(">I4s", len(payload) + 8, name) + payload


def _version(version: int, flags: int = 0) -> bytes:
    return struct.pack(">I", version << 24 | flags)
