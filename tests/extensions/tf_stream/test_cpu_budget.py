"""Limit on the event loop's time for streams."""

from __future__ import annotations

from itertools import count

import pytest

from rwt.extensions.tf_stream.streams import CPU_FRACTION, CpuBudget
from tests.extensions.tf_stream.conftest import Asking, Lab


class Worker:
    """Work that takes its time: of the processor, and of the clock as well."""

    def __init__(self) -> None:
        self.now = 0.0
        self.worked = 0.0
        self.turns = 0

    def work(self, seconds: float) -> None:
        self.turns += 1
        self.worked += seconds
        self.now += seconds


def ticks(seconds: float, turn: float, *, streams: int = 1, period: float = 0.01) -> Worker:
    """A stream that ticks for some seconds, each turn of which takes so long."""
    worker = Worker()
    budget = CpuBudget(lambda: worker.now, lambda: streams, lambda: worker.worked)
    while worker.now < seconds:
        budget.turn(lambda: worker.work(turn))
        worker.now += period
    return worker


@pytest.mark.parametrize(("turn", "streams"), [(0.1, 1), (0.02, 1), (0.01, 10), (1.0, 2)])
def test_streams_keep_to_their_share(turn: float, streams: int) -> None:
    worker = ticks(2000.0 * turn * streams, turn, streams=streams)
    assert worker.turns > 1
    assert worker.worked / worker.now <= CPU_FRACTION / streams * 1.1


def test_a_stream_that_takes_little_does_not_rest() -> None:
    assert ticks(1.0, 0.0001).turns == pytest.approx(100, abs=2)


def test_one_turn_that_was_held_up_hardly_counts() -> None:
    worker = Worker()
    budget = CpuBudget(lambda: worker.now, lambda: 1, lambda: worker.worked)
    budget.turn(lambda: worker.work(0.1))
    worker.now += 0.1
    budget.turn(lambda: worker.work(0.0))
    assert worker.turns == 2


@pytest.mark.anyio
async def test_a_goal_for_a_thousand_frames_a_hundred_times_a_second_rests(
    lab: Lab, page: Asking, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[object] = []

    def due(filter_: object, buffer: object, now_ns: int) -> list[object]:
        asked.append(filter_)
        return []

    monkeypatch.setattr("rwt.extensions.tf_stream.transform_filters.TargetFrameFilter.due", due)
    seconds = map(float, count())
    monkeypatch.setattr(CpuBudget.__init__, "__defaults__", (lambda: next(seconds),))
    frames = [f"f{number}" for number in range(1000)]
    await page.send_goal(
        {
            "source_frames": frames,
            "target_frame": "map",
            "angular_thres": 0.0,
            "trans_thres": 0.0,
            "rate": 100.0,
        }
    )
    await lab.pass_time(2.0)
    assert 0 < len(asked) < 5
