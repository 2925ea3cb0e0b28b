"""The messages of Table III, and some that compress worse."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry

WIDTH, HEIGHT = 732, 413
_ROOMS: Final = 25
_POINTS, _LINE_STRIP, _LINE_LIST = 8, 4, 5
"""Constants of `visualization_msgs/Marker`."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One message.

    Attributes:
        name: for the table.
        payload: the message.
        text: of it in JSON; None for what the server writes.
    """

    name: str
    payload: Payload
    text: bytes | None = None

    @property
    def json(self) -> bytes:
        """The message's text."""
        return bytes(self.payload.json()) if self.text is None else self.text


def samples() -> Iterator[Sample]:
    """All of them, those of the paper first."""
    registry, source = Registry(), random.Random(3)

    def payload(type_name: str, value: Mapping[str, object]) -> Payload:
        return Payload.from_value(registry.message(type_name), value)

    grid = _cells()
    info = {"width": WIDTH, "height": HEIGHT, "resolution": 0.05}
    drawn = payload("nav_msgs/OccupancyGrid", {"header": {"frame_id": "map"}, "info": info, "data": grid})
    yield Sample("map", drawn)
    # Nine characters to a cell make the 2.7 MB of the paper.
    cells = b",".join(b"%.5f" % cell for cell in grid)
    head, _, tail = bytes(drawn.json()).partition(b'"data":[')
    yield Sample(
        "map, 9 characters a cell", drawn, head + b'"data":[' + cells + b"]" + tail.partition(b"]")[2]
    )
    marker = "visualization_msgs/Marker"
    yield Sample("3D point array", payload(marker, _marker(_POINTS, _surface(source, 570))))
    strip = _way(source, 730)
    yield Sample("line strip", payload(marker, _marker(_LINE_STRIP, strip)))
    ends = [point for pair in pairwise(strip[:690]) for point in pair]
    yield Sample("line list", payload(marker, _marker(_LINE_LIST, ends)))
    for size, count in ((42, 64), (78, 118)):
        array = {"markers": [_person(source, number) for number in range(count)]}
        yield Sample(f"{size} KB of markers", payload("visualization_msgs/MarkerArray", array))
    ranges = [3 + math.sin(n / 50) + source.gauss(0, 0.01) for n in range(100_000)]
    yield Sample("100,000 distances", payload("sensor_msgs/LaserScan", {"ranges": ranges}))
    noise = {"width": 640, "height": 480, "encoding": "rgb8", "step": 1920, "data": source.randbytes(921_600)}
    yield Sample("image of noise", payload("sensor_msgs/Image", noise))


def _cells() -> list[int]:
    """The cells of a floor with rooms: unknown, free, and walls."""
    source = random.Random(1)
    grid = [[-1] * WIDTH for _ in range(HEIGHT)]
    for _ in range(_ROOMS):
        left, top = source.randrange(20, WIDTH - 120), source.randrange(20, HEIGHT - 80)
        width, height = source.randrange(30, 110), source.randrange(20, 70)
        for y in range(top, top + height):
            for x in range(left, left + width):
                is_wall = x in (left, left + width - 1) or y in (top, top + height - 1)
                grid[y][x] = 100 if is_wall else 0
    return [cell for row in grid for cell in row]


Points = list[dict[str, float]]


def _surface(source: random.Random, count: int) -> Points:
    """Points on a floor and a wall, as a sensor measures them."""
    points = []
    for _ in range(count):
        along, across = source.uniform(-2, 2), source.uniform(0, 3)
        off = source.gauss(0, 0.003)
        floor = source.random() < 0.6
        points.append({"x": along, "y": across if floor else 3 + off, "z": off if floor else across})
    return points


def _way(source: random.Random, count: int) -> Points:
    """Where a robot has driven."""
    x = y = heading = 0.0
    points = []
    for _ in range(count):
        heading += source.gauss(0, 0.05)
        x, y = x + 0.05 * math.cos(heading), y + 0.05 * math.sin(heading)
        points.append({"x": x, "y": y, "z": 0.0})
    return points


def _marker(kind: int, points: Points) -> dict[str, object]:
    return {
        "header": {"frame_id": "map"},
        "ns": "table",
        "type": kind,
        "scale": {"x": 0.02},
        "points": points,
    }


def _person(source: random.Random, number: int) -> dict[str, object]:
    place = {"x": source.uniform(-5, 5), "y": source.uniform(-5, 5), "z": 0.0}
    return {
        "header": {"stamp": {"sec": 1_700_000_000, "nanosec": 12_345}, "frame_id": "map"},
        "ns": "people",
        "id": number,
        "type": 3,
        "pose": {"position": place, "orientation": {"w": 1.0}},
        "scale": {"x": 0.5, "y": 0.5, "z": 1.8},
        "color": {"g": 1.0, "a": 0.8},
    }
