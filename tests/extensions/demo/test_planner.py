"""Ways through the house, and the steering along them."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rwt.extensions.demo.drive import Chassis, DifferentialDrive, MotorLimits
from rwt.extensions.demo.navigation.planner import NoPath, PathFollower, Planner
from rwt.extensions.demo.world.map import Box, Pose, World, house, walled, wrap_angle

CHASSIS = Chassis()
HOUSE = house()
PLANNER = Planner(HOUSE, CHASSIS.radius)
START = (HOUSE.start.x, HOUSE.start.y)


def length(corners: list[tuple[float, float]]) -> float:
    return sum(math.dist(a, b) for a, b in itertools.pairwise(corners))


def clear_points() -> st.SearchStrategy[tuple[float, float]]:
    return st.tuples(st.floats(-4.9, 4.9), st.floats(-3.9, 3.9)).filter(
        lambda point: HOUSE.clearance(*point) >= 0.26
    )


@settings(max_examples=20)
@given(clear_points(), clear_points())
def test_ways_lead_from_start_to_goal_without_touching_anything(
    start: tuple[float, float], goal: tuple[float, float]
) -> None:
    corners = PLANNER.plan(start, goal)
    assert corners[0] == start
    assert corners[-1] == goal
    for (x1, y1), (x2, y2) in itertools.pairwise(corners):
        for i in range(51):
            assert HOUSE.clearance(x1 + (x2 - x1) * i / 50, y1 + (y2 - y1) * i / 50) >= CHASSIS.radius


def test_a_free_line_is_taken_straight() -> None:
    field = World(Box(0, 0, 10, 10), walled(Box(0, 0, 10, 10)))
    assert Planner(field, 0.2).plan((1.0, 5.0), (9.0, 5.0)) == [(1.0, 5.0), (9.0, 5.0)]


def test_a_way_to_the_next_room_goes_through_its_door() -> None:
    corners = PLANNER.plan(START, (-3.0, 1.0))
    assert length(corners) < 5.0
    ((x, _),) = {
        (a[0] + (b[0] - a[0]) * (-0.05 - a[1]) / (b[1] - a[1]), 0)
        for a, b in itertools.pairwise(corners)
        if a[1] < -0.05 <= b[1]
    }
    assert -3.6 < x < -2.6


@pytest.mark.parametrize("goal", [(-3.9, 2.0), (-4.85, 0.5), (9.0, 9.0)], ids=["table", "at wall", "outside"])
def test_a_goal_without_room_is_refused(goal: tuple[float, float]) -> None:
    with pytest.raises(NoPath, match=r"within 0\.25 m of something solid"):
        PLANNER.plan(START, goal)


def test_a_walled_off_goal_is_refused() -> None:
    floor = Box(0, 0, 6, 4)
    world = World(floor, (*walled(floor), Box(2.9, 0, 3.0, 4)))
    with pytest.raises(NoPath, match="no way leads from"):
        Planner(world, 0.2).plan((1, 1), (5, 1))


def test_a_robot_that_touches_a_wall_finds_its_way_out() -> None:
    corners = PLANNER.plan((-4.69, 0.21), (0.0, 0.0))
    assert corners[0] == (-4.69, 0.21)


@settings(max_examples=10)
@given(clear_points(), st.floats(-math.pi, math.pi), st.floats(0.1, 2.0))
def test_steering_arrives_at_the_pose_without_bumping(
    goal: tuple[float, float], heading: float, speed: float
) -> None:
    assume(math.dist(goal, START) > 0.1)
    drive = DifferentialDrive(HOUSE, CHASSIS, MotorLimits(speed, 2.0, 2.0, 8.0))
    target = Pose(*goal, heading)
    follower = PathFollower(PLANNER.plan(START, goal), target, drive.limits)
    for _ in range(round((30 + follower.remaining(drive.pose) / speed * 2) / 0.05)):
        drive.step(follower.steer(drive.pose), 0.05)
        assert not drive.bumped
        if follower.arrived(drive.pose) and drive.velocity.is_zero:
            break
    assert drive.pose.distance_to(*goal) <= 0.05
    assert abs(wrap_angle(drive.pose.heading - heading)) <= 0.05


def test_what_remains_shrinks_to_nothing() -> None:
    drive = DifferentialDrive(HOUSE, CHASSIS, MotorLimits())
    corners = PLANNER.plan(START, (2.8, 3.0))
    follower = PathFollower(corners, Pose(2.8, 3.0), drive.limits)
    assert follower.remaining(drive.pose) == pytest.approx(length(corners))
    before = math.inf
    for _ in range(2000):
        drive.step(follower.steer(drive.pose), 0.05)
        assert follower.remaining(drive.pose) < before + 0.05
        before = follower.remaining(drive.pose)
    assert before < 0.06
