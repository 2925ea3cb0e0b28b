"""Quality of single images by their delivery time."""

from __future__ import annotations

from rwt.extensions.video.responses import RUNGS, QualityLadder
from rwt.media.stream_request import read_request


def deliver(ladder: QualityLadder, seconds: float, begin: float, duration: float) -> list[int]:
    """Rungs while each image takes so long."""
    rungs = []
    for step in range(round(duration * 10)):
        ladder.delivered(seconds, begin + step / 10)
        rungs.append(ladder.rung)
    return rungs


def test_slow_images_become_smaller_and_fast_ones_better_again() -> None:
    ladder = QualityLadder(read_request("topic=/a"), 0.0)
    assert ladder.request.coding == RUNGS[0]
    assert deliver(ladder, 0.3, 0.0, 1.0)[-1] == len(RUNGS) - 1
    assert deliver(ladder, 0.1, 1.0, 20.0)[-1] == len(RUNGS) - 1
    assert deliver(ladder, 0.02, 21.0, 40.0)[-1] == 0


def test_very_slow_images_skip_a_rung() -> None:
    ladder = QualityLadder(read_request("topic=/a"), 0.0)
    ladder.delivered(2.0, 1.0)
    assert ladder.rung == 2


def test_a_better_quality_that_was_too_slow_is_tried_less_and_less_often() -> None:
    ladder, tries, now = QualityLadder(read_request("topic=/a"), 0.0), 0, 100.0
    ladder.delivered(0.3, now)
    for _ in range(3000):
        now += 0.1
        before = ladder.rung
        ladder.delivered(0.3 if ladder.rung == 0 else 0.02, now)
        tries += ladder.rung < before
    assert 5 <= tries <= 20


def test_a_quality_or_size_that_was_requested_is_kept() -> None:
    for query in ("quality=80", "width=320", "type=png", "type=ros_compressed"):
        ladder = QualityLadder(read_request(f"topic=/a&{query}"), 0.0)
        request = ladder.request
        deliver(ladder, 1.0, 0.0, 1.0)
        assert ladder.request == request
