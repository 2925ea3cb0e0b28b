"""`rclpy.task`: futures, and tasks that an executor runs.

A coroutine that waits for a future is resumed once the future is done; waiting has no cost.
"""

from __future__ import annotations

import inspect
import sys
import threading
import warnings
import weakref
from collections.abc import Callable, Coroutine, Generator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rwt_protocol.states import StateEnum

if TYPE_CHECKING:
    from rwt_rclpy.execution.executors import Executor

Callback = Callable[["Future"], object]


class _Awaited(threading.local):
    """Future that the coroutine of this thread awaits. It is not yielded: asyncio accepts None alone."""

    future: Future | None = None

    def take(self) -> Future | None:
        """Return it, and forget it."""
        future, self.future = self.future, None
        return future


_awaited = _Awaited()


class _FutureState(StateEnum):
    PENDING = "CANCELLED", "DONE"
    CANCELLED = "CANCELLED", "DONE"
    DONE = "DONE"


class Future:
    """Result that will be known later.

    Life cycle::

        PENDING ── set_result(), set_exception() ──> DONE
           └── cancel() ──> CANCELLED ── set_… ───────^

    As in rclpy, a result can be set after `cancel()`, and a later one replaces it.

    Args:
        executor: runs the callbacks; without one they run in the thread that sets the future.
    """

    def __init__(self, *, executor: Executor | None = None) -> None:
        self._state = _FutureState.PENDING
        self._result: Any = None
        self._exception: BaseException | None = None
        self._exception_fetched = False
        self._callbacks: list[Callback] = []
        self._resume: list[Callable[[], None]] = []
        self._lock = threading.Lock()
        self._executor: weakref.ref[Executor] | None = None
        self._set_executor(executor)

    def __del__(self) -> None:
        if self._exception is not None and not self._exception_fetched:
            print(f"The following exception was never retrieved: {self._exception}", file=sys.stderr)  # noqa: T201 - the same output as rclpy

    def __await__(self) -> Generator[None, None, Any]:
        while self._state is not _FutureState.DONE:
            _awaited.future = self
            yield
        return self.result()

    def cancel(self) -> None:
        """Cancel the future, unless it is done."""
        with self._lock:
            if self._state is not _FutureState.DONE:
                self._state = self._state.become(_FutureState.CANCELLED)
        self._tell()

    def cancelled(self) -> bool:
        """True if the future was cancelled."""
        return self._state is _FutureState.CANCELLED

    def done(self) -> bool:
        """True if the future has a result or an exception."""
        return self._state is _FutureState.DONE

    def result(self) -> Any:
        """Return the result, None if there is none; raise the exception if one was set."""
        if self._exception is not None:
            self._exception_fetched = True
            raise self._exception
        return self._result

    def exception(self) -> BaseException | None:
        """Return the exception that was set, or None."""
        self._exception_fetched = True
        return self._exception

    def set_result(self, result: Any) -> None:
        """Set the result, and call the callbacks."""
        with self._lock:
            self._result = result
            self._state = self._state.become(_FutureState.DONE)
        self._tell()

    def set_exception(self, exception: BaseException) -> None:
        """Set an exception, and call the callbacks."""
        with self._lock:
            self._exception = exception
            self._exception_fetched = False
            self._state = self._state.become(_FutureState.DONE)
        self._tell()

    def _tell(self) -> None:
        with self._lock:
            executor = self._executor() if self._executor is not None else None
            callbacks, self._callbacks = self._callbacks, []
            resume, self._resume = self._resume, []
        for each in resume:
            each()
        for callback in callbacks:
            if executor is not None:
                executor.create_task(callback, self)
                continue
            try:
                callback(self)
            except Exception as error:
                warnings.warn(f"Unhandled exception in done callback: {error}", stacklevel=2)

    def _set_executor(self, executor: Executor | None) -> None:
        with self._lock:
            self._executor = None if executor is None else weakref.ref(executor)

    def add_done_callback(self, callback: Callback) -> None:
        """Call a function with the future once it is done; now, or by the executor, if it is done already."""
        with self._lock:
            if self._state is not _FutureState.DONE:
                self._callbacks.append(callback)
                return
            executor = self._executor() if self._executor is not None else None
        if executor is not None:
            executor.create_task(callback, self)
        else:
            callback(self)

    def remove_done_callback(self, callback: Callback) -> bool:
        """Remove a callback. Returns False if it was not registered."""
        with self._lock:
            count = len(self._callbacks)
            self._callbacks = [each for each in self._callbacks if each != callback]
            return len(self._callbacks) != count

    def _rwt_resume_with(self, resume: Callable[[], None]) -> None:
        """Call a function once it is done or cancelled, on the thread that sets it; now if it is already."""
        with self._lock:
            if self._state is _FutureState.PENDING:
                if resume not in self._resume:
                    self._resume.append(resume)
                return
        resume()


