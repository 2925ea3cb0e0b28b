"""The differential drive: limits, arcs, wheels, walls."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwt.extensions.demo.drive import Chassis, DifferentialDrive, MotorLimits, Velocity
from rwt.extensions.demo.world.map import Box, World, house, walled

STEP = 0.05
CHASSIS = Chassis()
FIELD = World(Box(-50, -50, 50, 50), ())
ROOM = World(Box(-2, -2, 2, 2), walled(Box(-2, -2, 2, 2)))


def drive_in(world: World) -> DifferentialDrive:
    return DifferentialDrive(world, CHASSIS, MotorLimits(1.0, 2.0, 2.0, 8.0))


def run(drive: DifferentialDrive, wanted: Velocity, seconds: float) -> None:
    for _ in range(round(seconds / STEP)):
        drive.step(wanted, STEP)


def test_speed_grows_with_the_acceleration_up_to_what_is_wanted() -> None:
    drive = drive_in(FIELD)
    drive.step(Velocity(0.5, 0.0), STEP)
    assert drive.velocity.linear == pytest.approx(0.1)
    run(drive, Velocity(0.5, 0.0), 1.0)
    assert drive.velocity == Velocity(0.5, 0.0)


def test_turning_on_the_spot_turns_the_wheels_against_each_other() -> None:
    drive = drive_in(FIELD)
    run(drive, Velocity(0.0, 1.0), 1.0)
    assert (drive.pose.x, drive.pose.y) == (0.0, 0.0)
    assert drive.left_angle == -drive.right_angle
    turned = (drive.right_angle - drive.left_angle) * CHASSIS.wheel_radius / CHASSIS.track
    assert turned == pytest.approx(drive.pose.heading)


def test_a_wall_stops_the_robot_and_lets_it_back_away() -> None:
    drive = drive_in(ROOM)
    run(drive, Velocity(1.0, 0.0), 5.0)
    at_wall = drive.bumped
    assert at_wall
    assert drive.velocity.linear == 0.0
    assert drive.pose.x == pytest.approx(1.9 - CHASSIS.radius, abs=0.021)
    run(drive, Velocity(-0.5, 0.0), 2.0)
    assert not drive.bumped
    assert drive.pose.x < 1.0


def test_at_a_wall_the_robot_can_still_turn() -> None:
    drive = drive_in(ROOM)
    run(drive, Velocity(1.0, 0.0), 3.0)
    run(drive, Velocity(1.0, 1.0), 1.0)
    assert drive.pose.heading > 0.8


commands = st.lists(
    st.tuples(st.floats(-5, 5), st.floats(-10, 10), st.floats(0.0, 0.2)), min_size=1, max_size=60
)


@settings(max_examples=50)
@given(commands)
def test_no_sequence_of_commands_leads_into_a_wall(steps: list[tuple[float, float, float]]) -> None:
    drive = DifferentialDrive(house(), CHASSIS, MotorLimits(5.0, 10.0, 20.0, 80.0))
    world = house()
    for linear, angular, seconds in steps:
        drive.step(Velocity(linear, angular), seconds)
        assert world.clearance(drive.pose.x, drive.pose.y) >= CHASSIS.radius
        assert math.isfinite(drive.left_angle + drive.right_angle)
