"""Threads for handlers that block: a bounded pool, used through `threaded=True` of the verbs."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
import threading
from collections import deque
from collections.abc import Awaitable, Callable
from contextvars import Context, copy_context
from typing import Any, Final, Generic, TypeAlias, TypeVar, cast

import anyio

from rwt_participant.messages import is_coroutine_function

logger = logging.getLogger(__name__)

T = TypeVar("T")

HANDLER_THREADS: Final = 32
"""Default maximum number of handlers that run in threads at the same time."""

CallSoon: TypeAlias = Callable[[Callable[[], object]], object]
"""Runs a call on the event loop's thread, soon."""


def call_soon_threadsafe() -> CallSoon:
    """Return the thread-safe `call_soon` of the running event loop, asyncio's or trio's."""
    try:
        return asyncio.get_running_loop().call_soon_threadsafe
    except RuntimeError:
        import trio  # Available only in programs that run on trio.

        return trio.lowlevel.current_trio_token().run_sync_soon


class _Call(Generic[T]):
    """Call of a handler in a thread; `outcome` is set before `done`."""

    def __init__(self, function: Callable[[], T], context: Context, call_soon: CallSoon) -> None:
        self._function = function
        self._context = context
        self._call_soon = call_soon
        self._outcome: tuple[T | None, BaseException | None] = (None, None)
        self.done = anyio.Event()
        self.is_cancelled = False

    def run(self) -> None:
        try:
            self._outcome = (self._context.run(self._function), None)
        except BaseException as error:
            if self.is_cancelled:
                logger.info("a handler failed after its call had been cancelled: %r", error)
            self._outcome = (None, error)
        with contextlib.suppress(RuntimeError):  # The loop has already ended.
            self._call_soon(self.done.set)

    def result(self) -> T:
        value, error = self._outcome
        if error is not None:
            raise error
        return value  # type: ignore[return-value] # None only if it is the function's result.


class HandlerThreads:
    """Bounded pool of threads for the plain handlers of a program.

    The threads are daemons: a handler that never returns does not keep the program alive. Its thread counts
    as busy until it returns, also after its call has been cancelled.

    Attributes:
        size: maximum number of threads; may be set at any time.
        busy: number of threads now.
        waits: calls that have had to wait for a thread.
    """

    def __init__(self, size: int = HANDLER_THREADS) -> None:
        self.size = size
        self.busy = 0
        self.waits = 0
        self._lock = threading.Lock()
        self._waiting: deque[_Call[Any]] = deque()
        self._has_warned = False

    @property
    def waiting(self) -> int:
        """Number of calls that wait for a thread now."""
        return len(self._waiting)

    def coroutine(self, function: Callable[..., T | Awaitable[T]]) -> Callable[..., Awaitable[T]]:
        """Return a coroutine function that runs a plain function in a thread.

        Raises:
            TypeError: it is a coroutine function itself.
        """
        if is_coroutine_function(function):
            raise TypeError(
                f"threaded=True: expected a plain function, got the coroutine function {function!r}"
            )
        plain = cast("Callable[..., T]", function)

        async def run(*args: object) -> T:
            return await self.run(functools.partial(plain, *args))

        return run

    async def run(self, function: Callable[[], T]) -> T:
        """Run a function in a thread and return or raise what it does; wait while all threads are busy."""
        call = _Call(function, copy_context(), call_soon_threadsafe())
        with self._lock:
            is_full = self.busy >= self.size
            if is_full:
                self.waits += 1
                self._waiting.append(call)
            else:
                self.busy += 1
        if is_full:
            self._warn(function)
        else:
            threading.Thread(target=self._work, args=(call,), name="rwt handler", daemon=True).start()
        try:
            await call.done.wait()
        except BaseException:
            call.is_cancelled = True
            with contextlib.suppress(ValueError):  # It has begun.
                self._waiting.remove(call)
            raise
        return call.result()

    def _work(self, call: _Call[Any]) -> None:
        while True:
            call.run()
            with self._lock:
                if not self._waiting or self.busy > self.size:
                    self.busy -= 1
                    self._has_warned = self._has_warned and bool(self._waiting)
                    return
                call = self._waiting.popleft()

    def _warn(self, function: Callable[[], object]) -> None:
        """Log once, until calls no longer wait."""
        if self._has_warned:
            return
        self._has_warned = True
        while isinstance(function, functools.partial):
            function = function.func
        logger.warning(
            "all %d threads for handlers are busy: %s waits for one; `handler_threads.size` allows more",
            self.size,
            getattr(function, "__qualname__", None) or repr(function),
        )
