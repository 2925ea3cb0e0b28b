"""`rclpy.clock`: clocks, callbacks for time jumps, and sleeping."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

from rwt_rclpy.clocks import timekeeper
from rwt_rclpy.clocks.duration import S_TO_NS, Duration
from rwt_rclpy.clocks.time import ClockType, Time
from rwt_rclpy.destroyable import Destroyable
from rwt_rclpy.exceptions import NotInitializedException
from rwt_rclpy.execution.blocking import Wait

if TYPE_CHECKING:
    from rwt_rclpy.execution.context import Context


class ClockChange(IntEnum):
    """Change of the source of a clock's time."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4

    __str__ = Enum.__str__


#: Changes to another source of time.
SOURCE_CHANGES: Final = (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED)


class JumpThreshold:
    """Threshold of time jumps that call a handler.

    Args:
        min_forward: minimum forward jump, positive; None for none.
        min_backward: minimum backward jump, negative; None for none.
        on_clock_change: True to report activation and deactivation of ROS time.

    Raises:
        ValueError: a sign is wrong, or nothing would be reported.
    """

    def __init__(
        self, *, min_forward: Duration | None, min_backward: Duration | None, on_clock_change: bool = True
    ) -> None:
        if min_forward is not None and min_forward.nanoseconds <= 0:
            raise ValueError("min_forward must be a positive non-zero duration")
        if min_backward is not None and min_backward.nanoseconds >= 0:
            raise ValueError("min_backward must be a negative non-zero duration")
        if min_forward is None and min_backward is None and not on_clock_change:
            raise ValueError("At least one jump threshold must be enabled")
        self.min_forward = min_forward
        self.min_backward = min_backward
        self.on_clock_change = on_clock_change


class TimeJump:
    """Time jump, as passed to callbacks."""

    def __init__(self, clock_change: ClockChange, delta: Duration) -> None:
        if not isinstance(clock_change, ClockChange):
            raise TypeError("clock_change must be an instance of rclpy.clock.ClockChange")
        self._clock_change = clock_change
        self._delta = delta

    @property
    def clock_change(self) -> ClockChange:
        """Change of the source."""
        return self._clock_change

    @property
    def delta(self) -> Duration:
        """Size of the jump."""
        return self._delta


PreCallback: TypeAlias = Callable[[], object]
PostCallback: TypeAlias = Callable[[TimeJump], object]


class JumpHandle:
    """Registered callback, until :meth:`unregister`.

    Raises:
        ValueError: no callback is given, or one is not callable.
    """

    def __init__(
        self,
        *,
        clock: Clock,
        threshold: JumpThreshold,
        pre_callback: PreCallback | None,
        post_callback: PostCallback | None,
    ) -> None:
        if pre_callback is None and post_callback is None:
            raise ValueError("One of pre_callback or post_callback must be callable")
        if pre_callback is not None and not callable(pre_callback):
            raise ValueError("pre_callback must be callable if given")
        if post_callback is not None and not callable(post_callback):
            raise ValueError("post_callback must be callable if given")
        self._clock: Clock | None = clock
        self.threshold = threshold
        self.pre_callback = pre_callback
        self.post_callback = post_callback
        clock.handle.jumps.append(self)

    def exceeded(self, change: ClockChange, delta_ns: int) -> bool:
        """True if a jump exceeds the threshold."""
        if change in SOURCE_CHANGES:
            return self.threshold.on_clock_change
        forward, backward = self.threshold.min_forward, self.threshold.min_backward
        if forward is not None and delta_ns >= forward.nanoseconds:
            return True
        return backward is not None and delta_ns <= backward.nanoseconds

    def unregister(self) -> None:
        """Stop reporting jumps."""
        if self._clock is not None:
            self._clock.handle.jumps.remove(self)
            self._clock = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.unregister()


class ClockHandle(Destroyable):
    """State of a clock.

    Attributes:
        override_ns: ROS time that was set; None while the clock follows the system's.
        jumps: handlers of jumps.
        watchers: called after each change, to wake waiting threads.
    """

    def __init__(self, clock_type: ClockType) -> None:
        super().__init__()
        self.clock_type = clock_type
        self.override_ns: int | None = None
        self.last_set_ns = 0
        self.jumps: list[JumpHandle] = []
        self.watchers: weakref.WeakSet[Any] = weakref.WeakSet()

    def now_ns(self) -> int:
        """Return the current time."""
        if self.override_ns is not None:
            return self.override_ns
        keeper = timekeeper.current()
        return keeper.steady_ns() if self.clock_type is ClockType.STEADY_TIME else keeper.system_ns()

    def set_override(self, time_ns: int | None, *, change: bool) -> None:
        """Set the time, and report the jump.

        Args:
            time_ns: new ROS time; None to follow the system's again.
            change: change of the source of time.
        """
        before = self.now_ns()
        after = timekeeper.current().system_ns() if time_ns is None else time_ns
        kind = ClockChange.ROS_TIME_NO_CHANGE
        if change:
            kind = ClockChange.ROS_TIME_DEACTIVATED if time_ns is None else ClockChange.ROS_TIME_ACTIVATED
        told = [jump for jump in tuple(self.jumps) if jump.exceeded(kind, after - before)]
        for jump in told:
            if jump.pre_callback is not None:
                jump.pre_callback()
        self.override_ns = time_ns
        for jump in told:
            if jump.post_callback is not None:
                jump.post_callback(TimeJump(kind, Duration(nanoseconds=0 if change else after - before)))
        for watcher in tuple(self.watchers):
            watcher._rwt_clock_changed()


