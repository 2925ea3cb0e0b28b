"""Fair scheduling: work that waits for later turns of the event loop."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Generator
from functools import partial

import anyio
import anyio.lowlevel
import pytest

from rwt_transports.scheduler import MESSAGES, RETRY_SECONDS, WRITING, Budget, Scheduler


class Loop:
    """An event loop whose turns the test takes.

    Attributes:
        now: seconds on its clock, which work moves on.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self._next: list[Callable[[], None]] = []
        self._later: list[tuple[float, Callable[[], None]]] = []

    def scheduler(
        self, *, one_at_a_time: bool = False, is_held_back: Callable[[], bool] | None = None
    ) -> Scheduler:
        return Scheduler(
            Budget(turn=1.0, share=0.5), self._next.append, self._call_later, lambda: self.now,
            one_at_a_time=one_at_a_time, is_held_back=is_held_back,
        )  # fmt: skip

    def _call_later(self, seconds: float, call: Callable[[], None]) -> None:
        self._later.append((self.now + seconds, call))

    def take_turn(self) -> None:
        due = [call for at, call in self._later if at <= self.now]
        self._later = [each for each in self._later if each[0] > self.now]
        calls = self._next + due
        self._next.clear()
        for call in calls:
            call()

    def work(self, seconds: float, done: Callable[[], object] = bool) -> Callable[[], None]:
        def work() -> None:
            self.now += seconds
            done()

        return work


def _is_full(scheduler: Scheduler) -> bool:
    return scheduler.is_full


def test_a_turn_does_as_much_as_fits_into_its_budget() -> None:
    loop, done = Loop(), list[int]()
    scheduler = loop.scheduler()
    for number in range(7):
        scheduler.wait(loop.work(0.4, partial(done.append, number)))
    for expected in (3, 6, 7):
        loop.take_turn()
        assert done == list(range(expected))
    assert not scheduler.must_wait


def test_work_that_takes_longer_than_a_turn_is_done_nevertheless() -> None:
    loop, done = Loop(), list[int]()
    scheduler = loop.scheduler()
    for number in range(2):
        scheduler.wait(loop.work(5.0, partial(done.append, number)))
    loop.take_turn()
    assert done == [0]
    loop.take_turn()
    assert done == [0, 1]


def test_work_that_puts_itself_off_does_not_hold_the_loop() -> None:
    loop, done = Loop(), list[int]()
    scheduler = loop.scheduler()

    def again() -> None:
        done.append(1)
        scheduler.wait(again)

    scheduler.wait(again)
    for count in (1, 2, 3):
        loop.take_turn()
        assert len(done) == count


def test_counted_work_fills_a_turn_until_the_next() -> None:
    loop = Loop()
    scheduler = loop.scheduler()
    scheduler.do(loop.work(0.6))
    assert not _is_full(scheduler)
    scheduler.note(0.6)
    assert _is_full(scheduler) and scheduler.must_wait
    loop.take_turn()
    assert not _is_full(scheduler)
    scheduler.note(0.6)
    assert not _is_full(scheduler), "the count begins anew with each turn"


def test_one_at_a_time_has_a_turn_of_its_own() -> None:
    loop, done = Loop(), list[str]()
    scheduler = loop.scheduler(one_at_a_time=True)
    assert scheduler.take("a") and scheduler.take("a") and not scheduler.take("b")
    for name in "cd":
        scheduler.wait(loop.work(0.0, partial(done.append, name)))
    loop.take_turn()
    assert done == ["c"] and not scheduler.take("b")
    loop.take_turn()
    assert done == ["c", "d"] and not scheduler.take("b")
    loop.take_turn()
    assert scheduler.take("b")


def test_work_that_is_held_back_is_tried_again_later() -> None:
    loop, done, held_back = Loop(), list[int](), [True]
    scheduler = loop.scheduler(is_held_back=lambda: held_back[0])
    assert scheduler.must_wait
    for number in range(2):
        scheduler.wait(partial(done.append, number))
    for _ in range(3):
        loop.take_turn()
        assert not done
    held_back[0] = False
    assert scheduler.must_wait, "others wait"
    loop.now += RETRY_SECONDS
    loop.take_turn()
    assert done == [0, 1] and not scheduler.must_wait


def test_a_failure_is_logged_and_holds_up_nobody(caplog: pytest.LogCaptureFixture) -> None:
    loop, done = Loop(), list[int]()
    scheduler = loop.scheduler()
    scheduler.wait(partial(int, "no number"))
    scheduler.wait(partial(done.append, 1))
    with caplog.at_level(logging.ERROR):
        loop.take_turn()
    assert done == [1] and "work that waited for its turn failed" in caplog.text


def test_nothing_waits_without_an_event_loop() -> None:
    scheduler, done = Scheduler.immediate(MESSAGES), list[int]()
    scheduler.note(100.0)
    assert not scheduler.must_wait
    scheduler.wait(partial(done.append, 1))
    assert done == [1] and not scheduler.must_wait


