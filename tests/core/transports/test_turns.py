"""Fair scheduling: work that waits for later turns of the event loop."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Generator
from functools import partial

import anyio
import anyio.lowlevel
import pytest

from rwt_transports.turns import RETRY_SECONDS, Turns, in_turns, loop_batches, loop_turns, no_turns


class Loop:
    """An event loop whose turns the test takes.

    Attributes:
        now: seconds on its clock, which work moves on.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self._next: list[Callable[[], None]] = []
        self._later: list[tuple[float, Callable[[], None]]] = []

    def turns(self, *, one_at_a_time: bool = False, is_held_back: Callable[[], bool] | None = None) -> Turns:
        return Turns(
            1.0, self._next.append, self._call_later, lambda: self.now,
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


def _is_full(turns: Turns) -> bool:
    return turns.is_full


def test_a_turn_does_as_much_as_fits_into_its_budget() -> None:
    loop, done = Loop(), list[int]()
    turns = loop.turns()
    for number in range(7):
        turns.wait(loop.work(0.4, partial(done.append, number)))
    for expected in (3, 6, 7):
        loop.take_turn()
        assert done == list(range(expected))
    assert not turns.must_wait


def test_work_that_takes_longer_than_a_turn_is_done_nevertheless() -> None:
    loop, done = Loop(), list[int]()
    turns = loop.turns()
    for number in range(2):
        turns.wait(loop.work(5.0, partial(done.append, number)))
    loop.take_turn()
    assert done == [0]
    loop.take_turn()
    assert done == [0, 1]


def test_work_that_puts_itself_off_does_not_hold_the_loop() -> None:
    loop, done = Loop(), list[int]()
    turns = loop.turns()

    def again() -> None:
        done.append(1)
        turns.wait(again)

    turns.wait(again)
    for count in (1, 2, 3):
        loop.take_turn()
        assert len(done) == count


def test_counted_work_fills_a_turn_until_the_next() -> None:
    loop = Loop()
    turns = loop.turns()
    turns.do(loop.work(0.6))
    assert not _is_full(turns)
    turns.note(0.6)
    assert _is_full(turns) and turns.must_wait
    loop.take_turn()
    assert not _is_full(turns)
    turns.note(0.6)
    assert not _is_full(turns), "the count begins anew with each turn"


def test_one_at_a_time_has_a_turn_of_its_own() -> None:
    loop, done = Loop(), list[str]()
    turns = loop.turns(one_at_a_time=True)
    assert turns.take("a") and turns.take("a") and not turns.take("b")
    for name in "cd":
        turns.wait(loop.work(0.0, partial(done.append, name)))
    loop.take_turn()
    assert done == ["c"] and not turns.take("b")
    loop.take_turn()
    assert done == ["c", "d"] and not turns.take("b")
    loop.take_turn()
    assert turns.take("b")


def test_work_that_is_held_back_is_tried_again_later() -> None:
    loop, done, held_back = Loop(), list[int](), [True]
    turns = loop.turns(is_held_back=lambda: held_back[0])
    assert turns.must_wait
    for number in range(2):
        turns.wait(partial(done.append, number))
    for _ in range(3):
        loop.take_turn()
        assert not done
    held_back[0] = False
    assert turns.must_wait, "others wait"
    loop.now += RETRY_SECONDS
    loop.take_turn()
    assert done == [0, 1] and not turns.must_wait


def test_a_failure_is_logged_and_holds_up_nobody(caplog: pytest.LogCaptureFixture) -> None:
    loop, done = Loop(), list[int]()
    turns = loop.turns()
    turns.wait(partial(int, "no number"))
    turns.wait(partial(done.append, 1))
    with caplog.at_level(logging.ERROR):
        loop.take_turn()
    assert done == [1] and "work that waited for its turn failed" in caplog.text


def test_nothing_waits_without_an_event_loop() -> None:
    turns, done = no_turns(), list[int]()
    turns.note(100.0)
    assert not turns.must_wait
    turns.wait(partial(done.append, 1))
    assert done == [1] and not turns.must_wait


@pytest.mark.anyio
async def test_the_turns_of_an_event_loop() -> None:
    held_back = False
    turns, done = loop_turns(0.0, is_held_back=lambda: held_back), list[int]()
    for number in range(3):
        turns.wait(partial(done.append, number))
    assert not done
    with anyio.fail_after(60):
        while len(done) < 3:
            await anyio.lowlevel.checkpoint()
        held_back = True
        turns.wait(partial(done.append, 3))
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
        assert await in_turns(steps(), seconds=0.0) == "end"
        tasks.cancel_scope.cancel()
    first, last = seen.index("step"), len(seen) - seen[::-1].index("step")
    assert "other" in seen[first:last]


class TestBatches:
    async def run_in_loop(self, others: int) -> list[str]:
        """Return the order of events of a callback in a batch, with others behind it in the turn."""
        events: list[str] = []
        loop = asyncio.get_running_loop()
        batches = loop_batches()
        assert loop_batches() is batches
        turns = Turns(1.0, batches.call_soon, loop.call_later)

        def deliver() -> None:
            turns.wait(lambda: events.append("written"))
            events.append("delivered")

        def receive() -> None:
            batches.run(deliver)
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

    def test_work_behind_a_fault_is_done(self) -> None:
        async def run() -> list[str]:
            batches, events = loop_batches(), ["begun"]

            def deliver() -> None:
                batches.call_soon(lambda: [][0])
                batches.call_soon(lambda: events.append("done"))

            with pytest.raises(IndexError):
                batches.run(deliver)
            await asyncio.sleep(0)
            return events

        assert asyncio.run(run()) == ["begun", "done"]
