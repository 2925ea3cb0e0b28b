"""A small arm with six joints: dimensions, and motion along trajectories."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal


@dataclass(frozen=True, slots=True)
class ArmJoint:
    """Joint and the link that it turns, drawn as a cylinder along z.

    Attributes:
        link: link that it turns, with the joint at its origin.
        height: position of the joint along z of the previous link, metres.
        length: length of the link, metres.
        radius: radius of the link, metres.
        limit: maximum angle either way, radians.
        speed: maximum speed, radians per second.
        rest: angle at the start and after a reset, radians.
    """

    name: str
    link: str
    height: float
    axis: Literal["y", "z"]
    length: float
    radius: float
    limit: float
    speed: float
    rest: float


ARM: Final = (
    ArmJoint("shoulder_pan_joint", "shoulder_link", 0.05, "z", 0.04, 0.035, 3.1, 2.0, 0.0),
    ArmJoint("shoulder_lift_joint", "upper_arm_link", 0.04, "y", 0.18, 0.025, 2.2, 2.0, -0.7),
    ArmJoint("elbow_joint", "forearm_link", 0.18, "y", 0.15, 0.02, 2.6, 2.0, 2.2),
    ArmJoint("wrist_1_joint", "wrist_1_link", 0.15, "z", 0.03, 0.018, 3.1, 3.0, 0.0),
    ArmJoint("wrist_2_joint", "wrist_2_link", 0.03, "y", 0.04, 0.018, 2.2, 3.0, 0.6),
    ArmJoint("wrist_3_joint", "wrist_3_link", 0.04, "z", 0.02, 0.016, 3.1, 3.0, 0.0),
)
"""From the base to the hand. Turning about y is away from the robot's front for negative angles."""

REST: Final = tuple(joint.rest for joint in ARM)


Angles = tuple[float, ...]


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


class Arm:
    """Kinematics of the arm.

    Attributes:
        positions: radians, in the order of :data:`ARM`.
        velocities: radians a second.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Move every joint to its rest angle at once."""
        self.positions: tuple[float, ...] = REST
        self.stop()

    def stop(self) -> None:
        """Set every joint's velocity to zero."""
        self.velocities: tuple[float, ...] = (0.0,) * len(ARM)

    def go(self, trajectory: Trajectory, seconds: float) -> None:
        """Set the angles of a trajectory at a time in seconds, within the joints' limits."""
        positions, self.velocities = trajectory.at(seconds)
        # A spline may swing further than its waypoints.
        self.positions = tuple(
            max(-joint.limit, min(joint.limit, angle)) for joint, angle in zip(ARM, positions, strict=True)
        )
