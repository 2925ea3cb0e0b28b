"""Parameters change what the robot does, and refuse what it cannot do."""

from __future__ import annotations

from typing import Any

import pytest

from rwt.extensions.demo.robot import TUNABLES
from rwt_participant.errors import ParameterRejected

pytestmark = pytest.mark.anyio


async def test_the_fastest_speed_and_turn_limit_commands(lab: Any) -> None:
    odometry = lab.watch("/odom")
    for speed, turn in ((0.2, 0.5), (1, 1.5)):
        await lab.user.params.set(lab.parameter("max_speed"), speed)
        await lab.user.params.set(lab.parameter("max_turn_rate"), turn)
        lab.command(linear=5.0, angular=-3.0, seconds=0.8)
        twist = odometry[-1].twist.twist
        assert (twist.linear.x, twist.angular.z) == pytest.approx((speed, -turn))


async def test_command_timeout_is_how_long_a_command_holds(lab: Any) -> None:
    odometry = lab.watch("/odom")
    await lab.user.params.set(lab.parameter("command_timeout"), 2.0)
    lab.command(linear=0.3, seconds=0.1)
    lab.clock.advance(1.5)
    assert odometry[-1].twist.twist.linear.x == pytest.approx(0.3)
    lab.clock.advance(1.0)
    assert odometry[-1].twist.twist.linear.x == 0.0


@pytest.mark.parametrize("value", ["fast", True, [1.0]])
async def test_a_max_speed_that_is_no_number_is_refused(lab: Any, value: object) -> None:
    with pytest.raises(ParameterRejected):
        await lab.user.params.set(lab.parameter("max_speed"), value)
    assert await lab.user.params.get(lab.parameter("max_speed")) == 0.8


@pytest.mark.parametrize("value", [0, -1.0, 5.5, float("nan")])
async def test_a_bad_max_speed_is_refused_with_the_reason(lab: Any, value: object) -> None:
    name = lab.parameter("max_speed")
    with pytest.raises(ParameterRejected, match=r"max_speed must be a number above 0 and at most 5 m/s"):
        await lab.user.params.set(name, value)
    assert await lab.user.params.get(name) == 0.8


async def test_every_tunable_is_there_with_its_default(lab: Any) -> None:
    for tunable, default in TUNABLES.items():
        assert await lab.user.params.get(lab.parameter(tunable.name)) == default


async def test_noise_may_be_zero_but_not_negative(lab: Any) -> None:
    await lab.user.params.set(lab.parameter("scan_noise"), 0)
    with pytest.raises(ParameterRejected, match=r"scan_noise must be a number from 0 to 1 m"):
        await lab.user.params.set(lab.parameter("scan_noise"), -0.1)
