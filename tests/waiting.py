"""Waiting for a condition that sets no event, such as the state of another thread, process or library."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable
from typing import Final

import anyio

PATIENCE: Final = 60.0
"""Seconds; far more than anything takes, so that only a failed test waits that long."""


async def until(condition: Callable[[], object], what: str = "", seconds: float = PATIENCE) -> None:
    """Wait until a condition is true.

    Raises:
        TimeoutError: it does not become true; the text is `what`.
    """

    async def holds() -> object:
        return condition()

    await until_answered(holds, what, seconds)


async def until_answered(
    ask: Callable[[], Awaitable[object]], what: str = "", seconds: float = PATIENCE
) -> None:
    """Wait until a coroutine function returns a true value.

    Raises:
        TimeoutError: it does not return one; the text is `what`.
    """
    try:
        with anyio.fail_after(seconds):
            while not await ask():  # noqa: ASYNC110 - the awaited changes set no event
                await anyio.sleep(0.005)
    except TimeoutError:
        raise TimeoutError(what or "the condition did not become true") from None


def wait_until(condition: Callable[[], object], what: Callable[[], str] = lambda: "") -> None:
    """Wait until a condition is true, in a test without an event loop.

    Raises:
        TimeoutError: it does not become true; the text is what `what` returns then.
    """
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(what() or "the condition did not become true")
        time.sleep(0.02)
