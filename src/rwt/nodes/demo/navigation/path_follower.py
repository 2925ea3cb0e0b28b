"""Path follower: computes the velocity for each step."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from rwt.nodes.demo.drive import STANDSTILL, MotorLimits, Velocity
from rwt.nodes.demo.world.map import Pose, wrap_angle

#: Look-ahead distance on the path, metres.
_LOOK_AHEAD = 0.3
#: Distance between points of the path, metres.
_SPACING = 0.05
#: Heading error above which the robot first turns in place, radians.
_TURN_FIRST = 0.8
#: Radians per second for each radian of error.
_STEERING = 3.0
#: Share of the robot's acceleration that is planned for braking at the goal.
_BRAKING = 0.6


class PathFollower:
    """Follower of one path to a pose.

    Attributes:
        goal: final pose, in the frame of the path.
    """

    #: Tolerances of the goal in metres and radians.
    position_tolerance = 0.05
    heading_tolerance = 0.05

    def __init__(self, corners: Sequence[tuple[float, float]], goal: Pose, limits: MotorLimits) -> None:
        self.goal = goal
        self._limits = limits
        self._points = _cut(corners)
        self._reached = 0
        self._turning = False
        self._ahead = [0.0] * len(self._points)
        for i in range(len(self._points) - 2, -1, -1):
            self._ahead[i] = self._ahead[i + 1] + math.dist(self._points[i], self._points[i + 1])

    def remaining(self, pose: Pose) -> float:
        """Remaining distance in metres."""
        return self._ahead[self._reached] + pose.distance_to(*self._points[self._reached])

    def off_track(self, pose: Pose) -> float:
        """Distance of the robot from the path in metres."""
        return pose.distance_to(*self._points[self._reached])

    def arrived(self, pose: Pose) -> bool:
        """Return True if position and heading are within the tolerances."""
        return (
            pose.distance_to(self.goal.x, self.goal.y) <= self.position_tolerance
            and abs(wrap_angle(self.goal.heading - pose.heading)) <= self.heading_tolerance
        )

    def steer(self, pose: Pose) -> Velocity:
        """Return the velocity for a pose."""
        # The nearest point within a short distance ahead: a path may cross itself.
        ahead = range(self._reached, min(len(self._points), self._reached + 20))
        self._reached = min(ahead, key=lambda i: pose.distance_to(*self._points[i]))
        if self.arrived(pose):
            return STANDSTILL
        # At the goal only the heading is corrected, unless turning has moved the robot away.
        slack = self.position_tolerance if self._turning else self.position_tolerance / 2
        self._turning = pose.distance_to(self.goal.x, self.goal.y) <= slack
        if self._turning:
            return Velocity(0.0, _STEERING * wrap_angle(self.goal.heading - pose.heading))
        x, y = self._target(pose)
        error = wrap_angle(math.atan2(y - pose.y, x - pose.x) - pose.heading)
        turn = _STEERING * error
        if abs(error) > _TURN_FIRST:
            return Velocity(0.0, turn)
        limits = self._limits
        speed = min(
            limits.speed * math.cos(error) ** 2,
            math.sqrt(2 * _BRAKING * limits.acceleration * self.remaining(pose)),
            # Limited by the speed of turning towards the target.
            limits.turn_rate * _LOOK_AHEAD / max(abs(error), 0.1),
        )
        return Velocity(speed, turn)

    def _target(self, pose: Pose) -> tuple[float, float]:
        for point in self._points[self._reached :]:
            if pose.distance_to(*point) >= _LOOK_AHEAD:
                return point
        return self._points[-1]


def _cut(corners: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    points = [corners[0]]
    for (x1, y1), (x2, y2) in itertools.pairwise(corners):
        pieces = max(1, math.ceil(math.dist((x1, y1), (x2, y2)) / _SPACING))
        points += [(x1 + (x2 - x1) * i / pieces, y1 + (y2 - y1) * i / pieces) for i in range(1, pieces + 1)]
    return points
