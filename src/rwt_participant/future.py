"""Future: a value that a callback sets once, and tasks await."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Coroutine, Generator
from contextlib import AbstractContextManager
from contextvars import ContextVar
from enum import Enum
from types import coroutine
from typing import Any, Final, Generic, TypeAlias, TypeVar

import anyio

from rwt_participant.errors import CallTimeout

T = TypeVar("T")


class _Usual(Enum):
    TIMEOUT = "the usual"


#: Default timeout: that of the node or the connection.
USUAL: Final = _Usual.TIMEOUT

#: Seconds; None waits without limit.
Timeout: TypeAlias = float | _Usual | None

#: Leaves a block after so many seconds of some clock; None sets no limit.
Within: TypeAlias = Callable[[float | None], AbstractContextManager[object]]


class Future(Generic[T]):
    """Value or error that is set on the event loop's thread, and awaited by any number of tasks."""

    __slots__ = ("_event", "_values")

    def __init__(self) -> None:
        self._values: list[T | Exception] = []
        # Created by the first task that waits: events can be created in tasks only, and often nothing waits.
        self._event: anyio.Event | None = None

    @property
    def done(self) -> bool:
        """True if the value or the error is set."""
        return bool(self._values)

    @property
    def awaited(self) -> bool:
        """True if a task waits for it, or has waited."""
        return self._event is not None

    def set(self, value: T | Exception) -> None:
        """Set the value, or the error to raise. No-op if one is set."""
        if not self._values:
            self._values.append(value)
            if self._event is not None:
                self._event.set()

    async def wait(self) -> T:
        """Return the value, or raise the error, once it is set."""
        if not self._values and _HAS_NO_TASK.get():
            await _for_a_task()  # Within :func:`run_until_it_waits`: the rest runs in a task.
        if not self._values:  # It may be set before the task continues.
            if self._event is None:
                self._event = anyio.Event()
            await self._event.wait()
        value = self._values[0]
        if isinstance(value, Exception):
            raise value
        return value

    async def get(self, timeout: float | None, late: str, within: Within = anyio.move_on_after) -> T:
        """Wait for the value.

        Args:
            timeout: seconds; None waits without limit.
            late: beginning of the text of the timeout error.
            within: clock of the timeout.

        Raises:
            CallTimeout: it was not set in time.
            Exception: the error that was set.
        """
        with within(timeout):
            return await self.wait()
        raise CallTimeout(f"{late} within {timeout:g} s")


_HAS_NO_TASK: Final[ContextVar[bool]] = ContextVar("has no task", default=False)
"""True while a coroutine runs without a task, until it has to wait."""


@coroutine
def _for_a_task() -> Generator[None]:
    """Suspend a coroutine that runs without a task; it continues in one."""
    yield


def run_until_it_waits(work: Coroutine[Any, Any, T]) -> T | Awaitable[T]:
    """Run a coroutine at once, until it has to wait.

    Its work is then part of the caller's, and is bounded and charged with it, unlike that of a task. It may
    wait for futures of this module, and for nothing else before the first of them: everything else that
    waits, and cancel scopes, need a task from the start.

    Returns:
        Result of the coroutine, or the rest of it, to be awaited in a task.

    Raises:
        Exception: exception of the coroutine.
    """
    before = _HAS_NO_TASK.set(True)
    try:
        work.send(None)
    except StopIteration as end:
        value: T = end.value
        return value
    finally:
        _HAS_NO_TASK.reset(before)
    return _Rest(work)


class _Rest(Awaitable[T]):
    """Rest of a coroutine that was begun; `await` itself accepts only new ones."""

    def __init__(self, work: Coroutine[Any, Any, T]) -> None:
        self._work = work

    def __await__(self) -> Generator[Any, Any, T]:
        if _HAS_NO_TASK.get():
            yield  # The awaiting coroutine has no task either.
        return (yield from self._work.__await__())
