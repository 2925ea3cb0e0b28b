"""The robot as somebody with a stick meets it: commands in, odometry, transforms and joints out."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from rwt.extensions.demo import DemoRobot
from rwt.extensions.demo.drive import Chassis
from rwt.extensions.demo.model.urdf import fixed_mounts
from rwt.extensions.demo.world.map import Box, Pose, World, walled
from rwt_graph import MemoryGraph, Node, SimulatedClock

pytestmark = pytest.mark.anyio


def yaw(quaternion: Any) -> float:
    return 2 * math.atan2(quaternion.z, quaternion.w)


async def test_it_drives_a_metre_straight_ahead(lab: Any) -> None:
    odometry = lab.watch("/odom")
    lab.command(linear=0.5, seconds=1.6)
    lab.clock.advance(2.0)
    position = odometry[-1].pose.pose.position
    # The last command is sent at 1.5 s and holds until 2.0 s; speeding up costs what braking gives back.
    assert position.x == pytest.approx(1.0, abs=1e-6)
    assert position.y == pytest.approx(0.0, abs=1e-9)
    assert odometry[-1].twist.twist.linear.x == 0.0


async def test_it_stops_half_a_second_after_the_last_command(lab: Any) -> None:
    odometry = lab.watch("/odom")
    lab.command(linear=0.6, seconds=1.0)
    # The last command is 0.1 s old here.
    lab.clock.advance(0.35)
    assert odometry[-1].twist.twist.linear.x == pytest.approx(0.6)
    lab.clock.advance(0.45)
    assert odometry[-1].twist.twist.linear.x == 0.0


async def test_it_turns_left_for_a_positive_rate(lab: Any) -> None:
    odometry = lab.watch("/odom")
    lab.command(angular=1.0, seconds=1.0)
    assert 0.8 < yaw(odometry[-1].pose.pose.orientation) <= 1.0


async def test_it_does_not_pass_walls_and_says_so(lab: Any) -> None:
    odometry, reports = lab.watch("/odom"), lab.watch("/diagnostics")
    lab.command(linear=-0.8, seconds=5.0)
    # The start is at x = -3.4, the shelf behind it ends at -4.5, and the body has a radius of 0.2.
    assert odometry[-1].pose.pose.position.x == pytest.approx(-0.9, abs=0.03)
    assert odometry[-1].twist.twist.linear.x == 0.0
    assert "something is in the way" in {status.message for status in reports[-1].status}


async def test_odometry_comes_twenty_times_a_second_with_its_stamps(lab: Any) -> None:
    odometry = lab.watch("/odom")
    before = lab.clock.time_ns()
    lab.clock.advance(2.0)
    stamps = [lab.nanoseconds(message.header.stamp) - before for message in odometry]
    assert stamps == [50_000_000 * i for i in range(1, 41)]
    assert {(m.header.frame_id, m.child_frame_id) for m in odometry} == {("odom", "base_link")}


async def test_transforms_lead_from_the_map_to_the_robot(lab: Any) -> None:
    heard = lab.watch("/tf")
    lab.command(linear=0.5, seconds=1.0)
    transforms = {t.child_frame_id: t for t in heard[-1].transforms}
    assert transforms["odom"].header.frame_id == "map"
    assert transforms["odom"].transform.translation.x == pytest.approx(-3.4)
    assert transforms["base_link"].header.frame_id == "odom"
    assert transforms["base_link"].transform.translation.x > 0.3
    assert transforms["left_wheel_link"].header.frame_id == "base_link"


async def test_fixed_transforms_wait_for_late_joiners(lab: Any) -> None:
    lab.clock.advance(60.0)
    (message,) = lab.watch("/tf_static")
    assert {t.child_frame_id for t in message.transforms} == {mount.link for mount in fixed_mounts(Chassis())}
    assert {t.header.frame_id for t in message.transforms} == {"base_link", "camera_link", "wrist_3_link"}


async def test_wheel_joints_turn_with_the_way(lab: Any) -> None:
    joints, odometry = lab.watch("/joint_states"), lab.watch("/odom")
    lab.command(linear=0.5, seconds=1.0)
    assert list(joints[-1].name)[:2] == ["left_wheel_joint", "right_wheel_joint"]
    way = odometry[-1].pose.pose.position.x
    assert list(joints[-1].position)[:2] == pytest.approx([way / 0.05, way / 0.05])
    assert list(joints[-1].velocity)[:2] == pytest.approx([10.0, 10.0])


async def test_a_command_that_is_not_a_number_is_ignored(lab: Any) -> None:
    odometry = lab.watch("/odom")
    lab.command(linear=math.nan, seconds=0.5)
    lab.command(angular=math.inf, seconds=0.5)
    assert odometry[-1].pose.pose.position.x == 0.0
    lab.command(linear=0.5, seconds=0.5)
    assert odometry[-1].pose.pose.position.x > 0.1


async def test_without_motors_it_stands(lab: Any) -> None:
    odometry = lab.watch("/odom")
    answer = await lab.user.call("/enable_motors", {"data": False})
    assert answer.success
    lab.command(linear=0.5, seconds=1.0)
    assert odometry[-1].pose.pose.position.x == 0.0
    await lab.user.call("/enable_motors", {"data": True})
    lab.command(linear=0.5, seconds=1.0)
    assert odometry[-1].pose.pose.position.x > 0.3


async def test_reset_brings_it_back(lab: Any) -> None:
    odometry, battery = lab.watch("/odom"), lab.watch("/battery_state")
    lab.command(linear=0.5, angular=0.3, seconds=2.0)
    await lab.user.call("/reset", {})
    lab.clock.advance(1.0)
    assert odometry[-1].pose.pose.position.x == 0.0
    assert yaw(odometry[-1].pose.pose.orientation) == 0.0
    assert battery[-1].percentage == pytest.approx(1.0, abs=1e-3)


def recorded(world: World | None = None) -> list[dict[str, Any]]:
    """Return the samples of a drive of three seconds; a simulated clock needs no event loop."""
    clock = SimulatedClock()
    graph = MemoryGraph(clock=clock)
    robot, user = DemoRobot(graph, world), Node(graph, "user")
    heard: list[dict[str, Any]] = []
    for topic in ("/odom", "/scan"):
        user.subscribe_samples(
            topic, on_sample=lambda sample: heard.append(json.loads(bytes(sample.payload.json())))
        )
    stick = user.advertise("/cmd_vel", "geometry_msgs/Twist")
    for _ in range(30):
        stick.publish({"linear": {"x": 0.4}, "angular": {"z": 0.2}})
        clock.advance(0.1)
    robot.close()
    return heard


def test_two_runs_are_the_same() -> None:
    assert recorded() == recorded()


def test_it_drives_in_a_world_of_ones_own() -> None:
    floor = Box(0, 0, 4, 4)
    heard = recorded(World(floor, walled(floor), start=Pose(2.0, 2.0, 1.0)))
    ranges = next(message["ranges"] for message in heard if "ranges" in message)
    assert max(ranges) < 1.9 * math.sqrt(2) + 0.1
