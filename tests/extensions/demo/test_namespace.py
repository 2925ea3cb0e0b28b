"""Several robots in one graph."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

import pytest

from rwt.extensions.demo import DemoRobot
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_participant.errors import GoalRejected
from rwt_participant.goals import GoalStatus
from rwt_tf2 import Buffer, UnknownFrame, read_transform
from tests.conftest import REGISTRIES, START_NS
from tests.extensions.demo.conftest import Lab

pytestmark = pytest.mark.anyio

#: Of a robot without a namespace: not every name in a graph is its own.
_SHARED = {"/tf", "/tf_static", "/rosout", "/parameter_events", "/clock"}


@pytest.fixture
async def lab(distro: str, anyio_backend: str) -> AsyncIterator[Lab]:
    """Two robots, and a node in the namespace of one of them."""
    clock = SimulatedClock(START_NS)
    async with MemoryGraph(registry=REGISTRIES[distro], clock=clock) as graph:
        robots = DemoRobot(graph, namespace="/anna"), DemoRobot(graph, namespace="/ben")
        yield Lab(graph, clock, robots[0], Node(graph, "user", "/anna"))
        for robot in robots:
            robot.close()


async def test_each_has_all_names_of_one_alone_in_its_namespace(distro: str, lab: Lab) -> None:
    lab.user.close()
    alone = MemoryGraph(registry=REGISTRIES[distro], clock=SimulatedClock(START_NS))
    robot = DemoRobot(alone)
    for kind in ("topics", "services", "actions"):
        named = {info.name for info in getattr(alone, kind)()} - _SHARED
        expected = {f"/{name}{rest}" for name in ("anna", "ben") for rest in named}
        assert {info.name for info in getattr(lab.graph, kind)()} - _SHARED == expected
    robot.close()


async def test_each_drives_by_its_own_commands(lab: Lab) -> None:
    hers, his = lab.watch("/anna/odom"), lab.watch("/ben/odom")
    stick = lab.user.advertise("cmd_vel", "geometry_msgs/Twist")
    for _ in range(10):
        stick.publish({"linear": {"x": 0.5}})
        await lab.pass_time(0.1)
    assert hers[-1].pose.pose.position.x > 0.3
    assert his[-1].pose.pose.position.x == 0.0
    assert (hers[-1].header.frame_id, hers[-1].child_frame_id) == ("anna/odom", "anna/base_link")


async def test_their_frames_are_two_trees_on_one_topic(lab: Lab) -> None:
    heard: list[Any] = []
    for topic in ("/tf", "/tf_static"):
        lab.user.subscribe(topic, heard.append)
    cameras, scans = lab.watch("/anna/camera/camera_info"), lab.watch("/anna/scan")
    await lab.pass_time(0.5)
    buffer = Buffer()
    for transform in (transform for message in heard for transform in message.transforms):
        buffer.set_transform(read_transform(transform), static=True)
    buffer.lookup_transform("ben/map", "ben/left_wheel_link")
    buffer.lookup_transform("anna/map", "anna/base_link")
    with pytest.raises(UnknownFrame):
        buffer.lookup_transform("map", "base_link")
    assert cameras[-1].header.frame_id == "anna/camera_optical_frame"
    assert scans[-1].header.frame_id == "anna/laser"


async def test_each_navigates_in_its_own_map(lab: Lab) -> None:
    maps = lab.watch("/anna/map")
    assert maps[0].header.frame_id == "anna/map"
    place = {"position": {"x": -2.5, "y": -2.0}, "orientation": {"w": 1.0}}
    with pytest.raises(GoalRejected, match="use anna/map, anna/odom or anna/base_link"):
        await lab.user.send_goal("navigate_to_pose", {"pose": {"header": {"frame_id": "map"}}})
    goal = await lab.user.send_goal(
        "navigate_to_pose", {"pose": {"header": {"frame_id": "anna/map"}, "pose": place}}
    )
    for _ in range(60):
        await lab.pass_time(0.5)
        if goal.status >= GoalStatus.SUCCEEDED:
            break
    assert goal.status is GoalStatus.SUCCEEDED
