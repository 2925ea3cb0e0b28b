"""Path planner that avoids walls: A* over coarse cells, then straightened."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator

from rwt.nodes.demo.world.map import World

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
        self._clearance: list[float] = []

    def plan(self, start: Point, goal: Point) -> list[Point]:
        """Return the corners of a path from `start` to exactly `goal`, in metres in the map frame.

        Raises:
            NoPath: the goal is in or too close to an obstacle, or unreachable.
        """
        if self._world.clearance(*goal) < self._needed:
            msg = f"the goal ({goal[0]:.4g}, {goal[1]:.4g}) is within {self._needed:.2f} m of something solid"
            raise NoPath(msg)
        if not self._clearance:
            self._measure()
        first, last = self._nearest_free(start), self._nearest_free(goal)
        cells = self._search(first, last) if first is not None and last is not None else None
        if cells is None:
            msg = f"no way leads from ({start[0]:.4g}, {start[1]:.4g}) to ({goal[0]:.4g}, {goal[1]:.4g})"
            raise NoPath(msg)
        return self._straightened([start, *(self._centre(cell) for cell in cells), goal])

    def _measure(self) -> None:
        self._clearance = [
            self._world.clearance(*self._centre(cell)) for cell in range(self._columns * self._rows)
        ]

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
        for i in range(1, pieces):
            part = i / pieces
            x, y = here[0] + part * (there[0] - here[0]), here[1] + part * (there[1] - here[1])
            if self._clearance[self._cell_at((x, y))] < self._needed + _CELL / 2:
                return False
        return True


def _trace(came_from: dict[int, int], last: int) -> list[int]:
    cells = [last]
    while came_from[cells[-1]] != cells[-1]:
        cells.append(came_from[cells[-1]])
    return cells[::-1]
