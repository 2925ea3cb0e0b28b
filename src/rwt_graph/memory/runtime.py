"""How a graph runs on an event loop: one task group, one clock task, and a door for other threads.

Backends compose this; it knows nothing of topics or services. Three states: *idle* (not entered yet: calls
run where they are made, which is what tests and set-up code want), *running*, and *over* (left).
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Awaitable, Callable

import anyio
import anyio.abc

from rwt_graph.clock import Clock
from rwt_graph.errors import NotRunning

logger = logging.getLogger(__name__)

Task = Callable[[], Awaitable[None]]


def _loop_door() -> Callable[[Callable[[], None]], object]:
    """The running event loop's thread-safe "call this soon"."""
    try:
        return asyncio.get_running_loop().call_soon_threadsafe
    except RuntimeError:
        import trio  # Only a program that runs on trio has it.

        return trio.lowlevel.current_trio_token().run_sync_soon


class Runtime:
    """The running half of a graph."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self._inbox: deque[Callable[[], None]] = deque()
        self._waking = False
        self._door: Callable[[Callable[[], None]], object] | None = None
        self._thread: int | None = None
        self._group: anyio.abc.TaskGroup | None = None
        self._waiting: list[tuple[Task, str]] = []
        self._wake: anyio.Event | None = None
        self._over = False

    @property
    def running(self) -> bool:
        """Whether the graph is on an event loop now."""
        return self._thread is not None

    def on_graph_thread(self) -> bool:
        """Whether the graph may be touched from here: its own thread, or no loop runs it."""
        return self._thread is None or self._thread == threading.get_ident()

    def run_on_graph(self, call: Callable[[], None]) -> None:
        """Run `call` on the graph's thread, soon and in order; at once when the graph is not running."""
        door = self._door
        if door is None:
            self._run(call)
            return
        # No lock: a deque's append is atomic, and whoever appends before `_drain` looks is served by it.
        self._inbox.append(call)
        if self._over:
            self._drain_all()
        elif not self._waking:
            self._waking = True
            self._knock(door)

    def _knock(self, door: Callable[[Callable[[], None]], object]) -> None:
        try:
            door(self._drain)
        except RuntimeError:
            # The event loop was closed under the graph: nobody else is left to run the calls.
            self._drain_all()

    def _drain(self) -> None:
        self._waking = False
        # Only what is there now: threads that publish without pause must not keep the loop from the rest.
        for _ in range(len(self._inbox)):
            self._run(self._inbox.popleft())
        if self._inbox and not self._waking and self._door is not None:
            self._waking = True
            self._knock(self._door)

    def _drain_all(self) -> None:
        for _ in range(len(self._inbox)):
            try:
                call = self._inbox.popleft()
            except IndexError:
                return  # Another thread took the last one.
            self._run(call)

    @staticmethod
    def _run(call: Callable[[], None]) -> None:
        try:
            call()
        except Exception:
            logger.exception("a call handed over to the graph's thread failed")

    def spawn(self, task: Task, name: str) -> None:
        """Start `task` in the graph's task group; before the graph runs it is kept until then.

        What it raises is logged and ends nothing else.

        Raises:
            NotRunning: the graph was left already.
        """
        if self._over:
            raise NotRunning(f"{name} cannot start: the graph was closed")
        self._waiting.append((task, name))
        if self._wake is not None:
            self._wake.set()

    async def _start_tasks(self, group: anyio.abc.TaskGroup) -> None:
        """Start what was spawned.

        A task of its own does it, because most of what spawns is a callback of the event loop (a socket's, a
        timer's), and there a task group cannot start anything.
        """
        while True:
            waiting, self._waiting = self._waiting, []
            for task, name in waiting:
                group.start_soon(_guarded, task, name, name=name)
            wake = self._wake = anyio.Event()
            if not self._waiting:
                await wake.wait()

    async def start(self) -> None:
        """Take hold of the running event loop.

        Raises:
            NotRunning: the graph was entered before; a graph runs once.
        """
        if self._over or self.running:
            raise NotRunning("a graph can be entered only once")
        group = anyio.create_task_group()
        await group.__aenter__()
        self._group = group
        self._door = _loop_door()
        self._thread = threading.get_ident()
        group.start_soon(_guarded, self.clock.drive, "clock", name="clock")
        group.start_soon(self._start_tasks, group, name="task starter")

    async def stop(self, close: Callable[[], None]) -> None:
        """Run `close`, cancel every task and wait for their end."""
        group = self._group
        if group is None:
            return
        self._drain_all()
        try:
            close()
        finally:
            self._over = True
            self._drain_all()
            group.cancel_scope.cancel()
            try:
                # Not given the body's exception: it goes on by itself, unwrapped by any group.
                await group.__aexit__(None, None, None)
            finally:
                self._group = None
                self._wake = None
                self._waiting.clear()
                self._thread = None


async def _guarded(task: Task, name: str) -> None:
    try:
        await task()
    except Exception:
        logger.exception("%s failed", name)


__all__ = ["Runtime"]
