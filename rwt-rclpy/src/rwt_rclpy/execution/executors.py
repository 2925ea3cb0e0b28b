"""`rclpy.executors`: execution of the callbacks of nodes.

An executor runs the ready callbacks of its nodes' entities, and sleeps if there are none, until an entity
wakes it or the next timer is due. It never polls.
"""

from __future__ import annotations

import inspect
import os
import threading
import warnings
from collections import deque
from collections.abc import Callable, Coroutine, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Self

from rwt_rclpy.clocks import timekeeper
from rwt_rclpy.clocks.timekeeper import Waker
from rwt_rclpy.exceptions import InvalidHandle
from rwt_rclpy.execution.context import Context, get_default_context
from rwt_rclpy.execution.entity import Entity
from rwt_rclpy.execution.interruption import UNINTERRUPTED
from rwt_rclpy.execution.task import CallbackTask, Future, Task
from rwt_rclpy.release import FROM_KILTED

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node


async def await_or_execute(callback: Callable[..., Any] | Coroutine[Any, Any, Any], *args: Any) -> Any:
    """Return the result of a function or a coroutine function."""
    if inspect.iscoroutinefunction(callback):
        return await callback(*args)
    assert callable(callback)  # Coroutines have no arguments, and are not passed to this function.
    return callback(*args)


class TimeoutException(Exception):
    """No entity had work within the timeout."""


class ShutdownException(Exception):
    """The executor was shut down."""


class ExternalShutdownException(Exception):
    """The context was shut down during a wait of an executor or for a response."""

    def __init__(self) -> None:
        super().__init__("the context was shut down")


class ConditionReachedException(Exception):
    """The awaited condition was met."""


