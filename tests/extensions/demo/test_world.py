"""The floor plan, the map that is drawn of it, and poses in it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.demo.drive import Chassis
from rwt.extensions.demo.world.map import (
    FREE,
    OCCUPIED,
    Box,
    Pillar,
    Pose,
    World,
    draw_map,
    house,
    walled,
    wrap_angle,
)  # fmt: skip

HOUSE = house()
MAP = draw_map(HOUSE)


def test_distances_to_shapes() -> None:
    box = Box(0, 0, 2, 1)
    assert box.distance(1, 0.5) == 0.0
    assert box.distance(-3, 0.5) == 3.0
    assert box.distance(5, 5) == 5.0
    assert Pillar(0, 0, 1).distance(3, 4) == 4.0
    assert Pillar(0, 0, 1).distance(0.5, 0) == 0.0


def test_outside_the_floor_everything_is_solid() -> None:
    world = World(Box(0, 0, 4, 4), ())
    assert world.clearance(2, 1) == 1.0
    assert world.clearance(-1, 2) == 0.0


def test_the_robot_starts_where_it_has_room() -> None:
    assert HOUSE.clearance(HOUSE.start.x, HOUSE.start.y) > Chassis().radius + 0.2


def test_the_map_covers_the_floor() -> None:
    assert (MAP.columns, MAP.rows, MAP.resolution) == (200, 160, 0.05)
    assert (MAP.left, MAP.bottom) == (-5.0, -4.0)
    assert len(MAP.cells) == 200 * 160
    assert set(MAP.cells) == {FREE, OCCUPIED}


@given(st.integers(0, 199), st.integers(0, 159))
def test_each_cell_tells_whether_its_centre_is_solid(column: int, row: int) -> None:
    x, y = -5.0 + (column + 0.5) * 0.05, -4.0 + (row + 0.5) * 0.05
    solid = HOUSE.clearance(x, y) == 0.0
    assert MAP.cells[row * MAP.columns + column] == (OCCUPIED if solid else FREE)


def test_the_border_is_closed() -> None:
    edge = [MAP.cells[i] for i in range(200)] + [MAP.cells[-1 - i] for i in range(200)]
    edge += [MAP.cells[row * 200] for row in range(160)] + [MAP.cells[row * 200 + 199] for row in range(160)]
    assert set(edge) == {OCCUPIED}


def test_outer_walls_have_the_thickness_asked_for() -> None:
    world = World(Box(0, 0, 4, 3), walled(Box(0, 0, 4, 3), 0.2))
    assert world.clearance(2, 1.5) == pytest.approx(1.3)
    assert world.clearance(0.1, 1.5) == 0.0


coordinate = st.floats(-100, 100)
poses = st.builds(Pose, coordinate, coordinate, st.floats(-math.pi, math.pi))


@given(poses, poses)
def test_seen_from_undoes_after(base: Pose, relative: Pose) -> None:
    back = base.after(relative).seen_from(base)
    assert (back.x, back.y) == pytest.approx((relative.x, relative.y), abs=1e-9)
    assert wrap_angle(back.heading - relative.heading) == pytest.approx(0.0, abs=1e-9)


@given(st.floats(-1e4, 1e4))
def test_a_wrapped_angle_is_the_same_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


def test_a_half_circle_ends_opposite() -> None:
    pose = Pose().moved(linear=math.pi, angular=math.pi, seconds=1.0)
    assert (pose.x, pose.y) == pytest.approx((0.0, 2.0))
    assert pose.heading == pytest.approx(math.pi)


def test_a_tiny_turn_is_nearly_straight() -> None:
    assert Pose().moved(1.0, 1e-12, 1.0).x == pytest.approx(1.0)
    assert Pose().moved(1.0, 1e-6, 1.0).x == pytest.approx(1.0)
