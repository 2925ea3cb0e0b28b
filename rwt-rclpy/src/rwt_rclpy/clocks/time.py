"""`rclpy.time`: points in time."""

from __future__ import annotations

from enum import Enum, IntEnum
from functools import total_ordering
from typing import Any, Final, overload

from rwt_rclpy.clocks.duration import INT64_MAX, S_TO_NS, Duration
from rwt_rclpy.messages.loaded import message_class

CONVERSION_CONSTANT: Final = S_TO_NS


class ClockType(IntEnum):
    """`rclpy.clock_type`: type of clock of a time."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3

    __str__ = Enum.__str__


@total_ordering
class Time:
    """Point in time of a clock type. Times of different types cannot be compared.

    Raises:
        ValueError: it is negative.
        OverflowError: it does not fit 64 bits of nanoseconds.
    """

    def __init__(
        self, *, seconds: float = 0, nanoseconds: float = 0, clock_type: ClockType = ClockType.SYSTEM_TIME
    ) -> None:
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        if seconds < 0:
            raise ValueError("Seconds value must not be negative")
        if nanoseconds < 0:
            raise ValueError("Nanoseconds value must not be negative")
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if total > INT64_MAX:
            raise OverflowError("Total nanoseconds value is too large to store in C time point.")
        self._ns = total
        self._clock_type = clock_type

    @property
    def nanoseconds(self) -> int:
        """Nanoseconds since the clock's epoch."""
        return self._ns

    def seconds_nanoseconds(self) -> tuple[int, int]:
        """Return whole seconds and remaining nanoseconds."""
        return divmod(self._ns, S_TO_NS)

    @property
    def clock_type(self) -> ClockType:
        """Type of the clock that the time belongs to."""
        return self._clock_type

    def __repr__(self) -> str:
        return f"Time(nanoseconds={self._ns}, clock_type={self._clock_type.name})"

    def __copy__(self) -> Time:
        return Time(nanoseconds=self._ns, clock_type=self._clock_type)

    def __reduce__(self) -> str:
        raise TypeError("cannot pickle a Time")  # As in rclpy.

    def __add__(self, other: object) -> Time:
        if not isinstance(other, Duration):
            return NotImplemented
        total = self._ns + other.nanoseconds
        if total > INT64_MAX:
            raise OverflowError("Addition leads to overflow in C storage.")
        return Time(nanoseconds=total, clock_type=self._clock_type)

    __radd__ = __add__

    @overload
    def __sub__(self, other: Time) -> Duration: ...

    @overload
    def __sub__(self, other: Duration) -> Time: ...

    def __sub__(self, other: object) -> Time | Duration:
        if isinstance(other, Time):
            if self._clock_type != other._clock_type:
                raise TypeError("Can't subtract times with different clock types")
            return Duration(nanoseconds=self._ns - other._ns)
        if isinstance(other, Duration):
            left = self._ns - other.nanoseconds
            if left < 0:
                raise ValueError("Subtraction leads to negative time.")
            return Time(nanoseconds=left, clock_type=self._clock_type)
        return NotImplemented

    def _check(self, other: Time) -> None:
        if self._clock_type != other._clock_type:
            raise TypeError("Can't compare times with different clock types")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Time):
            return NotImplemented
        self._check(other)
        return self._ns == other._ns

    def __lt__(self, other: object) -> bool:
        if not isinstance(other, Time):
            return NotImplemented
        self._check(other)
        return self._ns < other._ns

    def to_msg(self) -> Any:
        """Return the time as `builtin_interfaces.msg.Time`."""
        sec, nanosec = divmod(self._ns, S_TO_NS)
        return message_class("builtin_interfaces/Time")(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: Any, clock_type: ClockType = ClockType.ROS_TIME) -> Time:
        """Return the time of a `builtin_interfaces.msg.Time`. Raises TypeError for anything else."""
        if not isinstance(msg, message_class("builtin_interfaces/Time")):
            raise TypeError("Must pass a builtin_interfaces.msg.Time object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec, clock_type=clock_type)
