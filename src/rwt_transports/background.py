"""Background tasks of a block of code, and detection of the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import TypeVarTuple, Unpack

import anyio
from anyio.abc import TaskGroup

Arguments = TypeVarTuple("Arguments")


def runs_asyncio() -> bool:
    """Return True if the running event loop is asyncio's or uvloop's."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


def ignore(*arguments: object) -> None:
    """Callback of what has ended."""


class TaskStarter:
    """Starts tasks from callbacks of the event loop.

    A task group cannot start tasks from a callback (of a socket or a timer), because it looks up the current
    task. :meth:`run` runs in a task and starts them.
    """

    def __init__(self) -> None:
        self._waiting: list[Callable[[TaskGroup], object]] = []
        self._wake: anyio.Event | None = None

    def start_soon(
        self, function: Callable[[Unpack[Arguments]], Coroutine[object, object, None]], *arguments: *Arguments
    ) -> None:
        """Run a coroutine function as a task, once :meth:`run` is running."""
        self._waiting.append(lambda group: group.start_soon(function, *arguments))
        if self._wake is not None:
            self._wake.set()

    async def run(self, group: TaskGroup) -> None:
        """Start tasks in `group` until cancelled."""
        while True:
            waiting, self._waiting = self._waiting, []
            for start in waiting:
                start(group)
            # A new event before the check: what is added after it sets this one.
            self._wake = anyio.Event()
            if not self._waiting:
                await self._wake.wait()


@asynccontextmanager
async def background_tasks() -> AsyncIterator[TaskGroup]:
    """Open a task group for a block, and cancel its tasks at the end.

    Exceptions of the block are raised as they are, not in an exception group, so that they can be caught by
    type. A task that fails cancels the block, and its exception is raised in a group.
    """
    failure: BaseException | None = None
    async with anyio.create_task_group() as tasks:
        try:
            yield tasks
        except (GeneratorExit, anyio.get_cancelled_exc_class()):
            raise
        except BaseException as error:
            # Raised below, and not in the group of the tasks.
            failure = error
        tasks.cancel_scope.cancel()
    if failure is not None:
        raise failure
