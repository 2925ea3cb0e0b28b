"""Trajectories of joints: waypoints in time, and the positions and velocities between them."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

Angles = tuple[float, ...]
"""One value for each joint, in its order; radians for revolute joints."""


@dataclass(frozen=True, slots=True)
class Waypoint:
    """Positions of all joints at a time.

    Attributes:
        seconds: time since the start of the trajectory.
        positions: radians.
        velocities: radians per second; None if the message has none.
    """

    seconds: float
    positions: Angles
    velocities: Angles | None = None


class Trajectory:
    """Joint angles over time: cubic splines between waypoints that both have velocities, else linear.

    Args:
        waypoints: one or more, in order of time; before the first, the joints are at its positions.
    """

    def __init__(self, waypoints: Sequence[Waypoint]) -> None:
        self._waypoints = tuple(waypoints)
        self._times = [waypoint.seconds for waypoint in waypoints]

    @property
    def duration(self) -> float:
        """Duration in seconds."""
        return self._times[-1]

    @property
    def goal(self) -> Angles:
        """Angles of the last waypoint."""
        return self._waypoints[-1].positions

    def at(self, seconds: float) -> tuple[Angles, Angles]:
        """Return positions and velocities at a time; velocities are zero outside of the waypoints."""
        after = bisect_right(self._times, seconds)
        if after == 0 or after == len(self._waypoints):
            held = self._waypoints[max(0, after - 1)].positions
            return held, (0.0,) * len(held)
        begin, end = self._waypoints[after - 1], self._waypoints[after]
        span = end.seconds - begin.seconds
        share = (seconds - begin.seconds) / span
        if begin.velocities is None or end.velocities is None:
            return _straight(begin.positions, end.positions, share, span)
        pairs = [
            _cubic(p0, p1, v0 * span, v1 * span, share)
            for p0, p1, v0, v1 in zip(
                begin.positions, end.positions, begin.velocities, end.velocities, strict=True
            )
        ]
        return tuple(place for place, _ in pairs), tuple(slope / span for _, slope in pairs)


def _straight(begin: Angles, end: Angles, share: float, span: float) -> tuple[Angles, Angles]:
    ways = [there - here for here, there in zip(begin, end, strict=True)]
    places = tuple(here + way * share for here, way in zip(begin, ways, strict=True))
    return places, tuple(way / span for way in ways)


def _cubic(p0: float, p1: float, m0: float, m1: float, t: float) -> tuple[float, float]:
    # Value and slope at `t` (0 to 1) of the cubic Hermite spline with these values and slopes at its ends.
    a, b = 2 * (p0 - p1) + m0 + m1, 3 * (p1 - p0) - 2 * m0 - m1
    return ((a * t + b) * t + m0) * t + p0, (3 * a * t + 2 * b) * t + m0
