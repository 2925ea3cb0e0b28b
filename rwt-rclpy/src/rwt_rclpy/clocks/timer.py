"""`rclpy.timer`: timers and rates."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

from rwt_rclpy.clocks.clock import SOURCE_CHANGES, Clock, JumpThreshold, TimeJump
from rwt_rclpy.clocks.duration import Duration
from rwt_rclpy.clocks.time import ClockType, Time
from rwt_rclpy.destroyable import Closable, Destroyable
from rwt_rclpy.exceptions import InvalidHandle, RCLError, ROSInterruptException
from rwt_rclpy.execution.blocking import Wait
from rwt_rclpy.execution.entity import Entity
from rwt_rclpy.release import FROM_KILTED

if TYPE_CHECKING:
    from rwt_rclpy.execution.callback_groups import CallbackGroup
    from rwt_rclpy.execution.context import Context


class _TimerInfo:
    """Expected and actual time of a timer's call.

    Attributes:
        expected_call_time: time at which it was due.
        actual_call_time: time of the call.
    """

    def __init__(
        self,
        *,
        expected_call_time: int = 0,
        actual_call_time: int = 0,
        clock_type: ClockType = ClockType.SYSTEM_TIME,
    ) -> None:
        self.expected_call_time = Time(nanoseconds=expected_call_time, clock_type=clock_type)
        self.actual_call_time = Time(nanoseconds=actual_call_time, clock_type=clock_type)


_TimerInfo.__name__ = _TimerInfo.__qualname__ = "TimerInfo"
if FROM_KILTED:
    TimerInfo = _TimerInfo


class TimerHandle(Destroyable):
    """State of a timer, in nanoseconds of its clock."""

    def __init__(self, clock: Clock, period_ns: int, autostart: bool) -> None:
        super().__init__()
        self._clock = clock.handle
        self.period_ns = period_ns
        self.canceled = not autostart
        now = self._clock.now_ns()
        self.last_ns = now
        self.next_ns = now + period_ns

    def is_timer_ready(self) -> bool:
        """True if the timer is due."""
        return not self.canceled and bool(self) and self._clock.now_ns() >= self.next_ns

    def until_next(self) -> int | None:
        """Return the nanoseconds of its clock until it is due; None if it was cancelled."""
        return None if self.canceled else self.next_ns - self._clock.now_ns()

    def call(self) -> _TimerInfo:
        """Count one call: the next is due a whole number of periods later."""
        now, expected = self._clock.now_ns(), self.next_ns
        self.last_ns = now
        self.next_ns += self.period_ns
        if self.next_ns <= now:
            if self.period_ns == 0:
                self.next_ns = now
            else:
                self.next_ns += ((now - self.next_ns) // self.period_ns + 1) * self.period_ns
        return _TimerInfo(
            expected_call_time=max(0, expected), actual_call_time=now, clock_type=self._clock.clock_type
        )

    def is_beyond_a_period(self) -> bool:
        """True if the timer is due later than a period from now."""
        return self.next_ns - self.period_ns > self._clock.now_ns()

    def reset(self) -> None:
        """Restart the period."""
        now = self._clock.now_ns()
        self.last_ns, self.next_ns = now, now + self.period_ns
        self.canceled = False


class Timer(Entity, Closable):
    """Timer that calls a function periodically.

    Args:
        callback: takes no argument, or a `TimerInfo`.
        callback_group: group of the callback.
        timer_period_ns: period in nanoseconds.
        clock: clock of the period.
        context: context whose end ends the timer.
        autostart: True to run from the start, else from the first :meth:`reset`.
    """

    _handle: TimerHandle

    def __init__(
        self,
        callback: Callable[..., object] | None,
        callback_group: CallbackGroup | None,
        timer_period_ns: int,
        clock: Clock,
        *,
        context: Context | None = None,
        autostart: bool = True,
    ) -> None:
        super().__init__(callback_group)
        if timer_period_ns < 0:
            raise RCLError("failed to create timer: timer period must be non-negative")
        if timer_period_ns >= 2**63:
            raise TypeError(f"a timer's period of {timer_period_ns} ns does not fit 64 bits")
        self._clock = clock
        self._context = context
        self._handle = TimerHandle(clock, int(timer_period_ns), autostart)
        self.callback = callback
        clock.handle.watchers.add(self)
        self._jump = (
            clock.create_jump_callback(
                JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1)),
                post_callback=self._jumped,
            )
            if clock.clock_type is ClockType.ROS_TIME
            else None
        )

    def _jumped(self, jump: TimeJump) -> None:
        # The source of time changed, or time went back by more than a period: restart the period.
        other_source = jump.clock_change in SOURCE_CHANGES
        if not self._handle.canceled and (other_source or self._handle.is_beyond_a_period()):
            self._handle.reset()

    def _rwt_clock_changed(self) -> None:
        """Wake waiting threads after the clock was set."""
        self._rwt_wake()

    @property
    def handle(self) -> TimerHandle:
        """Its state."""
        return self._handle

    @property
    def clock(self) -> Clock:
        """Clock of the timer."""
        return self._clock

    @property
    def timer_period_ns(self) -> int:
        """Period in nanoseconds; writable."""
        self._handle.check()
        return self._handle.period_ns

    @timer_period_ns.setter
    def timer_period_ns(self, value: float) -> None:
        self._handle.check()
        self._handle.period_ns = int(value)
        self._rwt_wake()

    @property
    def callback(self) -> Callable[..., object] | None:
        """Callback of the timer; writable."""
        return self._callback

    @callback.setter
    def callback(self, callback: Callable[..., object] | None) -> None:
        self._callback = callback
        self._with_info = callback is not None and _takes_info(callback)

    def destroy(self) -> None:
        """Destroy the timer."""
        super().destroy()
        if self._jump is not None:
            self._jump.unregister()
            self._jump = None
        self._clock.handle.watchers.discard(self)

    def is_ready(self) -> bool:
        """True if the timer is due."""
        with self._handle:
            return self._handle.is_timer_ready()

    def is_canceled(self) -> bool:
        """True if the timer was cancelled."""
        with self._handle:
            return self._handle.canceled

    def cancel(self) -> None:
        """Stop calling until :meth:`reset`."""
        with self._handle:
            self._handle.canceled = True

    def reset(self) -> None:
        """Restart the period."""
        with self._handle:
            self._handle.reset()
        self._rwt_wake()

    def time_since_last_call(self) -> int:
        """Return the nanoseconds since the last call, or since creation."""
        with self._handle:
            return self._clock.handle.now_ns() - self._handle.last_ns

    def time_until_next_call(self) -> int | None:
        """Return the nanoseconds until the next call, negative if overdue; None if it was cancelled."""
        with self._handle:
            return self._handle.until_next()

    # Interface of executors

    def _rwt_has_work(self) -> bool:
        """True if the timer is due."""
        return self._handle.is_timer_ready()

    def _rwt_due_in_ns(self) -> int | None:
        """Return the nanoseconds until it is due; None if that does not depend on elapsed time alone."""
        if self._clock.handle.override_ns is not None:
            return None
        return self._handle.until_next()

    def _rwt_take(self) -> Callable[[], Coroutine[Any, Any, object] | object] | None:
        """Return the due call."""
        if not self._handle or self._handle.canceled:
            return None
        info = self._handle.call()
        callback = self._callback
        if callback is None:
            return None
        return (lambda: callback(info)) if self._with_info else callback


def _takes_info(callback: Callable[..., object]) -> bool:
    """True if a callback has a parameter for a `TimerInfo`: one that is annotated so, or without a
    default."""
    if not FROM_KILTED:
        return False
    try:
        parameters = inspect.signature(callback).parameters.values()
    except (TypeError, ValueError):
        return False
    wanted = [
        each
        for each in parameters
        if each.kind in (each.POSITIONAL_ONLY, each.POSITIONAL_OR_KEYWORD)
        and (each.default is each.empty or each.annotation in (_TimerInfo, "TimerInfo"))
    ]
    return len(wanted) == 1


class Rate:
    """Rate that sleeps to the end of each period. An executor must run in another thread.

    If a period ends while no thread sleeps, the next sleep ends at once.
    """

    def __init__(self, timer: Timer, *, context: Context) -> None:
        self._timer = timer
        self._context = context
        self._wait = Wait(context)
        self._lock = threading.Lock()
        self._is_destroyed = False
        self._is_due = False
        self._sleepers = 0
        timer.callback = self._tick

    def _tick(self) -> None:
        self._is_due = True
        self._wait.wake()

    def destroy(self) -> None:
        """Wake sleeping threads, and end the rate."""
        self._is_destroyed = True
        self._wait.wake()

    def sleep(self) -> None:
        """Sleep to the end of the period.

        Raises:
            ROSInterruptException: the context was shut down.
            RuntimeError: the rate was destroyed.
            InvalidHandle: its timer was destroyed.
        """
        if not self._context.ok():
            raise ROSInterruptException
        if self._is_destroyed:
            raise RuntimeError("Rate cannot sleep because it has been destroyed")
        if not self._timer.handle:
            self.destroy()
            raise InvalidHandle("Rate cannot sleep because the timer has been destroyed")
        with self._lock:
            self._sleepers += 1
        try:
            self._wait.until(lambda: self._is_due or self._is_destroyed)
        finally:
            with self._lock:
                self._sleepers -= 1
                if not self._sleepers:
                    self._is_due = False
        if not self._context.ok():
            raise ROSInterruptException