class TimeoutObject:
    """Timeout that can be changed."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout


class WorkTracker:
    """Counter of running callbacks."""

    def __init__(self, keeper: timekeeper.Timekeeper) -> None:
        self._keeper = keeper
        self._condition = keeper.condition()
        self._count = 0

    def begin(self) -> None:
        """Count a callback that begins."""
        with self._condition:
            self._count += 1

    def end(self) -> None:
        """Count a callback that has ended."""
        with self._condition:
            self._count -= 1
            if not self._count:
                self._condition.notify_all()

    def wait(self, timeout_sec: float | None) -> bool:
        """Wait until no callback runs. Returns False after the timeout."""
        with self._condition:
            deadline = self._keeper.deadline(timeout_sec)
            return self._keeper.wait_for(self._condition, lambda: not self._count, deadline)


class Executor(Waker):
    """Base of executors: their nodes and ready callbacks."""

    def __init__(self, *, context: Context | None = None) -> None:
        self._context = get_default_context() if context is None else context
        if self._context.handle is None:
            error = RuntimeError if FROM_KILTED else TypeError
            raise error(
                "Context must be initialized a GuardCondition can be created"
                if FROM_KILTED
                else "'NoneType' object does not support the context manager protocol"
            )
        self._keeper = timekeeper.current()
        self._condition = self._keeper.condition()
        self._woken = False
        self._nodes: tuple[Node, ...] = ()
        self._nodes_lock = threading.RLock()
        self._tasks: list[tuple[Task, Entity | None, Node | None]] = []
        self._tasks_lock = threading.Lock()
        self._had_turn: set[Task] = set()
        self._is_shutdown = False
        self._work_tracker = WorkTracker(self._keeper)
        self._in_callback = threading.local()
        self._batch: deque[tuple[Entity, Node]] = deque()
        self._sigint_gc = None
        self._context._rwt_wake_on_end(self)

    @property
    def context(self) -> Context:
        """Context whose end ends the executor."""
        return self._context

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Task:
        """Schedule a function, a coroutine function or a coroutine in the executor."""
        self._require_running()
        task = Task(callback, args, kwargs, executor=self)
        with self._tasks_lock:
            self._tasks.append((task, None, None))
        self.wake()
        return task

    def _require_running(self) -> None:
        if self._is_shutdown and not FROM_KILTED:
            raise AttributeError("'NoneType' object has no attribute 'trigger'")

    if FROM_KILTED:

        def create_future(self) -> Future:
            """Return a future whose callbacks this executor runs."""
            return Future(executor=self)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Start no more callbacks, and wait for running ones.

        Returns:
            True if all ended within the timeout.
        """
        self._is_shutdown = True
        self.wake()
        # Otherwise, a callback that shuts down its own executor would wait for itself.
        own = getattr(self._in_callback, "now", False)
        if not own and not self._work_tracker.wait(timeout_sec):
            return False
        with self._nodes_lock:
            self._nodes = ()
        self._batch.clear()
        return True

    def add_node(self, node: Node) -> bool:
        """Add a node. Returns False if the executor has it already."""
        self._require_running()
        with self._nodes_lock:
            if node in self._nodes:
                return False
            self._nodes = (*self._nodes, node)
        node.executor = self
        self.wake()
        return True

    def remove_node(self, node: Node) -> None:
        """Remove a node."""
        with self._nodes_lock:
            if node not in self._nodes:
                return
            self._nodes = tuple(each for each in self._nodes if each is not node)
        self.wake()

    def get_nodes(self) -> list[Node]:
        """Return its nodes."""
        return list(self._nodes)

    def wake(self) -> None:
        """Check again for ready callbacks."""
        with self._condition:
            self._woken = True
            self._condition.notify_all()

    def can_execute(self, entity: Entity) -> bool:
        """True if an entity's callback may run concurrently with the running ones."""
        return not entity._executor_event and entity.callback_group.can_execute(entity)

    # Spinning

    def spin(self) -> None:
        """Run callbacks until the context or the executor is shut down.

        Raises:
            ExternalShutdownException: the context was shut down from outside, as by a signal.
        """
        while self._context.ok() and not self._is_shutdown:
            self.spin_once()

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Run one callback, waiting for one; raises what it raises, or an earlier one raised."""
        self._spin_once_impl(timeout_sec)

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """Run one callback, waiting for one or for the future."""
        future._rwt_resume_with(self.wake)
        self._spin_once_impl(timeout_sec, lambda: future.done() or future.cancelled())

    def _spin_once_impl(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        wait_condition: Callable[[], bool] = lambda: False,
    ) -> None:
        """Run one callback, waiting for one or for the condition."""
        raise NotImplementedError

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Run callbacks until a future is done, at most for some seconds."""
        future._rwt_resume_with(self.wake)
        deadline = self._deadline(timeout_sec)
        while self._context.ok() and not future.done() and not self._is_shutdown and not future.cancelled():
            left = None if deadline is None else max(0.0, (deadline - self._keeper.steady_ns()) / 1e9)
            self.spin_once_until_future_complete(future, left)
            if deadline is not None and self._keeper.steady_ns() >= deadline:
                return

    def _deadline(self, timeout_sec: float | TimeoutObject | None) -> int | None:
        if isinstance(timeout_sec, TimeoutObject):
            timeout_sec = timeout_sec.timeout
        return self._keeper.deadline(timeout_sec)

    # Ready callbacks

    def wait_for_ready_callbacks(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        nodes: Iterable[Node] | None = None,
        condition: Callable[[], bool] = lambda: False,
    ) -> tuple[Task, Entity | None, Node | None]:
        """Wait for a callback that may run; the first returned item runs it.

        Raises:
            TimeoutException: none was ready in time.
            ConditionReachedException: the condition was met first.
            ShutdownException: the executor was shut down.
            ExternalShutdownException: the context was.
        """
        deadline = self._deadline(timeout_sec)
        while True:
            if self._is_shutdown:
                raise ShutdownException
            if not self._context.ok():
                raise ExternalShutdownException
            if condition():
                raise ConditionReachedException
            self._woken = False
            wanted = self._nodes if nodes is None else tuple(nodes)
            found = self._next_task(wanted) or self._next_of_batch(wanted)
            if found is not None:
                return found
            due = self._look_over(wanted)
            if self._batch:
                continue
            now = self._keeper.steady_ns()
            if deadline is not None and now >= deadline:
                raise TimeoutException
            ends = [each for each in (deadline, None if due is None else now + due) if each is not None]
            with self._condition:
                if not self._woken:
                    self._keeper.wait(self._condition, min(ends, default=None))

    def _wait_for_ready_callbacks(
        self, *args: Any, **kwargs: Any
    ) -> Iterator[tuple[Task, Entity | None, Node | None]]:
        """Yield the results of :meth:`wait_for_ready_callbacks`; under rclpy's name."""
        while True:
            yield self.wait_for_ready_callbacks(*args, **kwargs)

    def _next_task(self, nodes: tuple[Node, ...]) -> tuple[Task, Entity | None, Node | None] | None:
        with self._tasks_lock:
            if not self._tasks:
                return None
            self._tasks = [entry for entry in self._tasks if not entry[0].done() and not entry[0].cancelled()]
            # None twice before each had its turn.
            for entry in self._tasks if FROM_KILTED else reversed(self._tasks):
                task, _, node = entry
                if task not in self._had_turn and task.can_run() and (node is None or node in nodes):
                    self._had_turn.add(task)
                    return entry
            had_turn = bool(self._had_turn)
            self._had_turn.clear()
        # All have run: tasks that can continue are next, after other ready callbacks.
        if had_turn:
            self._woken = any(entry[0].can_run() for entry in self._tasks)
        return None

    def _next_of_batch(self, nodes: tuple[Node, ...]) -> tuple[Task, Entity | None, Node | None] | None:
        batch = self._batch
        while batch:
            entity, node = batch.popleft()
            if node not in nodes:
                continue
            work = self._work(entity, node)
            if work is not None:
                return work, entity, node
        return None

    def _look_over(self, nodes: tuple[Node, ...]) -> int | None:
        """Collect ready entities; return the nanoseconds until the next one is due."""
        soonest: int | None = None
        for node in nodes:
            for entity in node._rwt_entities:
                try:
                    if entity._rwt_has_work():
                        if self.can_execute(entity):
                            self._batch.append((entity, node))
                        continue
                    due = entity._rwt_due_in_ns()
                except InvalidHandle:
                    continue  # The entity was destroyed meanwhile.
                if due is not None and (soonest is None or due < soonest):
                    soonest = due
        return soonest

    def _work(self, entity: Entity, node: Node) -> CallbackTask | None:
        """Take a callback of an entity, if it is still ready and may run."""
        group = entity.callback_group
        call: Callable[[], object] | None = None
        try:
            if not entity._rwt_has_work() or not group.beginning_execution(entity):
                return None
            try:
                call = entity._rwt_take()
            finally:
                if call is None:
                    group.ending_execution(entity)
        except InvalidHandle:
            return None  # The entity was destroyed meanwhile.
        if call is None:
            return None

        def after() -> None:
            group.ending_execution(entity)
            self._after_work()

        return CallbackTask(call, self, after)

    def _after_work(self) -> None:
        """Handle the end of a callback."""

    def _call(self, task: Task) -> None:
        self._in_callback.now = True
        self._work_tracker.begin()
        try:
            task()
        finally:
            self._work_tracker.end()
            self._in_callback.now = False

    def _keep(self, task: Task, entity: Entity | None, node: Node | None) -> None:
        """Schedule the rest of a coroutine that has not ended."""
        if entity is not None and not task.done():
            with self._tasks_lock:
                self._tasks.append((task, entity, node))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.shutdown()


