"""The laser against known distances and against a ray walked in small steps."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from rwt.extensions.demo.world.lidar import Lidar
from rwt.extensions.demo.world.map import ORIGIN, Box, Pillar, Pose, World, house, walled

ROOM = World(Box(-3, -2, 3, 2), walled(Box(-3, -2, 3, 2), 0.5))
HOUSE = house()


def ray_towards(lidar: Lidar, angle: float) -> int:
    return round((angle - lidar.angle_min) / lidar.angle_increment) % lidar.ray_count


def walked(world: World, pose: Pose, angle: float) -> float:
    """Sphere tracing: advance by the clearance until something is touched."""
    way = 0.0
    direction = pose.heading + angle
    for _ in range(10_000):
        free = world.clearance(pose.x + way * math.cos(direction), pose.y + way * math.sin(direction))
        if free < 1e-6:
            break
        way += free
    return way


@pytest.mark.parametrize(
    ("heading", "ahead", "left", "behind", "right"),
    [(0.0, 2.0, 1.5, 3.0, 1.5), (math.pi / 2, 1.5, 3.0, 1.5, 2.0), (math.pi, 3.0, 1.5, 2.0, 1.5)],
)
def test_walls_are_at_their_distances(
    heading: float, ahead: float, left: float, behind: float, right: float
) -> None:
    lidar = Lidar(ROOM)
    ranges = lidar.scan(Pose(0.5, 0.0, heading))
    seen = [ranges[ray_towards(lidar, angle)] for angle in (0, math.pi / 2, math.pi, -math.pi / 2)]
    assert seen == pytest.approx([ahead, left, behind, right], abs=1e-3)


def test_a_pillar_hides_the_wall_behind_it() -> None:
    lidar = Lidar(World(ROOM.floor, ROOM.boxes, (Pillar(1.5, 0.0, 0.25),)))
    ranges = lidar.scan(ORIGIN)
    assert ranges[ray_towards(lidar, 0.0)] == pytest.approx(1.25)
    assert ranges[ray_towards(lidar, math.pi)] == pytest.approx(2.5)


@settings(max_examples=25)
@given(st.floats(-4.9, 4.9), st.floats(-3.9, 3.9), st.floats(-math.pi, math.pi))
@example(-3.0, 0.0, math.pi)
@example(-3.0, 0.0, math.nextafter(math.pi, 0.0))
def test_every_ray_ends_where_a_walk_along_it_ends(x: float, y: float, heading: float) -> None:
    assume(HOUSE.clearance(x, y) > 0.05)
    lidar, pose = Lidar(HOUSE), Pose(x, y, heading)
    for ray, measured in enumerate(lidar.scan(pose)):
        angle = lidar.angle_min + ray * lidar.angle_increment
        true = walked(HOUSE, pose, angle)
        if abs(measured - true) > 2e-3:
            # A ray that grazes an edge may be counted as a hit or not: then a neighbour agrees. Beside a wall
            # the walk takes too many steps unless the neighbour diverges by a millirad.
            nudges = (-1e-3, -1e-4, -1e-8, 1e-8, 1e-4, 1e-3)
            grazing = [walked(HOUSE, pose, angle + nudge) for nudge in nudges]
            assert any(abs(measured - other) < 0.05 for other in grazing), (ray, measured, true)


def test_nothing_within_the_range_is_infinite() -> None:
    far = World(Box(-50, -50, 50, 50), walled(Box(-50, -50, 50, 50)))
    assert set(Lidar(far).scan(ORIGIN)) == {math.inf}


def test_noise_has_the_deviation_asked_for_and_repeats_with_its_seed() -> None:
    exact = Lidar(ROOM).scan(ORIGIN)
    noisy, again, other = Lidar(ROOM, seed=7), Lidar(ROOM, seed=7), Lidar(ROOM, seed=8)
    for lidar in (noisy, again, other):
        lidar.noise = 0.02
    scan = noisy.scan(ORIGIN)
    assert scan == again.scan(ORIGIN) != other.scan(ORIGIN)
    deviation = math.sqrt(sum((a - b) ** 2 for a, b in zip(scan, exact, strict=True)) / len(exact))
    assert deviation == pytest.approx(0.02, rel=0.2)


def test_no_range_is_below_what_the_scanner_can_measure() -> None:
    lidar = Lidar(ROOM)
    lidar.noise = 1.0
    assert min(min(lidar.scan(Pose(2.4, 0.0))) for _ in range(5)) == lidar.range_min
