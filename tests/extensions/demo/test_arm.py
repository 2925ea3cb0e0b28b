"""The arm: trajectories are followed in time or refused, and `/tf` says where the hand is."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.demo.arm.kinematics import ARM, REST
from rwt_graph.trajectories import Trajectory, Waypoint
from rwt_participant.errors import GoalRejected
from rwt_participant.goals import GoalStatus

ACTION = "/arm_controller/follow_joint_trajectory"
TOPIC = "/arm_controller/joint_trajectory"
NAMES = [joint.name for joint in ARM]


def _point(seconds: float, positions: Any, velocities: Any = ()) -> dict[str, Any]:
    whole = int(seconds)
    after = {"sec": whole, "nanosec": round((seconds - whole) * 1e9)}
    return {"positions": list(positions), "velocities": list(velocities), "time_from_start": after}


def _goal(*points: dict[str, Any], names: Any = NAMES, **header: Any) -> dict[str, Any]:
    return {"trajectory": {"header": header, "joint_names": list(names), "points": list(points)}}


def _arm(message: Any) -> tuple[Any, Any]:
    """Positions and velocities of the arm in a `sensor_msgs/JointState`."""
    assert list(message.name)[2:] == NAMES
    return list(message.position)[2:], list(message.velocity)[2:]


@pytest.mark.anyio
async def test_it_rests_until_somebody_moves_it(lab: Any) -> None:
    states = lab.watch("/joint_states")
    await lab.pass_time(0.5)
    assert all(_arm(state) == (list(REST), [0.0] * 6) for state in states)


@pytest.mark.anyio
async def test_a_trajectory_is_followed_in_time(lab: Any) -> None:
    states = lab.watch("/joint_states")
    feedback: list[Any] = []
    there = [0.4, -0.2, 1.2, 0.5, -0.5, 1.0]
    handle = await lab.user.send_goal(ACTION, _goal(_point(2.0, there)), on_feedback=feedback.append)
    await lab.settle()
    began = lab.clock.monotonic()
    await lab.pass_time(1.0)
    share = (lab.clock.monotonic() - began) / 2.0
    positions, velocities = _arm(states[-1])
    assert positions == pytest.approx([a + (b - a) * share for a, b in zip(REST, there, strict=True)])
    assert velocities == pytest.approx([(b - a) / 2.0 for a, b in zip(REST, there, strict=True)])
    await lab.pass_time(1.2)
    status, result = await handle.result()
    assert (status, result.error_code, result.error_string) == (GoalStatus.SUCCEEDED, 0, "")
    assert _arm(states[-1]) == (pytest.approx(there), [0.0] * 6)
    assert 15 <= len(feedback) <= 22
    assert list(feedback[0].joint_names) == NAMES
    assert list(feedback[-1].error.positions) == [0.0] * 6


@pytest.mark.anyio
async def test_some_joints_in_any_order_and_a_start_where_the_arm_is(lab: Any) -> None:
    start, end = _point(0.0, [REST[2], REST[0]]), _point(1.0, [1.0, 0.3], [0.0, 0.0])
    handle = await lab.user.send_goal(ACTION, _goal(start, end, names=["elbow_joint", "shoulder_pan_joint"]))
    await lab.pass_time(1.2)
    assert (await handle.result())[0] is GoalStatus.SUCCEEDED
    positions, _ = _arm(lab.latest("/joint_states"))
    assert positions == pytest.approx([0.3, REST[1], 1.0, *REST[3:]])


@pytest.mark.anyio
async def test_a_time_to_come_is_waited_for(lab: Any) -> None:
    seconds = lab.clock.time_ns() // 1_000_000_000 + 2
    goal = _goal(_point(1.0, [0.5, *REST[1:]]), stamp={"sec": seconds})
    states = lab.watch("/joint_states")
    handle = await lab.user.send_goal(ACTION, goal)
    await lab.pass_time(1.5)
    assert _arm(states[-1])[0][0] == 0.0
    await lab.pass_time(2.0)
    assert (await handle.result())[0] is GoalStatus.SUCCEEDED


@pytest.mark.anyio
async def test_the_topic_moves_it_too_and_says_what_is_wrong(lab: Any) -> None:
    lines = lab.watch("/rosout")
    commands = lab.user.advertise(TOPIC, "trajectory_msgs/JointTrajectory")
    commands.publish(_goal(_point(0.5, [0.2, *REST[1:]]))["trajectory"])
    await lab.pass_time(0.7)
    assert _arm(lab.latest("/joint_states"))[0][0] == pytest.approx(0.2)
    commands.publish(_goal(_point(0.1, [3.0, *REST[1:]]))["trajectory"])
    await lab.settle()
    assert "shoulder_pan_joint would turn at 28 rad/s" in lines[-1].msg


@pytest.mark.anyio
@pytest.mark.parametrize("by", ["cancel", "an empty trajectory"])
async def test_it_is_stopped_where_it_is(lab: Any, by: str) -> None:
    handle = await lab.user.send_goal(ACTION, _goal(_point(2.0, [1.0, *REST[1:]])))
    await lab.pass_time(1.0)
    if by == "cancel":
        handle.cancel()
    else:
        lab.user.publish(TOPIC, {}, "trajectory_msgs/JointTrajectory")
    await lab.pass_time(0.5)
    status, result = await handle.result()
    assert (status, result.error_string) == (
        (GoalStatus.CANCELED, "canceled")
        if by == "cancel"
        else (GoalStatus.ABORTED, "an empty trajectory stopped the arm")
    )
    positions, velocities = _arm(lab.latest("/joint_states"))
    assert 0.3 < positions[0] < 0.7
    assert velocities == [0.0] * 6


@pytest.mark.anyio
async def test_the_newest_goal_wins_and_a_reset_ends_it(lab: Any) -> None:
    first = await lab.user.send_goal(ACTION, _goal(_point(2.0, [1.0, *REST[1:]])))
    await lab.pass_time(0.5)
    second = await lab.user.send_goal(ACTION, _goal(_point(2.0, [-1.0, *REST[1:]])))
    await lab.pass_time(0.1)
    status, result = await first.result()
    assert (status, result.error_string) == (GoalStatus.ABORTED, "a newer trajectory took its place")
    await lab.pass_time(0.5)
    await lab.user.call("/reset", {})
    assert (await second.result())[1].error_string == "the robot was reset"
    await lab.pass_time(0.1)
    assert _arm(lab.latest("/joint_states"))[0] == list(REST)


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        (_goal(), "has no points"),
        (_goal(_point(1, REST), names=[]), "name each joint once; the arm has shoulder_pan_joint, "),
        (_goal(_point(1, [0, 0]), names=["elbow_joint"] * 2), "name each joint once"),
        (_goal(_point(1, [0]), names=["knee"]), "knee is no joint; the arm has shoulder_pan_joint, "),
        (_goal(_point(1, REST[1:])), "a point has 5 positions for 6 joints"),
        (_goal(_point(1, REST, [0.0])), "a point has 1 velocities for 6 joints"),
        (_goal(_point(1, [math.nan, *REST[1:]])), "not a finite number"),
        (_goal(_point(9, [3.2, *REST[1:]])), "shoulder_pan_joint turns 3.1 rad either way, not to 3.2"),
        (_goal(_point(1, REST, [9.0, *REST[1:]])), "shoulder_pan_joint can turn at 2 rad/s, not at 9 rad/s"),
        (_goal(_point(0, [1, *REST[1:]])), "the first may be at 0 s where the arm is"),
        (_goal(_point(2, REST), _point(1, REST)), "a point at 1 s comes after one at 2 s"),
        (_goal(_point(0.1, [1, *REST[1:]])), "would turn at 10 rad/s before 0.1 s; it can do 2 rad/s"),
    ],
)
async def test_what_it_cannot_do_is_refused(lab: Any, goal: Any, reason: str) -> None:
    with pytest.raises(GoalRejected, match=re.escape(reason)):
        await lab.user.send_goal(ACTION, goal)


def _matrix(transform: Any) -> Any:
    q, t = transform.rotation, transform.translation
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), t.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), t.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), t.z],
            [0, 0, 0, 1],
        ]
    )


@pytest.mark.anyio
async def test_tf_says_where_the_hand_is(lab: Any) -> None:
    angles = [0.7, 0.4, 1.1, -0.3, 0.8, 0.2]
    await lab.user.send_goal(ACTION, _goal(_point(2.0, angles)))
    await lab.pass_time(2.2)
    edges = {t.child_frame_id: t for t in lab.latest("/tf_static").transforms}
    edges |= {t.child_frame_id: t for t in lab.latest("/tf").transforms}
    hand, frame = np.eye(4), "tool_link"
    while frame != "base_link":
        hand = _matrix(edges[frame].transform) @ hand
        frame = edges[frame].header.frame_id
    # By plane geometry: the first joint turns a plane, in which the next two lean; then the wrist.
    pan, lift, elbow, roll, bend, _ = angles
    lean = lift + elbow
    reach = 0.18 * math.sin(lift) + 0.18 * math.sin(lean)
    height = 0.15 + 0.09 + 0.18 * math.cos(lift) + 0.18 * math.cos(lean)
    out, side, up = (
        0.06 * v for v in (math.sin(bend) * math.cos(roll), math.sin(bend) * math.sin(roll), math.cos(bend))
    )
    along = reach + out * math.cos(lean) + up * math.sin(lean)
    expected = (
        -0.12 + along * math.cos(pan) - side * math.sin(pan),
        along * math.sin(pan) + side * math.cos(pan),
        height - out * math.sin(lean) + up * math.cos(lean),
    )
    assert tuple(hand[:3, 3]) == pytest.approx(expected, abs=1e-6)


angles = st.floats(-3, 3)


@given(st.lists(angles, min_size=4, max_size=4), st.floats(0.1, 5), st.floats(0, 1))
def test_splines_pass_their_waypoints_and_their_slopes_are_their_velocities(
    ends: list[float], span: float, share: float
) -> None:
    p0, p1, v0, v1 = ends
    way = Trajectory([Waypoint(1.0, (p0,), (v0,)), Waypoint(1.0 + span, (p1,), (v1,))])
    assert way.duration == 1.0 + span
    assert way.goal == way.at(1.0 + span)[0] == (p1,)
    assert way.at(0.5) == ((p0,), (0.0,))
    (place,), (speed,) = way.at(1.0)
    assert (place, speed) == pytest.approx((p0, v0))
    step = span * 1e-5
    seconds = 1.0 + step + share * (span - 3 * step)
    slope = (way.at(seconds + step)[0][0] - way.at(seconds - step)[0][0]) / (2 * step)
    assert way.at(seconds)[1][0] == pytest.approx(slope, abs=1e-3)


def test_without_velocities_it_goes_straight() -> None:
    way = Trajectory([Waypoint(0.0, (0.0,), (0.0,)), Waypoint(2.0, (1.0,)), Waypoint(3.0, (1.0,))])
    assert way.at(0.5) == ((0.25,), (0.5,))
    assert way.at(2.5) == ((1.0,), (0.0,))
