"""Tasks beside a block of code, and on which event loop they are."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from time import monotonic
from typing import Final, TypeVarTuple, Unpack

import anyio
import anyio.lowlevel
from anyio.abc import TaskGroup

Arguments = TypeVarTuple("Arguments")

PACED_SECONDS: Final = 0.005
"""Of one turn of the event loop, for what is :class:`Paced`."""


def runs_asyncio() -> bool:
    """Whether the running event loop is one of asyncio's, uvloop's included."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


class TaskStarter:
    """Starts tasks from wherever the event loop's own thread is.

    A task group starts nothing from a callback of the event loop (a socket's, a timer's): it looks up the
    running loop, which only a task has. So a task of its own starts them: :meth:`run`.
    """

    def __init__(self) -> None:
        self._waiting: list[Callable[[TaskGroup], object]] = []
        self._wake: anyio.Event | None = None

    def start_soon(
        self, function: Callable[[Unpack[Arguments]], Coroutine[object, object, None]], *arguments: *Arguments
    ) -> None:
        """Run a coroutine function as a task; before :meth:`run` runs it is kept until then."""
        self._waiting.append(lambda group: group.start_soon(function, *arguments))
        if self._wake is not None:
            self._wake.set()

    async def run(self, group: TaskGroup) -> None:
        """Start in `group` what comes, until it is cancelled."""
        while True:
            waiting, self._waiting = self._waiting, []
            for start in waiting:
                start(group)
            self._wake = anyio.Event()
            if not self._waiting:
                await self._wake.wait()


class Paced:
    """Steps of many connections, of which each turn of the event loop sees few: they take some milliseconds,
    and the rest waits in a line for the next turns. Without :meth:`run` nothing waits."""

    def __init__(self) -> None:
        self._waiting: deque[Callable[[], object]] = deque()
        self._used = 0.0  # seconds
        self._wake: anyio.Event | None = None

    @property
    def is_full(self) -> bool:
        """Whether a step has to wait."""
        return self._wake is not None and (self._used > PACED_SECONDS or bool(self._waiting))

    def take(self, step: Callable[[], object]) -> None:
        """Take a step now, which counts."""
        began = monotonic()
        try:
            step()
        finally:
            self._used += monotonic() - began

    def later(self, step: Callable[[], object]) -> None:
        """Take a step behind those that wait already; it raises nothing."""
        if self._wake is None:
            step()
            return
        self._waiting.append(step)
        self._wake.set()

    async def run(self) -> None:
        """Let each turn see its part, until cancelled."""
        while True:
            if not self._waiting:
                self._used = 0.0
                self._wake = anyio.Event()
                await self._wake.wait()
            self._used = 0.0
            while self._waiting and self._used <= PACED_SECONDS:
                self.take(self._waiting.popleft())
            await anyio.lowlevel.checkpoint()


@asynccontextmanager
async def background_tasks() -> AsyncIterator[TaskGroup]:
    """A task group for the length of a block, at whose end the tasks are cancelled.

    What the block raises comes out as itself and not in a group, so that it can be caught by its type; a task
    that fails still cancels the block and comes out in a group.
    """
    failure: BaseException | None = None
    async with anyio.create_task_group() as tasks:
        try:
            yield tasks
        except (GeneratorExit, anyio.get_cancelled_exc_class()):
            raise
        except BaseException as error:
            failure = error
        tasks.cancel_scope.cancel()
    if failure is not None:
        raise failure