class SingleThreadedExecutor(Executor):
    """Executor that runs callbacks in the spinning thread."""

    def _spin_once_impl(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        wait_condition: Callable[[], bool] = lambda: False,
    ) -> None:
        with self._keeper.running():
            try:
                with UNINTERRUPTED:
                    task, entity, node = self.wait_for_ready_callbacks(timeout_sec, None, wait_condition)
            except (ShutdownException, TimeoutException, ConditionReachedException):
                return
            self._call(task)
            self._keep(task, entity, node)
            if task.exception() is not None:
                task.result()


class MultiThreadedExecutor(Executor):
    """Executor that runs callbacks in a pool of threads.

    Args:
        num_threads: number of threads; by default the number of processors.
        context: context whose end ends it.
    """

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        super().__init__(context=context)
        if num_threads is None:
            affinity = getattr(os, "sched_getaffinity", None)
            num_threads = len(affinity(0)) if affinity is not None else os.cpu_count()
            num_threads = max(2, num_threads or 2)
        if num_threads == 1:
            warnings.warn(
                "MultiThreadedExecutor is used with a single thread.\n"
                "Use the SingleThreadedExecutor instead.",
                stacklevel=2,
            )
        self._pool = ThreadPoolExecutor(num_threads, thread_name_prefix="rclpy")
        self._executor = self._pool
        self._failed: deque[Task] = deque()

    def _after_work(self) -> None:
        # Callbacks that wait for the callback group may run now.
        self.wake()

    def _run(self, task: Task, entity: Entity | None, node: Node | None) -> None:
        with self._keeper.working():
            self._call(task)
            self._keep(task, entity, node)
            if task.done() and task._exception is not None:
                self._failed.append(task)
            self.wake()

    def _spin_once_impl(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        wait_condition: Callable[[], bool] = lambda: False,
    ) -> None:
        def wanted() -> bool:
            return bool(self._failed) or wait_condition()

        with UNINTERRUPTED, self._keeper.running():
            try:
                task, entity, node = self.wait_for_ready_callbacks(timeout_sec, None, wanted)
            except (
                ShutdownException,
                TimeoutException,
                ExternalShutdownException,
                ConditionReachedException,
            ):
                pass
            else:
                task._waits = True  # Reserved until the pool begins it.
                self._submit(task, entity, node)
        if self._failed:
            self._failed.popleft().result()

    def _submit(self, task: Task, entity: Entity | None, node: Node | None) -> None:
        self._keeper.handed_over()

        def run() -> None:
            task._waits = False
            self._run(task, entity, node)

        self._pool.submit(run)

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool = False) -> bool:
        """Shut down and wait for running callbacks; with `wait_for_threads`, for the threads themselves."""
        done = super().shutdown(timeout_sec)
        self._pool.shutdown(wait=wait_for_threads)
        return done


class EventsExecutor(SingleThreadedExecutor):
    """Executor of callbacks in the spinning thread. All executors here are woken by events, so this is
    :class:`SingleThreadedExecutor` under its other name."""
