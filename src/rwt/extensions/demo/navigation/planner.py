"""Path planner that avoids walls (A* over coarse cells, then straightened), and path follower."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Iterator, Sequence
from functools import cached_property

from rwt.extensions.demo.drive import STANDSTILL, MotorLimits, Velocity
from rwt.extensions.demo.world.map import Pose, World, wrap_angle

Point = tuple[float, float]

#: Side of a planning cell, metres; half the size of the robot suffices.
_CELL = 0.1
#: Free space around the robot, metres.
_MARGIN = 0.05
#: Distance to walls below which cells cost more, so that paths use the middle of doors; metres.
_COMFORT = 0.5
#: Maximum distance of a point from the free cell that represents it, metres.
_SNAP = 0.3

_STEPS = tuple((dx, dy, math.hypot(dx, dy)) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy)


class NoPath(Exception):
    """No path to the goal exists; the text gives the reason."""


class Planner:
    """Path planner for a round robot in a static world."""

    def __init__(self, world: World, body_radius: float) -> None:
        floor = world.floor
        self._world = world
        self._needed = body_radius + _MARGIN
        self._left, self._bottom = floor.left, floor.bottom
        self._columns = math.ceil((floor.right - floor.left) / _CELL)
        self._rows = math.ceil((floor.top - floor.bottom) / _CELL)

    def plan(self, start: Point, goal: Point) -> list[Point]:
        """Return the corners of a path from `start` to exactly `goal`, in metres in the map frame.

        Raises:
            NoPath: the goal is in or too close to an obstacle, or unreachable.
        """
        if self._world.clearance(*goal) < self._needed:
            msg = f"the goal ({goal[0]:.4g}, {goal[1]:.4g}) is within {self._needed:.2f} m of something solid"
            raise NoPath(msg)
        first, last = self._nearest_free(start), self._nearest_free(goal)
        cells = self._search(first, last) if first is not None and last is not None else None
        if cells is None:
            msg = f"no way leads from ({start[0]:.4g}, {start[1]:.4g}) to ({goal[0]:.4g}, {goal[1]:.4g})"
            raise NoPath(msg)
        return self._straightened([start, *(self._centre(cell) for cell in cells), goal])

    @cached_property
    def _clearance(self) -> list[float]:
        return [self._world.clearance(*self._centre(cell)) for cell in range(self._columns * self._rows)]

    def _centre(self, cell: int) -> Point:
        row, column = divmod(cell, self._columns)
        return self._left + (column + 0.5) * _CELL, self._bottom + (row + 0.5) * _CELL

    def _cell_at(self, point: Point) -> int:
        column = math.floor((point[0] - self._left) / _CELL)
        row = math.floor((point[1] - self._bottom) / _CELL)
        return min(max(row, 0), self._rows - 1) * self._columns + min(max(column, 0), self._columns - 1)

    def _nearest_free(self, point: Point) -> int | None:
        reach = math.ceil(_SNAP / _CELL)
        row, column = divmod(self._cell_at(point), self._columns)
        near = (
            r * self._columns + c
            for r in range(max(0, row - reach), min(self._rows, row + reach + 1))
            for c in range(max(0, column - reach), min(self._columns, column + reach + 1))
        )
        free = (cell for cell in near if self._clearance[cell] >= self._needed)
        return min(free, key=lambda cell: math.dist(self._centre(cell), point), default=None)

    def _search(self, first: int, last: int) -> list[int] | None:
        columns = self._columns
        goal_row, goal_column = divmod(last, columns)
        came_from = {first: first}
        cost = {first: 0.0}
        open_cells = [(0.0, first)]
        closed: set[int] = set()
        while open_cells:
            _, cell = heapq.heappop(open_cells)
            if cell == last:
                return _trace(came_from, last)
            if cell in closed:
                continue
            closed.add(cell)
            for neighbour, step in self._neighbours(cell):
                total = cost[cell] + step
                if total < cost.get(neighbour, math.inf):
                    cost[neighbour] = total
                    came_from[neighbour] = cell
                    row, column = divmod(neighbour, columns)
                    ahead = math.hypot(row - goal_row, column - goal_column)
                    heapq.heappush(open_cells, (total + ahead, neighbour))
        return None

    def _neighbours(self, cell: int) -> Iterator[tuple[int, float]]:
        row, column = divmod(cell, self._columns)
        for dx, dy, length in _STEPS:
            if 0 <= column + dx < self._columns and 0 <= row + dy < self._rows:
                neighbour = cell + dy * self._columns + dx
                clearance = self._clearance[neighbour]
                if clearance >= self._needed:
                    discomfort = max(0.0, _COMFORT - clearance) / _COMFORT
                    yield neighbour, length * (1.0 + 2.0 * discomfort)

    def _straightened(self, points: list[Point]) -> list[Point]:
        """Return the path with fewer corners: each corner sees the next one."""
        corners = [points[0]]
        at = 0
        while at < len(points) - 1:
            ahead = at + 1
            while ahead < len(points) - 1 and self._sees(points[at], points[ahead + 1]):
                ahead += 1
            corners.append(points[ahead])
            at = ahead
        return corners

    def _sees(self, here: Point, there: Point) -> bool:
        pieces = max(1, math.ceil(math.dist(here, there) / (_CELL / 2)))
        between = (_between(here, there, i / pieces) for i in range(1, pieces))
        return all(self._clearance[self._cell_at(point)] >= self._needed + _CELL / 2 for point in between)


def _trace(came_from: dict[int, int], last: int) -> list[int]:
    cells = [last]
    while came_from[cells[-1]] != cells[-1]:
        cells.append(came_from[cells[-1]])
    return cells[::-1]


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

    def __init__(self, corners: Sequence[Point], goal: Pose, limits: MotorLimits) -> None:
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
        return self._ahead[self._reached] + self.off_track(pose)

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

    def _target(self, pose: Pose) -> Point:
        far = (point for point in self._points[self._reached :] if pose.distance_to(*point) >= _LOOK_AHEAD)
        return next(far, self._points[-1])


def _cut(corners: Sequence[Point]) -> list[Point]:
    points = [corners[0]]
    for here, there in itertools.pairwise(corners):
        pieces = max(1, math.ceil(math.dist(here, there) / _SPACING))
        points += [_between(here, there, i / pieces) for i in range(1, pieces + 1)]
    return points


def _between(here: Point, there: Point, part: float) -> Point:
    return here[0] + part * (there[0] - here[0]), here[1] + part * (there[1] - here[1])