class Task(Future):
    """Function or coroutine run by an executor; the future is done when it has ended.

    Args:
        handler: function, coroutine function, or coroutine.
        args: arguments of the function.
        kwargs: keyword arguments of the function.
        executor: runs the callbacks, and is woken when the task can continue.
    """

    def __init__(
        self,
        handler: Any,
        args: Sequence[Any] | None = None,
        kwargs: Mapping[str, Any] | None = None,
        executor: Executor | None = None,
    ) -> None:
        super().__init__(executor=executor)
        self._handler = handler
        self._args: Sequence[Any] = args or ()
        self._kwargs: Mapping[str, Any] = kwargs or {}
        if inspect.iscoroutinefunction(handler):
            self._handler = handler(*self._args, **self._kwargs)
        self._executing = False
        self._waits = False
        self._task_lock = threading.Lock()

    def __call__(self) -> None:
        """Run or continue until it ends or waits."""
        is_over = self._state is not _FutureState.PENDING
        if is_over or self._executing or not self._task_lock.acquire(blocking=False):
            return
        try:
            self._executing = True
            if inspect.iscoroutine(self._handler):
                self._step(self._handler)
            else:
                self._run()
        finally:
            self._executing = False
            self._task_lock.release()

    def _run(self) -> None:
        try:
            result = self._handler(*self._args, **self._kwargs)
        except Exception as error:
            self._end()
            self.set_exception(error)
        else:
            self._end()
            self.set_result(result)

    def _step(self, coroutine: Coroutine[Any, None, Any]) -> None:
        _awaited.future = None
        try:
            coroutine.send(None)
        except StopIteration as end:
            self._end()
            self.set_result(end.value)
        except Exception as error:
            self._end()
            self.set_exception(error)
        else:
            future = _awaited.take()
            if future is not None:
                self._waits = True
                future._rwt_resume_with(self._go_on)

    def _go_on(self) -> None:
        self._waits = False
        executor = self._executor() if self._executor is not None else None
        if executor is not None:
            executor.wake()

    def _end(self) -> None:
        self._handler = None
        self._args, self._kwargs = (), {}

    def executing(self) -> bool:
        """True while the task runs."""
        return self._executing

    def can_run(self) -> bool:
        """True if the task can make progress."""
        return not (self._waits or self._executing or self._state is _FutureState.DONE)


class CallbackTask(Task):
    """Callback of an entity, with the actions after it."""

    def __init__(self, call: Callable[[], object], executor: Executor, after: Callable[[], None]) -> None:
        super().__init__(call, executor=executor)
        self._after: Callable[[], None] | None = after

    def _run(self) -> None:
        try:
            result = self._handler()
        except Exception as error:
            self._end()
            self.set_exception(error)
            return
        if inspect.iscoroutine(result):
            self._handler = result
            self._step(result)
        else:
            self._end()
            self._result = result
            self._state = self._state.become(_FutureState.DONE)
            if self._callbacks or self._resume:
                self._tell()

    def _end(self) -> None:
        super()._end()
        after, self._after = self._after, None
        if after is not None:
            after()
