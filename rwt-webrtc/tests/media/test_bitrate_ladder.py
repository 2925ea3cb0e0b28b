"""Encodings of the bitrate ladder."""

from __future__ import annotations

from rwt_webrtc.media.video_track import BAN_SECONDS, LEVELS, BitrateLadder

BEST = 1_500_000


def choose(ladder: BitrateLadder, rate: float, begin: float, seconds: float) -> list[int]:
    """Rungs at a rate, ten times a second."""
    rungs = []
    for step in range(round(10 * seconds)):
        ladder.choose(rate, begin + step / 10)
        rungs.append(ladder.level)
    return rungs


def test_a_lower_rate_steps_down_at_once_to_an_encoding_that_fits() -> None:
    for rate, level in ((BEST, 0), (700_000, 0), (500_000, 1), (200_000, 2), (10_000, 2)):
        ladder = BitrateLadder(BEST)
        ladder.choose(rate, 0.0)
        assert ladder.level == level
        assert ladder.bitrate(rate) == min(rate, BEST * LEVELS[level])


def test_a_higher_rate_steps_up_one_by_one() -> None:
    ladder = BitrateLadder(BEST)
    ladder.choose(100_000, 0.0)
    assert choose(ladder, BEST, 1.0, 5.0)[::10] == [2, 1, 1, 0, 0]


def test_a_rate_around_a_limit_does_not_alternate() -> None:
    ladder = BitrateLadder(BEST)
    ladder.choose(500_000, 0.0)
    rungs = [choose(ladder, rate, at, 1.0)[-1] for at, rate in enumerate((560_000, 640_000) * 20)]
    assert set(rungs) == {1}


def test_requests_for_key_frames_step_down_for_a_while() -> None:
    ladder = BitrateLadder(BEST)
    for at in range(6):
        ladder.asked_for_key(float(at))
    assert ladder.level == 1
    assert set(choose(ladder, BEST, 6.0, BAN_SECONDS - 2)) == {1}
    assert choose(ladder, BEST, 6.0 + BAN_SECONDS, 3.0)[-1] == 0


def test_repeated_requests_count_once() -> None:
    ladder = BitrateLadder(BEST)
    for step in range(10):
        ladder.asked_for_key(step / 10)
    assert ladder.level == 0
