"""Order of responses that take long to encode."""

from __future__ import annotations

import logging

import pytest

from rwt.delivery.fanout import Fanout
from rwt.delivery.shared_graph import SharedGraph
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_protocol.dispatcher import Steps
from rwt_transports.scheduler import SAMPLES


class SlowClock(SimulatedClock):
    """Each look at it takes some of a turn."""

    def __init__(self) -> None:
        super().__init__()
        self.looks = 0

    def monotonic(self) -> float:
        self.looks += 1
        return super().monotonic() + self.looks * SAMPLES.share / 3


def _fanout(clock: SimulatedClock) -> Fanout:
    graph = MemoryGraph(clock=clock)
    shared = SharedGraph(graph, "/gateway", 0.0, lambda line: None)
    return shared.fanout("/topic", graph.registry.message("std_msgs/String"))


def _steps(count: int) -> Steps:
    for _ in range(count):
        yield


def test_whoever_caused_it_may_take_the_steps() -> None:
    clock, sent = SlowClock(), list[int]()
    late = _fanout(clock).late
    late.add(_steps(30), lambda: sent.append(1))
    own = late.steps()
    next(own)
    late.add(_steps(30), lambda: sent.append(2))
    for _ in own:
        pass
    assert sent == [1], "what came later is not theirs"


def test_what_is_asked_for_while_something_is_sent_comes_behind_it() -> None:
    clock, sent = SlowClock(), list[int]()
    late = _fanout(clock).late

    def first() -> None:
        sent.append(1)
        late.add(_steps(0), lambda: sent.append(3))

    late.add(_steps(30), first)
    late.add(_steps(0), lambda: sent.append(2))
    late.finish_first()
    assert sent == [1]
    while late.waiting:
        clock.advance(0.0)
    assert sent == [1, 2, 3]


def test_what_fails_is_logged_and_passed_over(caplog: pytest.LogCaptureFixture) -> None:
    def failing() -> Steps:
        yield
        raise ValueError("no")

    sent: list[int] = []
    late = _fanout(SimulatedClock()).late
    with caplog.at_level(logging.ERROR):
        late.add(failing(), lambda: sent.append(1))
    late.add(_steps(1), lambda: sent.append(2))
    assert sent == [2]
    assert "a sample could not be sent" in caplog.text
