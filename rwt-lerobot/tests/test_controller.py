"""Trajectories within the limits of each joint, in simulated time."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

import anyio
import pytest

from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_lerobot.joints.controller import TrajectoryController
from rwt_lerobot.joints.limits import JointLimit
from rwt_participant.goals import GoalStatus

LIMITS = (JointLimit("pan", -1, 1, speed=1.0, step=0.5), JointLimit("lift", -2, 2, speed=2.0, step=0.5))


class Lab:
    """Controller of joints that are where they are commanded, unless `stuck`."""

    def __init__(self, graph: MemoryGraph) -> None:
        self.node = Node(graph, "robot")
        self.reports: list[str] = []
        self.controller = TrajectoryController(self.node, LIMITS, "/arm_controller", self.reports.append)
        self.stuck = False
        self.controller.measure((0.0, 0.0))

    def run(self, seconds: float) -> tuple[float, ...]:
        for _ in range(round(seconds / 0.02)):
            setpoint = self.controller.step(0.02)
            assert setpoint is not None
            self.controller.measure((0.0, 0.0) if self.stuck else setpoint)
        assert self.controller.setpoint is not None
        return self.controller.setpoint

    def command(self, *points: tuple[float, list[float]], names: list[str] | None = None) -> None:
        self.node.publish(
            self.controller.topic, _trajectory(points, names), "trajectory_msgs/JointTrajectory"
        )


def _trajectory(points: Any, names: list[str] | None = None) -> dict[str, Any]:
    return {
        "joint_names": ["pan", "lift"] if names is None else names,
        "points": [
            {"positions": positions, "time_from_start": {"sec": int(at), "nanosec": round(at % 1 * 1e9)}}
            for at, positions in points
        ],
    }


@pytest.fixture
async def lab() -> AsyncIterator[Lab]:
    async with MemoryGraph(clock=SimulatedClock()) as graph:
        yield Lab(graph)


@pytest.mark.anyio
async def test_a_timed_point_is_reached_in_time(lab: Lab) -> None:
    lab.command((1.0, [0.5, -1.0]))
    assert lab.run(0.5) == pytest.approx((0.25, -0.5))
    assert lab.run(0.52) == pytest.approx((0.5, -1.0))
    assert lab.reports == []


@pytest.mark.anyio
async def test_a_command_without_a_time_moves_at_the_maximum_speed(lab: Lab) -> None:
    lab.command((0.0, [0.4, 0.4]))
    assert lab.run(0.1) == pytest.approx((0.1, 0.2))
    lab.command((0.0, [-0.1]), names=["pan"])
    assert lab.run(0.1)[0] == pytest.approx(0.0)


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("points", "names", "reason"),
    [
        ([(1.0, [1.2, 0.0])], None, "pan moves from -1 to 1 rad, not to 1.2"),
        ([(1.0, [float("nan"), 0.0])], None, "not to nan"),
        ([(0.1, [0.5, 0.0])], None, "pan would move at 5 rad/s before 0.1 s; its maximum is 1 rad/s"),
        ([(0.0, [0.0, 0.6])], None, "lift is 0.6 rad away from 0.6 rad; a command without a time"),
        ([(1.0, [0.0])], None, "a point has 1 positions for 2 joints"),
        ([(1.0, [0.0])], ["knee"], "'knee' is not a joint; the robot has pan, lift"),
        ([(1.0, [0.0])], ["k" * 9_000], f"'{'k' * 100}' is not a joint"),
        ([(0.01 * number, [0.0, 0.0]) for number in range(1, 5002)], None, "5001 points are more than 5000"),
        ([(1.0, [0.0, 0.1])], ["pan", "pan"], "name each joint once"),
        ([(1.0, [0.1, 0.1]), (0.5, [0.1, 0.1])], None, "a point at 0.5 s comes after one at 1 s"),
    ],
)
async def test_rejections_state_the_reason(lab: Lab, points: Any, names: Any, reason: str) -> None:
    lab.command(*points, names=names)
    assert len(lab.reports) == 1
    assert lab.reports[0].startswith("rejected the trajectory on /arm_controller/joint_trajectory: ")
    assert reason in lab.reports[0]
    assert lab.run(0.1) == (0.0, 0.0)
    goal = await lab.node.send_goal(
        "/arm_controller/follow_joint_trajectory", {"trajectory": _trajectory(points, names)}
    )
    status, result = await goal.result()
    assert status is GoalStatus.ABORTED
    assert reason in result.error_string


@pytest.mark.anyio
async def test_an_empty_trajectory_holds_and_repeated_stops_do_not_lower_the_arm(lab: Lab) -> None:
    lab.command((1.0, [0.5, -1.0]))
    held = lab.run(0.5)
    for _ in range(20):
        lab.command(names=[])
        lab.controller.measure((held[0] - 0.05, held[1] - 0.05))  # It sags under its weight.
        assert lab.controller.step(0.02) == held
    assert lab.reports == []


@pytest.mark.anyio
async def test_a_goal_succeeds_is_canceled_or_fails_by_its_state(lab: Lab) -> None:
    async def outcome(cancel: bool = False) -> Any:
        goal = await lab.node.send_goal(
            "/arm_controller/follow_joint_trajectory", {"trajectory": _trajectory([(0.5, [0.2, 0.2])])}
        )
        await anyio.wait_all_tasks_blocked()
        lab.run(0.2)
        if cancel:
            goal.cancel()
            await anyio.wait_all_tasks_blocked()
        lab.run(2.0)
        return await goal.result()

    assert (await outcome(cancel=True)).status is GoalStatus.CANCELED
    assert (await outcome()).status is GoalStatus.SUCCEEDED
    lab.stuck = True
    lab.run(0.1)
    failed = await outcome()
    assert (failed.status, failed.result.error_code) == (GoalStatus.ABORTED, -5)
    assert "pan is at 0 rad and does not reach 0.2 rad" in failed.result.error_string
