"""After a pause of the process or a suspension of the machine, the dead-man's stop comes before all else."""

from __future__ import annotations

from typing import Any

import pytest

from rwt.access.gate.lease import WakeWatch
from rwt_graph import SimulatedClock
from rwt_graph.clock import SteadyClock
from tests.core.access.gated_robot import CLIENT, DRIVE, GATE, GatedRobot, call, drive, settings_of


def _pause(robot: GatedRobot, seconds: float) -> None:
    """Let time pass in which no timer runs."""
    robot.clock.suspend(seconds)


@pytest.mark.parametrize("take", ["publish", "service"])
def test_commands_of_a_pause_do_not_move_the_robot(take: str) -> None:
    robot = GatedRobot({"drive": {**DRIVE, "lease": {"seconds": 0.5, "take": take}}})
    client, other = robot.client(), robot.client("agent")
    call(client, "/gate/take_lease", topic="/cmd_vel")
    drive(client, 0.5)
    robot.take()
    _pause(robot, 2.0)
    # The messages of the time before are read before the timers run.
    for each in (client, client, other, client):
        drive(each, 0.5)
    assert robot.take() == [(0.0, GATE)]
    robot.clock.advance(0.2)
    assert "ended while this server was paused" in drive(other, 0.5)
    assert {speed for speed, _ in robot.take()} == {0.0}
    robot.clock.advance(0.06)
    if take == "publish":
        assert drive(client, 0.25) == ""
        assert robot.take()[-1] == (0.25, CLIENT)


def test_a_timer_that_comes_first_bars_them_too() -> None:
    robot = GatedRobot({"drive": DRIVE})
    client = robot.client()
    drive(client, 0.5)
    _pause(robot, 2.0)
    robot.clock.advance(0.0)
    assert robot.take()[:2] == [(0.5, CLIENT), (0.0, GATE)]
    assert "ended while this server was paused" in drive(client, 0.5)


def test_a_reload_does_not_admit_commands_of_a_pause() -> None:
    robot = GatedRobot({"drive": DRIVE})
    client = robot.client()
    drive(client, 0.5)
    _pause(robot, 2.0)
    robot.clock.advance(0.0)
    other = {**DRIVE, "fields": {"linear.x": {"max": 2.0}}}
    robot.access.reload(settings_of({"rules": {"drive": other}}))
    robot.bridge.reload_roles()
    assert "ended while this server was paused" in drive(client, 0.5)


def test_a_turn_of_the_loop_that_takes_long_is_no_pause() -> None:
    robot = GatedRobot({"drive": DRIVE})
    client = robot.client()
    drive(client, 0.5)
    _pause(robot, 0.6)
    assert drive(client, 0.25) == ""
    assert [speed for speed, _ in robot.take()] == [0.5, 0.0, 0.25]


class SuspendedClock(SimulatedClock):
    """A clock of a machine that is suspended now and then.

    Attributes:
        suspended: seconds for which it was.
    """

    suspended = 0.0
    is_real = True

    def boottime(self) -> float:
        """Time with suspension."""
        return self.monotonic() + self.suspended


def test_after_a_suspension_the_robot_is_stopped_at_once() -> None:
    clock = SuspendedClock(1_700_000_000 * 10**9)
    robot = GatedRobot({"drive": {**DRIVE, "lease": {"seconds": 10}}}, clock=clock)
    client = robot.client()
    drive(client, 0.5)
    clock.advance(1.0)
    assert robot.take() == [(0.5, CLIENT)]
    clock.suspended += 3600.0
    clock.advance(0.05)
    assert robot.take() == [(0.0, GATE)]
    assert "ended while this server was paused" in drive(client, 0.5)


def test_the_watch_ends_with_the_last_lease() -> None:
    clock = SuspendedClock()
    answers = iter([True, False])
    looks: list[bool] = []

    def look(was_suspended: bool) -> bool:
        looks.append(was_suspended)
        return next(answers)

    watch = WakeWatch(clock, look)
    watch.begin()
    watch.begin()
    clock.advance(1.0)
    assert (looks, clock.pending()) == ([False, False], 0)


def test_the_time_since_boot_runs_on() -> None:
    clock: Any = SteadyClock()
    assert clock.boottime() <= clock.boottime()
