"""`rclpy.duration`: durations."""

from __future__ import annotations

import math
from functools import total_ordering
from typing import Any, Final

from rwt_rclpy.messages.loaded import message_class
from rwt_rclpy.release import FROM_KILTED

S_TO_NS: Final = 1_000_000_000
INT64_MAX: Final = 2**63 - 1
INT64_MIN: Final = -(2**63)


@total_ordering
class Duration:
    """Duration, positive or negative, in nanoseconds of 64 bits.

    Raises:
        OverflowError: it does not fit.
    """

    def __init__(self, *, seconds: float = 0, nanoseconds: float = 0) -> None:
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if not INT64_MIN <= total <= INT64_MAX:
            raise OverflowError("Total nanoseconds value is too large to store in C duration.")
        self._ns = total

    @property
    def nanoseconds(self) -> int:
        """Its length."""
        return self._ns

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self._ns})"

    def __str__(self) -> str:
        return "Infinite" if self == Infinite else f"{self._ns} nanoseconds"

    def __eq__(self, other: object) -> bool:
        return self._ns == other._ns if isinstance(other, Duration) else NotImplemented

    def __copy__(self) -> Duration:
        return Duration(nanoseconds=self._ns)

    def __reduce__(self) -> str:
        raise TypeError("cannot pickle a Duration")  # As in rclpy.

    def __lt__(self, other: object) -> bool:
        return self._ns < other._ns if isinstance(other, Duration) else NotImplemented

    if FROM_KILTED:

        def __add__(self, other: object) -> Duration:
            if not isinstance(other, Duration):
                return NotImplemented
            return Duration(nanoseconds=self._ns + other._ns)

        def __sub__(self, other: object) -> Duration:
            if not isinstance(other, Duration):
                return NotImplemented
            return Duration(nanoseconds=self._ns - other._ns)

        def __mul__(self, other: object) -> Duration:
            """Return a multiple; times infinity is :data:`Infinite`. Raises ValueError for NaN."""
            if not isinstance(other, (int, float)):
                return NotImplemented
            if math.isnan(other):
                raise ValueError("a duration cannot be multiplied by NaN")
            if math.isinf(other):
                return Infinite if (other > 0) == (self._ns >= 0) else Duration(nanoseconds=INT64_MIN)
            return Duration(nanoseconds=int(self._ns * other))

    def to_msg(self) -> Any:
        """Return the duration as `builtin_interfaces.msg.Duration`."""
        sec, nanosec = divmod(self._ns, S_TO_NS)
        return message_class("builtin_interfaces/Duration")(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: Any) -> Duration:
        """Return the duration of a `builtin_interfaces.msg.Duration`. Raises TypeError for anything else."""
        if not isinstance(msg, message_class("builtin_interfaces/Duration")):
            raise TypeError("Must pass a builtin_interfaces.msg.Duration object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)

    def get_c_duration(self) -> int:
        """Return the length, for code that passes it to rcl."""
        return self._ns


#: rmw's infinite duration.
Infinite = Duration(nanoseconds=9223372036854775807)
