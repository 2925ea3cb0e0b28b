"""A robot of LeRobot as a node: states, images, commands, and a bus that is unplugged."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator
from typing import Any

import anyio
import pytest
from anyio.abc import TaskStatus

from rwt import Server, connect
from rwt_graph import MemoryGraph, Node
from rwt_lerobot import LeRobotNode
from rwt_participant.errors import RobotError
from rwt_participant.images import image_to_numpy

TRAJECTORY = "trajectory_msgs/JointTrajectory"
TOPIC = "/arm_controller/joint_trajectory"
ACTION = "/arm_controller/follow_joint_trajectory"
ACTION_TYPE = "control_msgs/action/FollowJointTrajectory"


@pytest.fixture
async def user(arm: Any) -> AsyncIterator[Node]:
    async with MemoryGraph() as graph:
        node = LeRobotNode(Node(graph, "arm"), arm, rate=100.0, description="<robot/>")
        yield Node(graph, "user")
        node.close()


async def _until(condition: Any) -> None:
    with anyio.fail_after(20):
        while not condition():  # noqa: ASYNC110  # what is awaited is in the fake
            await anyio.sleep(0.01)


@pytest.mark.anyio
async def test_states_images_and_description(user: Node) -> None:
    state = await user.once("/joint_states", timeout=60)
    assert list(state.name) == ["pan", "lift", "gripper"]
    assert state.position[0] == pytest.approx(math.radians(10))
    assert image_to_numpy(await user.once("/front/image_raw/compressed", timeout=60)).shape == (24, 32, 3)
    assert (await user.once("/front/camera_info", timeout=60)).width == 32
    assert (await user.once("/robot_description", timeout=60)).data == "<robot/>"


@pytest.mark.anyio
async def test_nothing_is_commanded_before_the_first_trajectory(user: Node, arm: Any) -> None:
    await user.once("/joint_states", timeout=60)
    await user.once("/joint_states", timeout=60)
    assert arm.actions == []
    point = {"positions": [0.0], "time_from_start": {"nanosec": 300_000_000}}
    user.publish(TOPIC, {"joint_names": ["pan"], "points": [point]}, TRAJECTORY)
    await _until(lambda: arm.positions["pan.pos"] == pytest.approx(0.0, abs=0.01))
    assert arm.positions["lift.pos"] == pytest.approx(0.0)
    assert arm.positions["gripper.pos"] == pytest.approx(50.0)


@pytest.mark.anyio
async def test_rejections_are_on_rosout(user: Node) -> None:
    await user.once("/joint_states", timeout=60)
    lines: list[str] = []
    user.subscribe("/rosout", lambda line: lines.append(line.msg), "rcl_interfaces/Log")
    user.publish(TOPIC, {"joint_names": ["pan"], "points": [{"positions": [3.0]}]}, TRAJECTORY)
    await _until(lambda: lines)
    assert "pan moves from -1.57 to 1.57 rad, not to 3" in lines[0]


@pytest.mark.anyio
async def test_an_unplugged_bus_is_reported_and_commands_are_rejected(user: Node, arm: Any) -> None:
    await user.once("/joint_states", timeout=60)
    lines: list[str] = []
    user.subscribe("/rosout", lambda line: lines.append(line.msg), "rcl_interfaces/Log")
    arm.error = ConnectionError("no reply from motor 3")
    await _until(lambda: lines)
    assert lines == ["the robot does not answer: ConnectionError: no reply from motor 3"]
    user.publish(TOPIC, {"joint_names": ["pan"], "points": [{"positions": [0.1]}]}, TRAJECTORY)
    await _until(lambda: len(lines) > 1)
    assert "rejected the trajectory" in lines[1] and "no reply from motor 3" in lines[1]
    arm.error = None
    await _until(lambda: len(lines) > 2)
    assert "the robot answers again, and holds its position" in lines[2]
    assert arm.actions == []


@pytest.mark.anyio
async def test_a_mobile_base_stops_after_half_a_second_of_silence(arm: Any) -> None:
    arm.positions |= {"x.vel": 0.0, "y.vel": 0.0, "theta.vel": 0.0}
    async with MemoryGraph() as graph:
        node, user = LeRobotNode(Node(graph, "base"), arm, rate=100.0), Node(graph, "user")
        await user.once("/joint_states", timeout=60)
        user.publish("/cmd_vel", {"linear": {"x": 0.2}, "angular": {"z": math.pi / 2}}, "geometry_msgs/Twist")
        await _until(lambda: arm.positions["x.vel"] == 0.2)
        assert arm.positions["theta.vel"] == pytest.approx(90.0)
        velocity = await user.once("/velocity", timeout=60)
        assert velocity.twist.angular.z == pytest.approx(math.pi / 2)
        await _until(lambda: arm.positions["x.vel"] == 0.0)
        user.publish(
            "/cmd_vel", {"linear": {"x": math.nan}, "angular": {"z": math.inf}}, "geometry_msgs/Twist"
        )
        count = len(arm.actions)
        await _until(lambda: len(arm.actions) > count + 3)
        assert {action["x.vel"] for action in arm.actions[count:]} == {0.0}
        node.close()


@pytest.mark.anyio
async def test_a_robot_that_joins_a_server_over_rosbridge(arm: Any) -> None:
    async with (
        Server("ws://127.0.0.1:0") as server,
        connect(server.urls[0]) as robot,
        connect(server.urls[0]) as user,
    ):
        node = LeRobotNode(robot, arm, rate=50.0, namespace="left")
        state = await user.once("/left/joint_states", "sensor_msgs/JointState", timeout=60)
        assert state.position[0] == pytest.approx(math.radians(10))
        goal = {"joint_names": ["pan"], "points": [{"positions": [0.0], "time_from_start": {"sec": 1}}]}
        handle = await user.send_goal("/left/arm_controller/follow_joint_trajectory", {"trajectory": goal})
        assert (await handle.result(20)).succeeded
        node.close()


@pytest.mark.anyio
async def test_a_viewer_sees_the_arm_and_cannot_command_it(arm: Any) -> None:
    async with (
        Server("ws://127.0.0.1:0", auth={"default_role": "viewer"}) as server,
        connect(server.urls[0]) as viewer,
    ):
        node = LeRobotNode(server.node("arm"), arm, rate=100.0)
        rejected: list[str] = []
        viewer.on_event(lambda event: rejected.append(event.text))
        await viewer.once("/joint_states", "sensor_msgs/JointState", timeout=60)
        trajectory = {"joint_names": ["pan"], "points": [{"positions": [0.0]}]}
        viewer.publish(TOPIC, trajectory, TRAJECTORY)
        await _until(lambda: f"publish: role 'viewer' may not publish on {TOPIC}" in " ".join(rejected))
        with pytest.raises(RobotError, match=r"viewer|knows no action"):
            await (await viewer.send_goal(ACTION, {"trajectory": trajectory}, ACTION_TYPE)).result(20)
        await viewer.once("/joint_states", "sensor_msgs/JointState", timeout=60)
        assert arm.actions == []
        node.close()


@pytest.mark.anyio
async def test_an_arm_whose_server_is_lost_holds(arm: Any) -> None:
    ended = anyio.Event()

    async def serve(*, task_status: TaskStatus[Server]) -> None:
        async with Server("ws://127.0.0.1:0") as server:
            task_status.started(server)
            await ended.wait()

    async with anyio.create_task_group() as tasks:
        server: Server = await tasks.start(serve)
        async with connect(server.urls[0]) as robot:
            events: list[str] = []
            robot.on_event(lambda event: events.append(event.kind))
            node, user = LeRobotNode(robot, arm, rate=100.0), server.node("user")
            await user.once("/joint_states", timeout=60)
            point = {"positions": [1.5], "time_from_start": {"sec": 60}}
            user.publish(TOPIC, {"joint_names": ["pan"], "points": [point]}, TRAJECTORY)
            await _until(lambda: len(arm.actions) > 3)
            ended.set()
            await _until(lambda: "lost" in events)
            count = len(arm.actions)
            await _until(lambda: len(arm.actions) > count + 10)
            assert len({action["pan.pos"] for action in arm.actions[-8:]}) == 1
            node.close()
