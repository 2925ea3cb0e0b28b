"""Units of motors, against a table worked out by hand."""

from __future__ import annotations

import math

import pytest

from rwt_lerobot.joints.limits import DescriptionError, urdf_limits
from rwt_lerobot.joints.scales import Scale, Unit
from rwt_lerobot.node import UnknownUnit, motor_joints

HALF = math.pi / 2
#: Ticks 1024 to 3072 of 4096: half a turn, of which LeRobot counts 4095 ticks to a turn.
SPAN = 2048 * 2 * math.pi / 4095


@pytest.mark.parametrize(
    ("unit", "value", "radians"),
    [
        ("degrees", 0.0, 0.0),
        ("degrees", 90.0, HALF),
        ("degrees", -45.0, -math.pi / 4),
        ("range_m100_100", -100.0, -1.0),
        ("range_m100_100", 100.0, 3.0),
        ("range_m100_100", 0.0, 1.0),
        ("range_m100_100", 50.0, 2.0),
        ("range_0_100", 0.0, -1.0),
        ("range_0_100", 100.0, 3.0),
        ("range_0_100", 25.0, 0.0),
        ("radians", 0.25, 0.25),
    ],
)
def test_units(unit: Unit, value: float, radians: float) -> None:
    scale = Scale(unit, -1.0, 3.0)
    assert scale.to_radians(value) == pytest.approx(radians)
    assert scale.from_radians(radians) == pytest.approx(value)


def test_joints_of_a_calibrated_arm(arm: object) -> None:
    pan, lift, gripper = motor_joints(arm)
    assert [each.scale.unit for each in (pan, lift, gripper)] == ["degrees", "range_m100_100", "range_0_100"]
    for joint in (pan, lift):
        assert (joint.limit.lower, joint.limit.upper) == pytest.approx((-SPAN / 2, SPAN / 2))
    assert lift.scale.to_radians(100) == pytest.approx(SPAN / 2)
    assert (gripper.limit.lower, gripper.limit.upper) == pytest.approx((0, SPAN))
    assert gripper.scale.to_radians(50) == pytest.approx(SPAN / 2)


def test_a_urdf_has_precedence_over_the_calibration(arm: object) -> None:
    limits = urdf_limits(
        '<robot name="r"><joint name="lift" type="revolute">'
        '<limit lower="-1" upper="3" velocity="0.5"/></joint>'
        '<joint name="base" type="fixed"/></robot>'
    )
    _, lift, _ = motor_joints(arm, limits, step=0.3)
    assert (lift.limit.lower, lift.limit.upper, lift.limit.speed, lift.limit.step) == (-1, 3, 0.5, 0.3)
    assert lift.scale.to_radians(0) == 1.0


def test_what_is_not_known_is_an_error() -> None:
    robot = type("Robot", (), {"action_features": {"knee.pos": float}})()
    with pytest.raises(UnknownUnit, match="the unit of motor 'knee' is '': state one of degrees, "):
        motor_joints(robot)
    with pytest.raises(UnknownUnit, match="the range of motor 'knee' is not known"):
        motor_joints(robot, units={"knee": "range_0_100"})
    with pytest.raises(DescriptionError, match="the URDF is not XML"):
        urdf_limits("<robot")