@pytest.mark.anyio
async def test_the_scheduler_of_an_event_loop() -> None:
    held_back = False
    budget = Budget(turn=0.0, share=0.0)
    scheduler, done = Scheduler.of_loop(budget, lambda: held_back), list[int]()
    for number in range(3):
        scheduler.wait(partial(done.append, number))
    assert not done
    with anyio.fail_after(60):
        while len(done) < 3:
            await anyio.lowlevel.checkpoint()
        held_back = True
        scheduler.wait(partial(done.append, 3))
        for _ in range(10):
            await anyio.lowlevel.checkpoint()
        assert done == [0, 1, 2]
        held_back = False
        while len(done) < 4:
            await anyio.lowlevel.checkpoint()
    assert done == [0, 1, 2, 3]


@pytest.mark.anyio
async def test_steps_of_a_task_let_others_run() -> None:
    seen: list[str] = []

    async def others() -> None:
        while True:
            seen.append("other")
            await anyio.lowlevel.checkpoint()

    def steps() -> Generator[None, None, str]:
        for _ in range(3):
            seen.append("step")
            yield
        return "end"

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(others)
        await anyio.lowlevel.checkpoint()
        assert await Scheduler.of_loop(Budget(turn=0.0, share=0.0)).finish(steps()) == "end"
        tasks.cancel_scope.cancel()
    first, last = seen.index("step"), len(seen) - seen[::-1].index("step")
    assert "other" in seen[first:last]


@pytest.mark.anyio
async def test_tasks_that_wait_share_the_budget_of_a_turn() -> None:
    now, taken, calls = 0.0, 0, list[Callable[[], None]]()
    scheduler = Scheduler(
        Budget(turn=0.010, share=0.001), calls.append, lambda _, call: calls.append(call), lambda: now
    )

    def steps() -> Generator[None, None, str]:
        nonlocal now, taken
        for _ in range(3):
            now, taken = now + 0.006, taken + 1
            yield
        return "end"

    results: list[str] = []

    async def read() -> None:
        results.append(await scheduler.finish(steps()))

    async with anyio.create_task_group() as group:
        for _ in range(10):
            group.start_soon(read)
        await anyio.wait_all_tasks_blocked()
        while calls:
            before = taken
            calls.pop(0)()
            assert taken - before <= 2
    assert results == ["end"] * 10


@pytest.mark.anyio
async def test_a_failure_of_steps_is_raised_in_the_task() -> None:
    def steps() -> Generator[None, None, str]:
        yield
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        await Scheduler.of_loop(MESSAGES).finish(steps())


def test_steps_are_taken_for_a_share_of_each_turn() -> None:
    loop, done = Loop(), list[int]()
    scheduler = loop.scheduler()

    def steps() -> Generator[None, None, None]:
        for number in range(5):
            loop.now += 0.3
            done.append(number)
            yield

    scheduler.run(steps())
    assert done == [0, 1]
    loop.take_turn()
    assert done == [0, 1, 2, 3]
    loop.take_turn()
    assert done == [0, 1, 2, 3, 4]


def test_users_of_an_event_loop_share_a_scheduler_of_the_same_budget() -> None:
    async def run() -> None:
        scheduler = Scheduler.of_loop(WRITING)
        assert Scheduler.of_loop(WRITING) is scheduler
        assert Scheduler.of_loop(WRITING, bool) is not scheduler
        assert Scheduler.of_loop(MESSAGES) is not scheduler

    asyncio.run(run())


class TestBatches:
    """The end of a batch is the only place that reads a private attribute of asyncio's event loop. The first
    of these tests fails when a release of Python has no such attribute."""

    async def run_in_loop(self, others: int) -> list[str]:
        """Return the order of events of a callback in a batch, with others behind it in the turn."""
        events: list[str] = []
        loop = asyncio.get_running_loop()
        scheduler = Scheduler.of_loop(WRITING)

        def deliver() -> None:
            scheduler.wait(lambda: events.append("written"))
            events.append("delivered")

        def receive() -> None:
            scheduler.batch(deliver)
            events.append("returned")

        loop.call_soon(receive)
        for _ in range(others):
            loop.call_soon(events.append, "other")
        await asyncio.sleep(0.01)
        return events

    def test_work_is_done_at_the_end_of_a_batch(self) -> None:
        assert asyncio.run(self.run_in_loop(0)) == ["delivered", "written", "returned"]

    def test_work_waits_for_the_callbacks_that_follow(self) -> None:
        assert asyncio.run(self.run_in_loop(2)) == ["delivered", "returned", "other", "other", "written"]

    def test_work_waits_for_a_turn_on_loops_that_do_not_tell_what_follows(self) -> None:
        loop, events = Loop(), list[str]()
        scheduler = loop.scheduler()
        scheduler.batch(partial(scheduler.wait, partial(events.append, "written")))
        assert not events
        loop.take_turn()
        assert events == ["written"]

    def test_work_behind_a_fault_is_done(self) -> None:
        async def run() -> list[str]:
            scheduler, events = Scheduler.of_loop(WRITING), ["begun"]

            def deliver() -> None:
                scheduler.wait(lambda: events.append("done"))
                raise IndexError

            with pytest.raises(IndexError):
                scheduler.batch(deliver)
            await asyncio.sleep(0)
            return events

        assert asyncio.run(run()) == ["begun", "done"]
