"""Parser of transport-wide feedback."""

from __future__ import annotations

import random
from contextlib import suppress
from struct import pack

import pytest

from rwt_webrtc.congestion.feedback import Feedback, read_feedback
from rwt_webrtc.packets.rtp import BadMedia, split_rtcp


def message(base: int, count: int, rest: bytes, *, padding: int = 0) -> bytes:
    """A message of a receiver; `rest` holds statuses and times."""
    rest += bytes(-len(rest) % 4)
    if padding:
        rest += bytes(padding - 1) + bytes([padding])
    body = pack("!IIHHI", 1, 2, base, count, 1000 << 8 | 7) + rest
    return pack("!BBH", 0x8F | (0x20 if padding else 0), 205, len(body) // 4) + body


def test_each_kind_of_chunk() -> None:
    # A run of 3 small times, 14 statuses of one bit of which 2 have arrived, 7 of two bits with a large one.
    chunks = pack("!HHH", 1 << 13 | 3, 0x8000 | 0b10000000000001, 0xC000 | 0b10_01_00_00_00_00_00)
    times = bytes([4, 8, 0, 4, 4]) + pack("!h", -8) + bytes([40])
    read = read_feedback(message(65534, 24, chunks + times))
    assert (read.base, read.reference) == (65534, 1000)
    arrived = {number: at for number, at in enumerate(read.arrivals) if at is not None}
    expected = {0: 4, 1: 12, 2: 12, 3: 16, 16: 20, 17: 12, 18: 52}
    assert arrived == {number: pytest.approx(ticks * 250e-6) for number, ticks in expected.items()}
    assert len(read.arrivals) == 24


def test_padding_is_no_part_of_the_times() -> None:
    assert read_feedback(message(1, 1, pack("!HB", 1 << 13 | 1, 4), padding=4)) == Feedback(1, 1000, (0.001,))


@pytest.mark.parametrize(
    ("count", "rest", "why"),
    [
        (0, b"", "about 0 packets"),
        (2049, pack("!H", 2049), "about 2049 packets"),
        (20, pack("!H", 5), "ends in its statuses"),
        (7, pack("!H", 1 << 13 | 7), "ends in its times"),
        (3, pack("!H", 3 << 13 | 3), "reserved status"),
    ],
)
def test_invalid_messages(count: int, rest: bytes, why: str) -> None:
    with pytest.raises(BadMedia, match=why):
        read_feedback(message(1, count, rest))


def test_any_bytes_are_read_or_rejected() -> None:
    rng = random.Random(1)
    for _ in range(3000):
        data = bytes([0x8F | rng.choice((0, 0x20)), 205, 0, 0]) + rng.randbytes(4 * rng.randrange(2, 30))
        with suppress(BadMedia):
            assert 0 < len(read_feedback(data).arrivals) <= 2048


def test_feedback_is_taken_out_of_a_compound_packet() -> None:
    feedback = message(1, 1, pack("!HB", 1 << 13 | 1, 4))
    report = pack("!BBHI", 0x80, 201, 1, 5)
    nack = pack("!BBHIIHH", 0x81, 205, 3, 1, 2, 3, 0)
    data = report + feedback + nack + feedback
    assert split_rtcp(data) == (report + nack, [feedback, feedback])
