"""Timers of robot programs: they repeat, keep their grid, and may be set back."""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from contextlib import AbstractContextManager
from typing import Final, Protocol

from rwt_participant.messages import is_coroutine_function

logger = logging.getLogger(__name__)

#: Seconds; a clock has whole nanoseconds, and a shorter period would leave it no time for anything else.
SHORTEST_PERIOD: Final = 1e-6

#: Seconds, some thirty years: a timer that is due later is due then, so that no sum of times overflows.
LONGEST_DELAY: Final = 1e9

#: Seconds: a timer that fires exactly on its tick must not take the rounding for a missed one.
_ROUNDING: Final = 1e-9


class Timer(ABC):
    """A callback that is due at some time."""

    @abstractmethod
    def cancel(self) -> None:
        """Drop the callback; may be called twice, and after the timer has run."""


class TimerClock(Protocol):
    """Steady time, and callbacks when some of it has gone by."""

    def monotonic(self) -> float:
        """Seconds since some moment; never goes back."""

    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        """Run `call` once, `delay` seconds from now."""


class RobotClock(TimerClock, Protocol):
    """Clock of a robot program: timers, and waiting."""

    async def sleep(self, seconds: float) -> None:
        """Wait for so many seconds of this clock."""

    def within(self, seconds: float | None) -> AbstractContextManager[object]:
        """Leave the block after so many seconds of this clock; None sets no limit. In tasks only."""


class TimerLoop(Protocol):
    """Where callbacks of timers run."""

    def soon(self, call: Callable[[], None]) -> None:
        """Run a plain function on the loop's thread: at once there, soon from elsewhere."""

    def spawn(self, function: Callable[[], Awaitable[None]], name: str) -> None:
        """Run a coroutine function as a task; on the loop's thread only."""


class PeriodicTimer(Timer):
    """Calls back every `period` seconds of a clock, on a grid that does not drift.

    Args:
        loop: where `callback` runs.
        period: seconds, from :data:`SHORTEST_PERIOD` to :data:`LONGEST_DELAY`.
        callback: a plain or a coroutine function.
        on_cancel: told when the timer is cancelled.

    Raises:
        ValueError: `period` is out of its range.
    """

    def __init__(
        self,
        clock: TimerClock,
        loop: TimerLoop,
        period: float,
        callback: Callable[[], Awaitable[None] | None],
        on_cancel: Callable[[PeriodicTimer], None] = lambda timer: None,
    ) -> None:
        # Written so that what is no number is refused too.
        if not SHORTEST_PERIOD <= period <= LONGEST_DELAY:
            raise ValueError(
                f"a timer's period is from {SHORTEST_PERIOD:g} to {LONGEST_DELAY:g} s, which this is not"
            )
        self._clock = clock
        self._loop = loop
        self._period = period
        self._callback = callback
        self._is_coroutine = is_coroutine_function(callback)
        self._on_cancel = on_cancel
        self._started_at = 0.0
        self._tick = 0
        self._timer: Timer | None = None
        self._busy = False
        self._cancelled = False

    def start(self) -> None:
        """Start the timer, on the loop's thread; the first call is one period away."""
        self._started_at = self._clock.monotonic()
        self._arm()

    def reset(self) -> None:
        """Let the next call be one whole period from now, from any thread; of a cancelled timer nothing."""
        now = self._clock.monotonic()
        self._loop.soon(lambda: self._restart(now))

    def cancel(self) -> None:
        """Stop the timer, from any thread; a coroutine callback that has begun goes on."""
        self._cancelled = True
        self._loop.soon(self._stop)

    def _restart(self, now: float) -> None:
        # What the clock has been told stays: when it comes up, it finds that it is not due.
        self._started_at = now
        self._tick = 1

    @property
    def _due(self) -> float:
        return self._started_at + self._tick * self._period

    def _arm(self) -> None:
        now = self._clock.monotonic()
        self._tick = max(self._tick + 1, math.ceil((now - self._started_at) / self._period - _ROUNDING))
        self._wait(now)

    def _wait(self, now: float) -> None:
        self._timer = self._clock.call_later(max(0.0, self._due - now), self._fire)

    def _fire(self) -> None:
        if self._cancelled:
            return
        now = self._clock.monotonic()
        if now < self._due - _ROUNDING:
            self._wait(now)
            return
        self._arm()
        if self._busy:
            return
        if self._is_coroutine:
            self._busy = True
            self._loop.spawn(self._call_in_task, "timer")
            return
        try:
            self._callback()
        except Exception:
            logger.exception("a timer's callback failed")

    async def _call_in_task(self) -> None:
        try:
            returned = self._callback()
            if returned is not None:
                await returned
        finally:
            self._busy = False

    def _stop(self) -> None:
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
        self._on_cancel(self)
