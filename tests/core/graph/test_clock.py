from __future__ import annotations

import time
from functools import partial

import anyio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_graph.clock import (
    COMPACT_AT,
    END_OF_TIME_NS,
    HeapTimer,
    SimulatedClock,
    SteadyClock,
    TimerHeap,
    WallClock,
)
from rwt_participant.timers import Timer
from tests.held import held


def test_simulated_timers_run_in_order_each_at_its_own_time() -> None:
    clock = SimulatedClock(start_ns=5)
    ran: list[tuple[str, int]] = []

    def note(name: str) -> None:
        ran.append((name, clock.time_ns()))

    for name, delay in (("c", 0.3), ("a", 0.1), ("b", 0.1), ("late", 2.0)):
        clock.call_later(delay, partial(note, name))
    clock.advance(1)
    assert ran == [("a", 100_000_005), ("b", 100_000_005), ("c", 300_000_005)]
    assert clock.time_ns() == 1_000_000_005
    assert clock.monotonic() == 1.0
    clock.advance(1)
    assert ran[-1] == ("late", 2_000_000_005)


def test_a_timer_made_by_a_timer_runs_in_the_same_advance_when_it_is_due() -> None:
    clock = SimulatedClock()
    ran: list[float] = []

    def again() -> None:
        ran.append(clock.monotonic())
        clock.call_later(0.25, again)

    clock.call_later(0.25, again)
    clock.advance(1)
    assert ran == [0.25, 0.5, 0.75, 1.0]


def test_a_cancelled_timer_does_not_run() -> None:
    clock = SimulatedClock()
    ran: list[int] = []
    timers = [clock.call_later(0.1, partial(ran.append, n)) for n in range(3)]
    timers[1].cancel()
    timers[1].cancel()
    clock.advance(1)
    timers[0].cancel()
    assert ran == [0, 2]


def test_a_timer_that_raises_is_logged_and_time_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    clock = SimulatedClock()
    ran: list[int] = []

    def fail() -> None:
        raise ZeroDivisionError

    clock.call_later(0.1, fail)
    clock.call_later(0.2, lambda: ran.append(1))
    clock.advance(1)
    assert ran == [1]
    assert "ZeroDivisionError" in caplog.text


def test_ros_time_may_go_back_but_steady_time_does_not() -> None:
    clock = SimulatedClock(start_ns=10_000_000_000)
    heard: list[int] = []
    ran: list[float] = []
    clock.listeners.append(heard.append)
    clock.call_later(2, lambda: ran.append(clock.monotonic()))
    clock.set_time(11_000_000_000)
    clock.set_time(3_000_000_000)
    assert clock.time_ns() == 3_000_000_000
    assert clock.monotonic() == 1.0
    clock.set_time(4_000_000_000)
    assert heard == [11_000_000_000, 3_000_000_000, 4_000_000_000]
    assert ran == [2.0]
    with pytest.raises(ValueError, match="set_time"):
        clock.advance(-1)


@given(st.integers(0, END_OF_TIME_NS - 1))
def test_set_time_is_exact(target: int) -> None:
    clock = SimulatedClock()
    clock.set_time(target)
    assert clock.time_ns() == target


def test_a_heap_full_of_cancelled_timers_is_rebuilt() -> None:
    heap = TimerHeap()
    timers = [heap.push(float(n), lambda: None) for n in range(4 * COMPACT_AT)]
    for timer in timers[: 3 * COMPACT_AT]:
        timer.cancel()
    assert len(heap) == COMPACT_AT
    assert held(heap, kind=HeapTimer) < 2 * COMPACT_AT + 1
    assert heap.next_due() == 3 * COMPACT_AT


@given(st.lists(st.tuples(st.floats(0, 100), st.booleans())))
def test_a_heap_runs_what_was_not_cancelled_by_time_then_by_age(plan: list[tuple[float, bool]]) -> None:
    heap = TimerHeap()
    ran: list[int] = []
    timers = [heap.push(due, partial(ran.append, n)) for n, (due, _) in enumerate(plan)]
    for timer, (_, cancel) in zip(timers, plan, strict=True):
        if cancel:
            timer.cancel()
    while heap.next_due() < 1000:
        heap.run_next()
    kept = [n for n, (_, cancel) in enumerate(plan) if not cancel]
    assert ran == sorted(kept, key=lambda n: (plan[n][0], n))
    assert len(heap) == 0


def test_wall_and_steady_time() -> None:
    assert abs(WallClock().time_ns() - time.time_ns()) < 10**9
    steady = SteadyClock()
    assert abs(steady.time_ns() - time.time_ns()) < 10**9
    assert steady.time_ns() <= steady.time_ns()


@pytest.mark.anyio
@pytest.mark.parametrize("kind", [WallClock, SteadyClock])
async def test_one_task_drives_all_timers_of_a_real_clock(kind: type[SteadyClock]) -> None:
    clock = kind()
    ran: list[str] = []
    done = anyio.Event()
    early: list[Timer] = []

    def first() -> None:
        ran.append("first")
        early.append(clock.call_later(0, lambda: ran.append("from a timer")))

    clock.call_later(30, lambda: ran.append("never"))
    clock.call_later(-1, first)
    async with anyio.create_task_group() as group:
        group.start_soon(clock.drive)
        await anyio.wait_all_tasks_blocked()
        # The task now sleeps until the timer of 30 s; these must wake it.
        clock.call_later(0.002, done.set)
        clock.call_later(0.001, lambda: ran.append("second"))
        await done.wait()
        group.cancel_scope.cancel()
    assert ran == ["first", "from a timer", "second"]


@pytest.mark.anyio
async def test_sleeping_on_simulated_time() -> None:
    clock = SimulatedClock()
    woke: list[float] = []

    async def sleep(seconds: float) -> None:
        await clock.sleep(seconds)
        woke.append(seconds)

    async with anyio.create_task_group() as group:
        for seconds in (2.0, 1.0, 0.0):
            group.start_soon(sleep, seconds)
        await anyio.wait_all_tasks_blocked()
        assert woke == [0.0]
        clock.advance(1.5)
        await anyio.wait_all_tasks_blocked()
        assert woke == [0.0, 1.0]
        group.cancel_scope.cancel()
    clock.advance(10)
    assert woke == [0.0, 1.0]


@pytest.mark.anyio
async def test_sleeping_on_real_time() -> None:
    before = time.monotonic()
    await WallClock().sleep(0.001)
    assert time.monotonic() - before >= 0.001


def test_the_time_until_the_next_timer() -> None:
    clock = SimulatedClock(start_ns=5)
    assert clock.until_next() is None
    later = clock.call_later(2.0, lambda: None)
    sooner = clock.call_later(0.5, lambda: None)
    assert clock.until_next() == 0.5
    sooner.cancel()
    assert clock.until_next() == 2.0
    clock.advance(1.5)
    assert clock.until_next() == 0.5
    later.cancel()
    assert clock.until_next() is None
