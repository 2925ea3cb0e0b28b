"""Coroutines that are run as far as they go without a task, and futures that they wait for."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable

import pytest

from rwt_participant.future import Future, run_until_it_waits


async def _sum(*numbers: Future[int]) -> int:
    return sum([await number.wait() for number in numbers])


def test_what_is_there_already_is_not_waited_for() -> None:
    three, four = Future[int](), Future[int]()
    three.set(3)
    four.set(4)
    assert run_until_it_waits(_sum(three, four)) == 7
    four = Future()
    four.set(ZeroDivisionError("by zero"))
    with pytest.raises(ZeroDivisionError, match="by zero"):
        run_until_it_waits(_sum(three, four))


def test_the_rest_goes_on_in_a_task() -> None:
    three, four, five = Future[int](), Future[int](), Future[int]()
    three.set(3)

    async def finish() -> int:
        begun = run_until_it_waits(_sum(three, four, five))
        assert isinstance(begun, Awaitable)
        rest = asyncio.ensure_future(begun)
        await asyncio.sleep(0)
        four.set(4)
        await asyncio.sleep(0)
        assert not rest.done()
        five.set(5)
        return await rest

    assert asyncio.run(finish()) == 12


def test_the_rest_can_be_cancelled() -> None:
    async def cancel() -> None:
        begun = run_until_it_waits(_sum(Future()))
        assert isinstance(begun, Awaitable)
        rest = asyncio.ensure_future(begun)
        await asyncio.sleep(0)
        rest.cancel()
        with pytest.raises(asyncio.CancelledError):
            await rest

    asyncio.run(cancel())


def test_a_value_that_is_set_before_the_task_continues_is_received() -> None:
    async def finish() -> int:
        number = Future[int]()
        begun = run_until_it_waits(_sum(number))
        assert isinstance(begun, Awaitable)
        number.set(3)
        return await asyncio.wait_for(begun, 10)

    assert asyncio.run(finish()) == 3


def test_a_coroutine_without_a_task_awaits_the_rest_of_another() -> None:
    number = Future[int]()

    async def outer() -> int:
        begun = run_until_it_waits(_sum(number))
        assert isinstance(begun, Awaitable)
        return 1 + await begun

    async def finish() -> int:
        begun = run_until_it_waits(outer())
        assert isinstance(begun, Awaitable)
        rest = asyncio.ensure_future(begun)
        await asyncio.sleep(0)
        number.set(3)
        return await asyncio.wait_for(rest, 10)

    assert asyncio.run(finish()) == 4