class Clock:
    """Clock. Clocks of type ROS_TIME are of the class :class:`ROSClock`."""

    _handle: ClockHandle
    _clock_type: ClockType

    def __new__(cls, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> Clock:
        """Create a clock of a type. Raises TypeError if it is not a ClockType."""
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        self = super().__new__(ROSClock if clock_type is ClockType.ROS_TIME else cls)
        self._clock_type = clock_type
        self._handle = ClockHandle(clock_type)
        return self

    @property
    def clock_type(self) -> ClockType:
        """Type of the clock."""
        return self._clock_type

    @property
    def handle(self) -> ClockHandle:
        """State of the clock."""
        return self._handle

    def __repr__(self) -> str:
        return f"Clock(clock_type={self._clock_type.name})"

    def now(self) -> Time:
        """Return the current time."""
        return Time(nanoseconds=self._handle.now_ns(), clock_type=self._clock_type)

    def create_jump_callback(
        self,
        threshold: JumpThreshold,
        *,
        pre_callback: PreCallback | None = None,
        post_callback: PostCallback | None = None,
    ) -> JumpHandle:
        """Register callbacks before and after jumps. Raises ValueError if one is not callable."""
        return JumpHandle(
            clock=self, threshold=threshold, pre_callback=pre_callback, post_callback=post_callback
        )

    def sleep_until(self, until: Time, context: Context | None = None) -> bool:
        """Sleep until the clock has reached a time.

        Returns:
            True if the time was reached; False if the context was shut down or the source of time changed.

        Raises:
            NotInitializedException: the context is not initialised.
            ValueError: the time is of another clock type.
        """
        from rwt_rclpy.execution.context import get_default_context

        context = context or get_default_context()
        if not context.ok():
            raise NotInitializedException("a clock cannot sleep")
        if until.clock_type != self._clock_type:
            raise ValueError("until's clock type does not match this clock's type")
        wait, source_changed = Wait(context), False

        def jumped(jump: TimeJump) -> None:
            nonlocal source_changed
            source_changed = source_changed or jump.clock_change in SOURCE_CHANGES
            wait.wake()

        def left() -> int:
            return 0 if source_changed else max(0, until.nanoseconds - self._handle.now_ns())

        threshold = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None)
        with self.create_jump_callback(threshold, post_callback=jumped):
            while context.ok() and left():
                elapses = self._handle.override_ns is None
                wait.until(lambda: not left(), left() / S_TO_NS if elapses else None)
        return context.ok() and not source_changed

    def sleep_for(self, rel_time: Duration, context: Context | None = None) -> bool:
        """Sleep for a duration of this clock's time; see :meth:`sleep_until`."""
        return self.sleep_until(self.now() + rel_time, context)


class ROSClock(Clock):
    """Clock that follows the system's, or `/clock` if ROS time is active."""

    def __new__(cls) -> ROSClock:
        """Create a clock."""
        self = super().__new__(Clock, clock_type=ClockType.ROS_TIME)
        assert isinstance(self, ROSClock)  # Clock creates instances of this class.
        return self

    @property
    def ros_time_is_active(self) -> bool:
        """True if the clock follows `/clock` instead of the system."""
        return self._handle.override_ns is not None

    def _set_ros_time_is_active(self, enabled: bool) -> None:
        if enabled != self.ros_time_is_active:
            self._handle.set_override(self._handle.last_set_ns if enabled else None, change=True)

    def set_ros_time_override(self, time: Time) -> None:
        """Set the time for active ROS time. Raises TypeError if it is not a Time."""
        if not isinstance(time, Time):
            raise TypeError(f"Time must be specified as rclpy.time.Time. Received type: {type(time)}")
        self._handle.last_set_ns = time.nanoseconds
        if self.ros_time_is_active:
            self._handle.set_override(time.nanoseconds, change=False)
