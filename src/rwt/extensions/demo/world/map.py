"""Floor plan: poses, obstacles, distances to them, and the occupancy map.

Obstacles are axis-aligned boxes and round pillars. Collisions and the laser use the exact shapes; only the
map has cells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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


#: Values of `nav_msgs/OccupancyGrid`.
FREE = 0
OCCUPIED = 100

#: Side of a cell, metres.
_RESOLUTION = 0.05


@dataclass(frozen=True, slots=True)
class Box:
    """Axis-aligned box (wall or furniture); metres in the map frame."""

    left: float
    bottom: float
    right: float
    top: float

    def distance(self, x: float, y: float) -> float:
        """Return the distance of a point from the box in metres; 0 inside."""
        dx = self.left - x if x < self.left else x - self.right if x > self.right else 0.0
        dy = self.bottom - y if y < self.bottom else y - self.top if y > self.top else 0.0
        return math.hypot(dx, dy)


@dataclass(frozen=True, slots=True)
class Pillar:
    """Round obstacle; metres in the map frame."""

    x: float
    y: float
    radius: float

    def distance(self, x: float, y: float) -> float:
        """Return the distance of a point from the pillar in metres; 0 inside."""
        return max(0.0, math.hypot(x - self.x, y - self.y) - self.radius)


@dataclass(frozen=True, slots=True)
class World:
    """Closed floor with obstacles.

    Attributes:
        floor: rectangle that contains everything.
        boxes: walls, including the outer ones, and furniture.
        start: initial pose of the robot, in the map frame.
    """

    floor: Box
    boxes: tuple[Box, ...]
    pillars: tuple[Pillar, ...] = ()
    start: Pose = ORIGIN

    def clearance(self, x: float, y: float) -> float:
        """Return the distance of a point from the nearest obstacle in metres; 0 inside or off the floor."""
        floor = self.floor
        nearest = min(x - floor.left, floor.right - x, y - floor.bottom, floor.top - y)
        for box in self.boxes:
            nearest = min(nearest, box.distance(x, y))
        for pillar in self.pillars:
            nearest = min(nearest, pillar.distance(x, y))
        return max(0.0, nearest)


@dataclass(frozen=True, slots=True)
class Grid:
    """Map of square cells.

    Attributes:
        resolution: side of a cell, metres.
        columns: cells along x.
        rows: cells along y.
        left: x of the corner of the first cell, metres.
        bottom: y of the corner of the first cell, metres.
        cells: :data:`FREE` or :data:`OCCUPIED`, row by row, the lowest y first.
    """

    resolution: float
    columns: int
    rows: int
    left: float
    bottom: float
    cells: Sequence[int]


def draw_map(world: World) -> Grid:
    """Return the occupancy grid; a cell is occupied if its centre is in an obstacle."""
    floor, resolution = world.floor, _RESOLUTION
    columns = math.ceil((floor.right - floor.left) / resolution - 1e-9)
    rows = math.ceil((floor.top - floor.bottom) / resolution - 1e-9)
    cells = [FREE] * (columns * rows)
    around = (Box(p.x - p.radius, p.y - p.radius, p.x + p.radius, p.y + p.radius) for p in world.pillars)
    for shape in (*world.boxes, *around):
        # Only the cells around each shape are tested: 160 times 200 cells times 20 shapes would be seconds.
        first = max(0, math.floor((shape.left - floor.left) / resolution))
        last = min(columns, math.ceil((shape.right - floor.left) / resolution))
        for row in range(
            max(0, math.floor((shape.bottom - floor.bottom) / resolution)),
            min(rows, math.ceil((shape.top - floor.bottom) / resolution)),
        ):
            y = floor.bottom + (row + 0.5) * resolution
            for column in range(first, last):
                if world.clearance(floor.left + (column + 0.5) * resolution, y) == 0.0:
                    cells[row * columns + column] = OCCUPIED
    return Grid(resolution, columns, rows, floor.left, floor.bottom, tuple(cells))


def walled(floor: Box, thickness: float = 0.1) -> tuple[Box, ...]:
    """Return the four outer walls of a floor, inside its rectangle."""
    left, bottom, right, top = floor.left, floor.bottom, floor.right, floor.top
    return (
        Box(left, bottom, right, bottom + thickness),
        Box(left, top - thickness, right, top),
        Box(left, bottom, left + thickness, top),
        Box(right - thickness, bottom, right, top),
    )


def house() -> World:
    """Return the demo's world: 10 m by 8 m, two rooms in the west, a hall and a store in the east."""
    floor = Box(-5.0, -4.0, 5.0, 4.0)
    inner_walls = (
        # Between the western rooms and the hall, with a door to each room.
        Box(-1.1, -4.0, -1.0, -3.0),
        Box(-1.1, -2.0, -1.0, 1.5),
        Box(-1.1, 2.5, -1.0, 4.0),
        # Between the western rooms, with a door.
        Box(-5.0, -0.1, -3.6, 0.0),
        Box(-2.6, -0.1, -1.1, 0.0),
        # The store in the north-east, with a door to the hall.
        Box(1.8, 1.2, 2.2, 1.3),
        Box(3.2, 1.2, 5.0, 1.3),
        Box(1.8, 1.3, 1.9, 4.0),
    )
    furniture = (
        Box(-4.4, 1.6, -3.4, 2.4),  # table
        Box(-4.9, -3.9, -4.5, -2.6),  # shelf
        Box(1.6, -3.9, 2.8, -3.5),  # bench
        Box(4.1, 2.9, 4.9, 3.9),  # crate
    )
    pillars = (Pillar(0.6, -0.6, 0.15), Pillar(2.6, -0.6, 0.15), Pillar(3.9, -2.3, 0.3))
    return World(floor, walled(floor) + inner_walls + furniture, pillars, Pose(-3.4, -2.5, 0.0))
