"""Execution of a graph on an event loop: a task group, a clock task, and a queue of calls from threads."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Awaitable, Callable
from contextvars import Context, copy_context
from enum import Enum
from functools import partial
from typing import Final

import anyio
import anyio.abc

from rwt_graph.clock import Clock
from rwt_graph.errors import NotRunning
from rwt_participant.threads.pool import CallSoon, call_soon_threadsafe

logger = logging.getLogger(__name__)

Task = Callable[[], Awaitable[None]]

Spawned = tuple[Task, str, Context, int]
"""A task to start, with its name, the context of its caller, and the ID of that thread."""


class _RuntimeState(Enum):
    IDLE = "idle"
    RUNNING = "running"
    STOPPING = "stopping"
    OVER = "over"


_TRANSITIONS: Final = {
    _RuntimeState.IDLE: {_RuntimeState.RUNNING},
    _RuntimeState.RUNNING: {_RuntimeState.STOPPING},
    _RuntimeState.STOPPING: {_RuntimeState.OVER},
    _RuntimeState.OVER: set[_RuntimeState](),
}


class Runtime:
    """Runner of the tasks and calls of one graph: the part of :class:`rwt_graph.api.Graph` about threads.

    Life cycle::

        IDLE ── entered ──> RUNNING ── graph closed ──> STOPPING ── tasks ended ──> OVER

    * **IDLE**: calls run in the caller, as tests and set-up code need it; spawned tasks wait.
    * **RUNNING**: calls of other threads run on the graph's thread.
    * **STOPPING**: tasks are being cancelled and none can start; calls of any thread run in the caller.
    * **OVER**: calls run in the caller.

    Private attributes: ``_inbox`` (calls of other threads), ``_waking`` (True while the event loop is asked
    to run them), ``_waiting`` (tasks to start), ``_wake`` (wakes their starter). ``_group`` and ``_thread``
    are None unless RUNNING or STOPPING; ``_call_soon`` is None while IDLE.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self._state = _RuntimeState.IDLE
        self._inbox: deque[Callable[[], None]] = deque()
        self._waking = False
        self._call_soon: CallSoon | None = None
        self._thread: int | None = None
        self._group: anyio.abc.TaskGroup | None = None
        self._waiting: list[Spawned] = []
        self._wake: anyio.Event | None = None

    def _become(self, state: _RuntimeState) -> None:
        assert state in _TRANSITIONS[self._state], f"{self._state} -> {state}"
        self._state = state

    @property
    def running(self) -> bool:
        return self._thread is not None

    def on_graph_thread(self) -> bool:
        return self._thread is None or self._thread == threading.get_ident()

    def run_on_graph(self, call: Callable[[], None]) -> None:
        call_soon = self._call_soon
        if call_soon is None:
            self._run(call)
            return
        # No lock: a deque's append is atomic, and `_drain` runs every call that was appended before it looks.
        self._inbox.append(call)
        if self._state is not _RuntimeState.RUNNING:
            self._drain_all()
        elif not self._waking:
            self._waking = True
            self._schedule(call_soon)

    def _schedule(self, call_soon: CallSoon) -> None:
        try:
            call_soon(self._drain)
        except RuntimeError:
            # The event loop was closed while the graph was running: the calls can only run here.
            self._drain_all()

    def _drain(self) -> None:
        self._waking = False
        # Only calls that are queued now: threads that publish without pause must not block the loop.
        for _ in range(len(self._inbox)):
            self._run(self._inbox.popleft())
        if self._inbox and not self._waking and self._call_soon is not None:
            self._waking = True
            self._schedule(self._call_soon)

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
        if self._state in (_RuntimeState.STOPPING, _RuntimeState.OVER):
            raise NotRunning(f"{name} cannot start: the graph was closed")
        spawned = (task, name, copy_context(), threading.get_ident())
        if self.on_graph_thread():
            self._start_soon(spawned)
        else:
            self.run_on_graph(partial(self._start_soon, spawned))

    def _start_soon(self, spawned: Spawned) -> None:
        if self._state is _RuntimeState.OVER:
            logger.warning("%s cannot start: the graph was closed", spawned[1])
            return
        self._waiting.append(spawned)
        if self._wake is not None:
            self._wake.set()

    async def _start_tasks(self, group: anyio.abc.TaskGroup) -> None:
        """Start the spawned tasks, in a task of its own.

        Most callers of `spawn` are callbacks of the event loop, where a task group cannot start anything. A
        task runs in a copy of its caller's context, except that of another thread, which may name another
        event loop.
        """
        while True:
            waiting, self._waiting = self._waiting, []
            for task, name, context, thread in waiting:
                start = partial(group.start_soon, _guarded, task, name, name=name)
                if thread == self._thread:
                    context.run(start)
                else:
                    start()
            wake = self._wake = anyio.Event()
            if not self._waiting:
                await wake.wait()

    async def _start(self) -> None:
        """Start the clock and the waiting tasks on the running event loop. Raises :exc:`NotRunning`."""
        if self._state is not _RuntimeState.IDLE:
            raise NotRunning("a graph can be entered only once")
        group = anyio.create_task_group()
        await group.__aenter__()
        self._become(_RuntimeState.RUNNING)
        self._group = group
        self._thread = threading.get_ident()
        # Last: from here on, calls of other threads are queued.
        self._call_soon = call_soon_threadsafe()
        group.start_soon(_guarded, self.clock.drive, "clock", name="clock")
        group.start_soon(self._start_tasks, group, name="task starter")

    async def _stop(self, close: Callable[[], None]) -> None:
        group = self._group
        if group is None:
            return
        self._drain_all()
        try:
            close()
        finally:
            self._become(_RuntimeState.STOPPING)
            self._drain_all()
            group.cancel_scope.cancel()
            try:
                # Not given the body's exception, which propagates unwrapped by the group.
                await group.__aexit__(None, None, None)
            finally:
                self._group = None
                self._wake = None
                self._thread = None
                self._become(_RuntimeState.OVER)
                waiting, self._waiting = self._waiting, []
                with anyio.CancelScope() as scope:
                    # Like a task group with what is started after its end: waiting tasks receive an error.
                    scope.cancel()
                    for task, name, *_ in waiting:
                        await _guarded(task, name)


async def _guarded(task: Task, name: str) -> None:
    try:
        await task()
    except Exception:
        logger.exception("%s failed", name)
