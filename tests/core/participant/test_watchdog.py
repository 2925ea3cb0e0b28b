"""Watchdogs for commands, and the timers below them."""

from __future__ import annotations

import logging
from functools import partial

import anyio
import anyio.lowlevel
import pytest

from rwt import Server, Watchdog
from rwt_client.blocking import connect
from rwt_graph import MemoryGraph, Node, SimulatedClock


class Base:
    """A base that drives as long as it is told to."""

    def __init__(self) -> None:
        self.clock = SimulatedClock()
        self.node = Node(MemoryGraph(clock=self.clock), "base")
        self.stopped: list[float] = []

    def stop(self) -> None:
        self.stopped.append(self.clock.monotonic())


@pytest.fixture
def base() -> Base:
    return Base()


def test_nothing_is_stopped_that_never_moved(base: Base) -> None:
    watchdog = Watchdog(base.node, 0.5, base.stop)
    base.clock.advance(10.0)
    assert (base.stopped, watchdog.running) == ([], False)


def test_it_stops_once_and_exactly_that_long_after_the_last_command(base: Base) -> None:
    watchdog = Watchdog(base.node, 0.5, base.stop)
    for _ in range(20):
        base.clock.advance(0.3)
        watchdog.feed()
    assert (base.stopped, watchdog.running) == ([], True)
    base.clock.advance(0.49)
    assert base.stopped == []
    base.clock.advance(10.0)
    assert base.stopped == [pytest.approx(6.5)]
    assert not watchdog.running


def test_the_next_command_lets_it_watch_again(base: Base) -> None:
    watchdog = Watchdog(base.node, 0.5, base.stop)
    watchdog.feed()
    base.clock.advance(7.2)
    watchdog.feed()
    base.clock.advance(7.2)
    assert base.stopped == [pytest.approx(0.5), pytest.approx(7.7)]


def test_a_stop_that_fails_is_tried_again(base: Base, caplog: pytest.LogCaptureFixture) -> None:
    def fail_twice() -> None:
        base.stop()
        if len(base.stopped) < 3:
            raise OSError("the bus is busy")

    Watchdog(base.node, 0.5, fail_twice).feed()
    with caplog.at_level(logging.ERROR):
        base.clock.advance(10.0)
    assert base.stopped == [pytest.approx(0.5), pytest.approx(1.0), pytest.approx(1.5)]
    assert caplog.text.count("OSError: the bus is busy") == 2


def test_the_end_of_the_block_stops_whatever_has_come(base: Base) -> None:
    with pytest.raises(ZeroDivisionError), Watchdog(base.node, 0.5, base.stop) as watchdog:
        watchdog.feed()
        raise ZeroDivisionError
    base.clock.advance(10.0)
    assert base.stopped == [0.0]


def test_a_closed_one_does_nothing(base: Base) -> None:
    watchdog = Watchdog(base.node, 0.5, base.stop)
    watchdog.feed()
    watchdog.close()
    watchdog.close()
    base.clock.advance(10.0)
    assert base.stopped == []


@pytest.mark.parametrize("stop", [None, "stop", anyio.sleep_forever])
def test_only_a_plain_function_can_stop(base: Base, stop: object) -> None:
    with pytest.raises(TypeError, match="a watchdog's stop is a plain function, got"):
        Watchdog(base.node, 0.5, stop)  # type: ignore[arg-type]  # the mistake under test


@pytest.mark.parametrize("timeout", [0.0, -1.0, float("nan"), float("inf")])
def test_a_timeout_is_a_length_of_time(base: Base, timeout: float) -> None:
    with pytest.raises(ValueError, match="a timer's period is from"):
        Watchdog(base.node, timeout, base.stop)


@pytest.mark.anyio
async def test_fed_from_a_drivers_thread() -> None:
    clock = SimulatedClock()
    stopped: list[float] = []
    async with MemoryGraph(clock=clock) as graph:
        watchdog = Watchdog(graph.node("base"), 0.5, lambda: stopped.append(clock.monotonic()))
        clock.advance(0.4)
        await anyio.to_thread.run_sync(watchdog.feed)
        await anyio.lowlevel.checkpoint()
        clock.advance(0.4)
        assert stopped == []
        clock.advance(0.4)
    assert stopped == [pytest.approx(0.9)]


def test_blocking_with_a_clock_that_a_test_moves() -> None:
    clock = SimulatedClock()
    stopped: list[float] = []
    with (
        Server("ws://127.0.0.1:0", clock=clock) as robot,
        Watchdog(robot, 0.5, lambda: stopped.append(clock.monotonic())) as watchdog,
    ):
        robot.subscribe("/cmd_vel", lambda twist: watchdog.feed(), "geometry_msgs/Twist")
        robot.publish("/cmd_vel", {"linear": {"x": 0.2}}, "geometry_msgs/Twist")
        robot.node.run(partial(clock.advance, 2.0))
        assert stopped == [pytest.approx(0.5)]
    assert stopped == [pytest.approx(0.5), pytest.approx(2.0)]


def test_a_reset_timer_keeps_its_new_grid(base: Base) -> None:
    calls: list[float] = []
    timer = base.node.create_timer(1.0, lambda: calls.append(base.clock.monotonic()))
    base.clock.advance(1.7)
    timer.reset()
    base.clock.advance(3.5)
    assert calls == [pytest.approx(1.0), pytest.approx(2.7), pytest.approx(3.7), pytest.approx(4.7)]
    timer.cancel()
    timer.reset()
    base.clock.advance(3.0)
    assert len(calls) == 4


def test_timers_of_a_client_end_with_its_connection() -> None:
    calls: list[int] = []
    with Server("ws://127.0.0.1:0") as robot, connect(robot.server.urls[0]) as client:
        heard = client.topic("/ticks", "std_msgs/Int32")

        async def tick() -> None:
            calls.append(len(calls))
            await anyio.lowlevel.checkpoint()
            client._inner.publish("/ticks", {"data": len(calls)}, "std_msgs/Int32")

        timer = client.create_timer(0.001, tick)
        assert [heard.get(timeout=10).data for _ in range(3)] == [1, 2, 3]
        timer.cancel()
        client.run(anyio.sleep, 0)
        count = len(calls)
        client.create_timer(3600.0, lambda: calls.append(0))
    assert len(calls) == count
