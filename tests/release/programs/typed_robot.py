"""A program as a user writes it, with types that a checker must find in the packages."""

from __future__ import annotations

from typing import assert_type

from rwt import Node, Server, connect
from rwt_interfaces.jazzy import geometry_msgs, sensor_msgs
from rwt_protocol import CallService, dump, parse
from rwt_tf2 import Buffer, Transform


async def drive(url: str) -> float:
    """Drive, and return what is left in the battery."""
    async with connect(url) as robot:
        await robot.publish("/cmd_vel", geometry_msgs.Twist(linear=geometry_msgs.Vector3(x=0.5)))
        state: sensor_msgs.BatteryState = await robot.once("/battery_state", timeout=60.0)
        assert_type(state.percentage, float)
        return state.percentage


def offer(server: Server) -> None:
    """Offer a topic, and hear another."""
    node: Node = server.node("my_robot")
    scans = node.advertise("/scan", "sensor_msgs/LaserScan")

    def on_twist(twist: geometry_msgs.Twist) -> None:
        scans.publish(sensor_msgs.LaserScan(ranges=[twist.linear.x, 2.0]))

    node.subscribe("/cmd_vel", on_twist, "geometry_msgs/Twist")


def names_of(frame: bytes) -> list[str]:
    """The services that the messages of a frame call."""
    calls = [op for op in parse(frame) if isinstance(op, CallService)]
    assert_type(calls[0].service, str)
    assert_type(dump(calls[0]), str)
    return [call.service for call in calls]


def seen(buffer: Buffer) -> Transform:
    """Where the robot is."""
    return buffer.lookup_transform("map", "base_link").transform
