"""A value that comes once, from a callback to whatever awaits it."""

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


#: The timeout of what is given none: that of the node or the connection.
USUAL: Final = _Usual.TIMEOUT

#: Seconds; None waits as long as it takes.
Timeout: TypeAlias = float | _Usual | None

#: Bounds what is awaited in a block to so many seconds of some clock; None does not. The block is left early.
Within: TypeAlias = Callable[[float | None], AbstractContextManager[object]]


class Future(Generic[T]):
    """Set on the event loop's thread, awaited by any number of tasks. The first value or error stays."""

    __slots__ = ("_event", "_values")

    def __init__(self) -> None:
        self._values: list[T | Exception] = []
        # Made by whatever waits: events can be made in tasks only, and mostly nothing needs to wait.
        self._event: anyio.Event | None = None

    @property
    def done(self) -> bool:
        """Whether the value or the error has come."""
        return bool(self._values)

    @property
    def awaited(self) -> bool:
        """Whether something waits for it, or has."""
        return self._event is not None

    def set(self, value: T | Exception) -> None:
        """Give the value, or the error to raise; later ones are ignored."""
        if not self._values:
            self._values.append(value)
            if self._event is not None:
                self._event.set()

    async def wait(self) -> T:
        """The value, at once if it is there already; raises the error that was set."""
        if not self._values:
            if _HAS_NO_TASK.get():
                await _for_a_task()
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
            timeout: seconds; None waits as long as it takes.
            late: what to say when it does not come in time.
            within: the clock that bounds it.

        Raises:
            CallTimeout: it did not come in time.
            Exception: the error that was set.
        """
        with within(timeout):
            return await self.wait()
        raise CallTimeout(f"{late} within {timeout:g} s")


_HAS_NO_TASK: Final[ContextVar[bool]] = ContextVar("has no task", default=False)
"""Whether a coroutine runs without a task of its own, until it has to wait."""


@coroutine
def _for_a_task() -> Generator[None]:
    """Give up what runs without a task: it goes on in one."""
    yield


def run_until_it_waits(work: Coroutine[Any, Any, T]) -> T | Awaitable[T]:
    """Run a coroutine at once, as far as it goes without waiting.

    So its work is part of what its caller does, and bounded and charged with that, which a task's is not. It
    may wait for futures of this module, and for nothing else before the first of them: what else waits, and
    cancel scopes, want a task from the start.

    Returns:
        What it returned, or, if it has to wait, the rest of it, to be awaited in a task.

    Raises:
        Exception: what it raised.
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
    """What is left of a coroutine that was begun; `await` itself takes only new ones."""

    def __init__(self, work: Coroutine[Any, Any, T]) -> None:
        self._work = work

    def __await__(self) -> Generator[Any, Any, T]:
        return self._work.__await__()
