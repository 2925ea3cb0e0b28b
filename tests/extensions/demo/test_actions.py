"""Services and actions: sums, Fibonacci, and driving to a pose."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rwt_interfaces import NOETIC
from rwt_participant.errors import GoalRejected, ServiceFailed
from rwt_participant.goals import GoalStatus

pytestmark = pytest.mark.anyio

NAVIGATE = "/navigate_to_pose"


def pose(x: float, y: float, heading: float = 0.0, frame: str = "map") -> dict[str, object]:
    orientation = {"z": math.sin(heading / 2), "w": math.cos(heading / 2)}
    return {
        "pose": {
            "header": {"frame_id": frame},
            "pose": {"position": {"x": x, "y": y}, "orientation": orientation},
        }
    }


async def in_map(lab: Any) -> tuple[float, float, float]:
    lab.clock.advance(0.05)
    position = lab.latest("/odom").pose.pose
    heading = 2 * math.atan2(position.orientation.z, position.orientation.w)
    return position.position.x - 3.4, position.position.y - 2.5, heading


async def under_way(lab: Any, x: float, y: float) -> Any:
    """A goal to which the robot drives."""
    handle = await lab.user.send_goal(NAVIGATE, pose(x, y))
    await lab.settle()
    return handle


async def test_it_adds(lab: Any) -> None:
    answer = await lab.user.call("/add_two_ints", {"a": 2**40, "b": -1})
    assert answer.sum == 2**40 - 1


async def test_a_sum_that_does_not_fit_fails_with_the_reason(lab: Any) -> None:
    with pytest.raises(ServiceFailed, match="does not fit an int64"):
        await lab.user.call("/add_two_ints", {"a": 2**63 - 1, "b": 1})


async def test_fibonacci_counts_up_with_feedback(lab: Any) -> None:
    heard: list[Any] = []
    handle = await lab.user.send_goal("/fibonacci", {"order": 7}, on_feedback=heard.append)
    await lab.pass_time(4.0)
    status, result = await handle.result()
    assert status is GoalStatus.SUCCEEDED
    # ROS 1's tutorial server goes one number further than those of ROS 2.
    numbers = [0, 1, 1, 2, 3, 5, 8, 13, 21][: 9 if lab.graph.distro is NOETIC else 8]
    assert list(result.sequence) == numbers
    assert [len(feedback.sequence) for feedback in heard] == list(range(3, len(numbers) + 1))


async def test_fibonacci_can_be_canceled(lab: Any) -> None:
    handle = await lab.user.send_goal("/fibonacci", {"order": 40})
    await lab.pass_time(1.2)
    handle.cancel()
    await lab.pass_time(0.6)
    status, result = await handle.result()
    assert status is GoalStatus.CANCELED
    assert list(result.sequence) == [0, 1, 1, 2]


@pytest.mark.parametrize("order", [-1, 47])
async def test_fibonacci_refuses_an_order_it_cannot_count_to(lab: Any, order: int) -> None:
    highest = 45 if lab.graph.distro is NOETIC else 46
    with pytest.raises(GoalRejected, match=f"order must be 0 to {highest}, where int32 ends, got {order}"):
        await (await lab.user.send_goal("/fibonacci", {"order": order})).result()


async def test_it_drives_to_a_pose_in_another_room(lab: Any) -> None:
    heard: list[Any] = []
    plans = lab.watch("/plan")
    handle = await lab.user.send_goal(NAVIGATE, pose(2.8, 2.6, 1.0), on_feedback=heard.append)
    await lab.settle()
    lab.clock.advance(30.0)
    await lab.settle()
    status, _ = await handle.result()
    assert status is GoalStatus.SUCCEEDED
    x, y, heading = await in_map(lab)
    assert math.dist((x, y), (2.8, 2.6)) < 0.06
    assert heading == pytest.approx(1.0, abs=0.06)
    assert plans[-1].poses[-1].pose.position.x == 2.8
    _check_feedback(lab, heard)


def _check_feedback(lab: Any, heard: list[Any]) -> None:
    took = [lab.nanoseconds(feedback.navigation_time) for feedback in heard]
    assert took == sorted(took)
    assert took[10] - took[5] == pytest.approx(1_000_000_000, abs=60_000_000)
    distances = [feedback.distance_remaining for feedback in heard]
    assert distances[0] > 7.0
    assert distances[-1] < 0.1
    assert heard[-1].current_pose.header.frame_id == "map"
    assert heard[-1].current_pose.pose.position.x == pytest.approx(2.8, abs=0.1)


@pytest.mark.parametrize(
    ("frame", "x", "y"),
    [("odom", -2.4, -2.5), ("/odom", -2.4, -2.5), ("base_link", -2.4, -2.5), ("", -2.0, -1.0)],
)
async def test_goals_may_be_in_any_frame_of_the_robot(lab: Any, frame: str, x: float, y: float) -> None:
    goal = pose(1.0, 0.0, frame=frame) if frame else pose(x, y)
    handle = await lab.user.send_goal(NAVIGATE, goal)
    await lab.settle()
    lab.clock.advance(15.0)
    assert (await handle.result())[0] is GoalStatus.SUCCEEDED
    assert (await in_map(lab))[:2] == pytest.approx((x, y), abs=0.06)


async def test_a_canceled_goal_stops_the_robot(lab: Any) -> None:
    odometry = lab.watch("/odom")
    handle = await under_way(lab, 0.5, -2.5)
    lab.clock.advance(2.0)
    assert odometry[-1].twist.twist.linear.x > 0.5
    handle.cancel()
    await lab.pass_time(1.0)
    status, _ = await handle.result()
    assert status is GoalStatus.CANCELED
    there = odometry[-1].pose
    lab.clock.advance(2.0)
    assert odometry[-1].twist.twist.linear.x == 0.0
    assert odometry[-1].pose == there


@pytest.mark.parametrize(
    ("service", "asked"), [("/enable_motors", {"data": False}), ("/reset", {})], ids=["motors off", "reset"]
)
async def test_a_service_aborts_the_trip(lab: Any, service: str, asked: dict[str, bool]) -> None:
    handle = await under_way(lab, 0.5, -2.5)
    lab.clock.advance(1.0)
    await lab.user.call(service, asked)
    lab.clock.advance(0.1)
    assert (await handle.result())[0] is GoalStatus.ABORTED


async def test_a_newer_goal_takes_over(lab: Any) -> None:
    first = await under_way(lab, 0.5, -2.5)
    lab.clock.advance(1.0)
    second = await under_way(lab, -3.4, -1.0)
    assert (await first.result())[0] is GoalStatus.ABORTED
    lab.clock.advance(20.0)
    assert (await second.result())[0] is GoalStatus.SUCCEEDED
    assert (await in_map(lab))[:2] == pytest.approx((-3.4, -1.0), abs=0.06)


async def test_even_a_goal_that_fails_ends_the_one_before(lab: Any) -> None:
    first = await under_way(lab, 0.5, -2.5)
    second = await under_way(lab, 50.0, 0.0)
    assert [(await handle.result())[0] for handle in (first, second)] == [GoalStatus.ABORTED] * 2


async def test_a_hand_on_the_stick_goes_first_and_the_trip_goes_on(lab: Any) -> None:
    handle = await under_way(lab, 0.5, -2.5)
    lab.clock.advance(1.0)
    before = (await in_map(lab))[2]
    lab.command(angular=1.5, seconds=1.0)
    assert (await in_map(lab))[2] - before > 1.0
    # A released stick that goes on sending zeros does not hold the robot.
    lab.command(seconds=20.0)
    assert (await handle.result())[0] is GoalStatus.SUCCEEDED


async def test_a_goal_can_be_canceled_while_somebody_drives(lab: Any) -> None:
    handle = await under_way(lab, 0.5, -2.5)
    lab.command(angular=1.0, seconds=1.0)
    handle.cancel()
    lab.command(angular=1.0, seconds=0.2)
    assert (await handle.result())[0] is GoalStatus.CANCELED


@pytest.mark.parametrize(
    ("goal", "reason"),
    [(pose(0, 0, frame="moon"), "use map, odom or base_link"), (pose(math.nan, 0), "not a finite number")],
)
async def test_a_goal_that_means_nothing_is_rejected(lab: Any, goal: dict[str, object], reason: str) -> None:
    with pytest.raises(GoalRejected, match=reason):
        await (await lab.user.send_goal(NAVIGATE, goal)).result()


async def test_the_robots_place_in_the_map_is_published_for_pages(lab: Any) -> None:
    poses = lab.watch("/robot_pose")
    lab.command(linear=0.5, seconds=1.0)
    moved = poses[-1].position.x - poses[0].position.x
    assert (poses[0].position.x, poses[0].position.y) == pytest.approx((-3.4, poses[-1].position.y), abs=0.05)
    assert moved > 0.3


async def test_pages_of_ros_1_send_it_where_they_want_by_move_base(lab: Any, distro: str) -> None:
    if distro != "noetic":
        assert lab.graph.action("/move_base") is None
        return
    feedback: list[Any] = []
    start = lab.latest("/robot_pose").position
    target = {
        "header": {"frame_id": "/map"},
        "pose": {"position": {"x": start.x + 0.6, "y": start.y}, "orientation": {"w": 1.0}},
    }
    goal = await lab.user.send_goal("/move_base", {"target_pose": target}, on_feedback=feedback.append)
    await lab.pass_time(10.0)
    await goal.result()
    assert lab.latest("/robot_pose").position.x == pytest.approx(start.x + 0.6, abs=0.1)
    assert feedback[-1].base_position.header.frame_id == "map"
    rejected = {"target_pose": {"header": {"frame_id": "moon"}}}
    with pytest.raises(GoalRejected, match='frame "moon"'):
        await lab.user.send_goal("/move_base", rejected)
