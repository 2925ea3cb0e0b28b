"""Timers of robot programs, and the watchdog for commands that is built on them."""

from __future__ import annotations

import logging
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from contextlib import AbstractContextManager
from typing import Final, Protocol, Self

from rwt_participant.messages import HELD_SECONDS, is_coroutine_function, warn_of_held_loop

logger = logging.getLogger(__name__)

#: Minimum period in seconds; clocks count nanoseconds, and a shorter one would starve all other work.
SHORTEST_PERIOD: Final = 1e-6

#: Maximum delay in seconds, some thirty years; a later timer is due then, so that no sum of times overflows.
LONGEST_DELAY: Final = 1e9

#: Tolerance in seconds, so that rounding is not taken for a missed tick.
_ROUNDING: Final = 1e-9


class Timer(ABC):
    """Callback that is due at some time."""

    @abstractmethod
    def cancel(self) -> None:
        """Drop the callback. No-op if it was called or dropped."""


class RobotClock(Protocol):
    """Clock of a robot program: timers, and waiting."""

    def monotonic(self) -> float:
        """Return seconds since some moment."""

    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        """Run `call` once, `delay` seconds from now."""

    async def sleep(self, seconds: float) -> None:
        """Wait for so many seconds of this clock."""

    def within(self, seconds: float | None) -> AbstractContextManager[object]:
        """Leave the block after so many seconds of this clock; None sets no limit. In tasks only."""


class TimerLoop(Protocol):
    """Event loop that runs the callbacks of timers."""

    def soon(self, call: Callable[[], None]) -> None:
        """Run a plain function on the loop's thread: at once there, soon from elsewhere."""

    def spawn(self, function: Callable[[], Awaitable[None]], name: str) -> None:
        """Run a coroutine function as a task; on the loop's thread only."""


class ResettableTimer(ABC):
    """Timer of a robot program: :class:`PeriodicTimer`, or the blocking form of it."""

    @abstractmethod
    def reset(self) -> None:
        """Postpone the next call by one whole period."""

    @abstractmethod
    def cancel(self) -> None:
        """Stop the timer."""


class PeriodicTimer(Timer, ResettableTimer):
    """Timer of :meth:`~rwt_participant.api.RobotApi.create_timer`, on a grid that does not drift."""

    def __init__(
        self,
        clock: RobotClock,
        loop: TimerLoop,
        period: float,
        callback: Callable[[], Awaitable[None] | None],
        on_cancel: Callable[[PeriodicTimer], None] = lambda timer: None,
    ) -> None:
        if not callable(callback) or not isinstance(period, (int, float)):
            raise TypeError(f"create_timer(period, callback): got {period!r} and {callback!r}")
        # Written so that NaN is rejected, too.
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
        """Postpone the next call to one whole period from now, from any thread. No-op if it is cancelled."""
        now = self._clock.monotonic()
        self._loop.soon(lambda: self._restart(now))

    def cancel(self) -> None:
        """Stop the timer, from any thread; a coroutine callback that has begun goes on."""
        self._cancelled = True
        self._loop.soon(self._stop)

    def _restart(self, now: float) -> None:
        # The clock keeps its callback, which finds that the timer is not due yet.
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
            began = time.perf_counter()
            self._callback()
            if (took := time.perf_counter() - began) >= HELD_SECONDS:
                warn_of_held_loop(self._callback, "timer callback", took)
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


class HasTimers(Protocol):
    """Robot with timers: :class:`~rwt_participant.api.RobotApi`, or its blocking form."""

    def create_timer(self, period: float, callback: Callable[[], None], /) -> ResettableTimer:
        """Call `callback` every `period` seconds."""


class Watchdog:
    """Watchdog for commands: calls `stop` once if none has arrived for `timeout` seconds.

    >>> def drive(twist):
    ...     watchdog.feed()
    ...     motors.publish({"data": twist.linear.x})
    >>> with Watchdog(robot, 0.5, stop) as watchdog:
    ...     robot.subscribe("/cmd_vel", drive, "geometry_msgs/Twist")
    ...     await anyio.sleep_forever()

    The next command arms it again. `stop` is also called at the end of the `with` block, and therefore if a
    signal or an error ends the program. It is not called in a process that was killed, or while a callback
    blocks the event loop; a motor controller needs its own watchdog for these cases.

    Args:
        robot: node or client, awaited or blocking; its timers count the seconds, simulated ones if the node's
            graph is.
        timeout: seconds from the last command, or the last :meth:`feed`, to the stop.
        stop: plain function without arguments, called on the thread of the graph or the connection, and at
            the end of the block on the thread that leaves it. It should be fast. If it raises, that is
            logged, and it is called again `timeout` seconds later.

    Attributes:
        running: True while commands arrive; False before the first, and from the stop to the next.

    Raises:
        TypeError: `stop` is not a function, or is a coroutine function, which might never finish.
        ValueError: `timeout` is shorter than a microsecond, or longer than some thirty years.
    """

    def __init__(self, robot: HasTimers, timeout: float, stop: Callable[[], None]) -> None:
        if not callable(stop) or is_coroutine_function(stop):
            raise TypeError(f"a watchdog's stop is a plain function, got {stop!r}")
        self._stop = stop
        self.running = False
        self._timer = robot.create_timer(timeout, self._expire)

    def feed(self) -> None:
        """Note a command. Call it at the beginning of the callback."""
        self._timer.reset()
        self.running = True

    def close(self) -> None:
        """Stop the watchdog without calling `stop`. No-op if it is closed."""
        self._timer.cancel()
        self.running = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        try:
            self.close()
        finally:
            self._stop()

    def _expire(self) -> None:
        if self.running:
            self._stop()
            self.running = False
