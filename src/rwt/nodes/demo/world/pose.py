"""Position and heading on the floor."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Pose:
    """Position and heading in the plane.

    Attributes:
        x: metres.
        y: metres.
        heading: radians, counterclockwise from the x axis, in (-π, π].
    """

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0

    def distance_to(self, x: float, y: float) -> float:
        """Return the distance to a point in metres."""
        return math.hypot(x - self.x, y - self.y)

    def after(self, other: Pose) -> Pose:
        """Return `other`, which is relative to this pose, in the frame of this pose."""
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return Pose(
            self.x + cos * other.x - sin * other.y,
            self.y + sin * other.x + cos * other.y,
            wrap_angle(self.heading + other.heading),
        )

    def seen_from(self, base: Pose) -> Pose:
        """Return this pose relative to `base`; the inverse of :meth:`after`."""
        cos, sin = math.cos(base.heading), math.sin(base.heading)
        dx, dy = self.x - base.x, self.y - base.y
        return Pose(cos * dx + sin * dy, cos * dy - sin * dx, wrap_angle(self.heading - base.heading))

    def moved(self, linear: float, angular: float, seconds: float) -> Pose:
        """Return the pose after an arc of `seconds` at constant m/s and rad/s."""
        turn = angular * seconds
        if abs(turn) < 1e-9:
            chord, direction = linear * seconds, self.heading
        else:
            chord, direction = 2 * linear / angular * math.sin(turn / 2), self.heading + turn / 2
        return Pose(
            self.x + chord * math.cos(direction),
            self.y + chord * math.sin(direction),
            wrap_angle(self.heading + turn),
        )


ORIGIN = Pose()


def wrap_angle(angle: float) -> float:
    """Return the same direction in (-π, π]."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped
