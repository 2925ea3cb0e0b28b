"""A program's part in the robot's tree of frames."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rwt import (
    InvalidMessage,
    StampedTransform,
    Transform,
    euler_from_quaternion,
    quaternion_from_euler,
    quaternion_from_yaw,
    yaw_from_quaternion,
)
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_interfaces import JAZZY, NOETIC, Payload, Registry
from tests.core.client.worlds import scripted


def _heard(node: Node, topic: str) -> list[Any]:
    heard: list[Any] = []
    node.subscribe(topic, lambda message: heard.append(message.transforms), "tf2_msgs/TFMessage")
    return heard


@pytest.mark.parametrize("registry", [Registry(JAZZY), Registry(NOETIC)])
def test_what_moves_has_the_time_of_the_nodes_clock(registry: Registry) -> None:
    clock = SimulatedClock(start_ns=5_000_000_007)
    node = Node(MemoryGraph(registry, clock), "base")
    heard = _heard(node, "/tf")
    node.tf.send_transform("/odom", "base_link", Transform.from_rpy((1.0, 2.0, 0.0), 0, 0, math.pi / 2))
    node.tf.send_transform("odom", "base_link", Transform(), 9_000_000_000)
    node.tf.send_transforms(
        [StampedTransform("a", "b", 1, Transform()), StampedTransform("b", "c", 2, Transform())]
    )
    [first], [second], both = heard
    assert (first.header.frame_id, first.child_frame_id, first.transform.translation.y) == (
        "odom",
        "base_link",
        2.0,
    )
    assert yaw_from_quaternion(first.transform.rotation) == pytest.approx(math.pi / 2)
    seconds = "sec" if registry.distro is JAZZY else "secs"
    assert [getattr(each.header.stamp, seconds) for each in (first, second)] == [5, 9]
    assert [each.child_frame_id for each in both] == ["b", "c"]


def test_the_stamp_of_a_message_will_do() -> None:
    node = Node(MemoryGraph(clock=SimulatedClock()), "base")
    header: Any = Payload.from_value(
        node.registry.message("std_msgs/Header"), {"stamp": {"sec": 3, "nanosec": 4}}
    ).value()
    heard = _heard(node, "/tf")
    node.tf.send_transform("odom", "base_link", Transform(), header.stamp)
    assert (heard[0][0].header.stamp.sec, heard[0][0].header.stamp.nanosec) == (3, 4)


def test_what_does_not_move_is_kept_with_all_that_was_told_before() -> None:
    node = Node(MemoryGraph(clock=SimulatedClock()), "base")
    node.tf.send_transform("base_link", "laser", Transform((0.1, 0.0, 0.0)), static=True)
    node.tf.send_transform("base_link", "camera", Transform(), static=True)
    node.tf.send_transform("base_link", "laser", Transform((0.2, 0.0, 0.0)), static=True)
    [late] = _heard(node, "/tf_static")
    assert {each.child_frame_id: each.transform.translation.x for each in late} == {
        "laser": 0.2,
        "camera": 0.0,
    }


@pytest.mark.parametrize(
    ("parent", "child", "transform", "reason"),
    [
        ("odom", "", Transform(), "has no child"),
        ("odom", "/odom", Transform(), "odom cannot be its own parent"),
        ("odom", "base", Transform((math.nan, 0.0, 0.0)), "not finite"),
        (
            "odom",
            "base",
            Transform(rotation=(0.0, 0.0, 0.0, 0.0)),
            "is not a unit quaternion; its length is 0",
        ),
    ],
)
@pytest.mark.parametrize("static", [False, True])
def test_what_no_listener_would_take_is_refused(
    parent: str, child: str, transform: Transform, reason: str, static: bool
) -> None:
    node = Node(MemoryGraph(), "base")
    heard = _heard(node, "/tf_static" if static else "/tf")
    with pytest.raises(InvalidMessage, match=f"transforms: .*{reason}"):
        node.tf.send_transform(parent, child, transform, static=static)
    assert heard == []


@pytest.mark.anyio
async def test_a_client_tells_what_does_not_move_again_on_each_connection() -> None:
    async with scripted() as (server, robot):
        robot.tf.send_transform("base_link", "laser", Transform(), static=True)
        first = await server.hears("publish")
        assert [(op["topic"], op["latch"]) for op in server.ops("advertise")] == [("/tf_static", True)]
        server.hang_up()
        again = await server.hears("publish", 2)
    assert again["msg"] == first["msg"]
    assert again["msg"]["transforms"][0]["child_frame_id"] == "laser"


ANGLES = [0.0, 0.3, -1.2, math.pi / 2, 3.1, -3.1]


@pytest.mark.parametrize("yaw", ANGLES)
def test_a_yaw_there_and_back(yaw: float) -> None:
    quaternion: Any = _message("Quaternion", quaternion_from_yaw(yaw))
    assert yaw_from_quaternion(quaternion) == pytest.approx(yaw)


@pytest.mark.parametrize("roll", ANGLES)
@pytest.mark.parametrize("pitch", [0.0, 0.7, -1.5])
def test_angles_there_and_back(roll: float, pitch: float) -> None:
    quaternion: Any = _message("Quaternion", quaternion_from_euler(roll, pitch, 0.4))
    assert euler_from_quaternion(quaternion) == pytest.approx((roll, pitch, 0.4))


def test_a_rotation_of_another_length_and_one_that_nobody_filled_in() -> None:
    long: Any = _message("Quaternion", {"z": 2 * math.sin(0.25), "w": 2 * math.cos(0.25)})
    assert yaw_from_quaternion(long) == pytest.approx(0.5)
    empty: Any = _message("Quaternion", {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0})
    assert euler_from_quaternion(empty) == (0.0, 0.0, 0.0)


def _message(name: str, fields: dict[str, float]) -> object:
    return Payload.from_value(Registry().message(f"geometry_msgs/{name}"), fields).value()
