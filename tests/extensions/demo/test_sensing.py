"""Sensors of the robot: scans, map, battery, description, diagnostics, chatter."""

from __future__ import annotations

import math
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from rwt.extensions.demo import DemoRobot
from rwt.extensions.demo.state import EMPTY_VOLTAGE, FULL_VOLTAGE
from rwt.extensions.demo.world.lidar import Lidar
from rwt.extensions.demo.world.map import Pose, draw_map, house
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_participant.errors import ParameterRejected

pytestmark = pytest.mark.anyio


async def test_the_scan_sees_walls_at_their_distances(lab: Any) -> None:
    await lab.user.params.set(lab.parameter("scan_noise"), 0.0)
    scan = lab.latest("/scan")
    assert scan.header.frame_id == "laser"
    assert len(scan.ranges) == 360

    def ray(degrees: int) -> float:
        angle = math.radians(degrees)
        return float(scan.ranges[round((angle - scan.angle_min) / scan.angle_increment) % 360])

    # From (-3.4, -2.5): outer walls in the south and the west, the shelf beside the latter, and in the north
    # the inner wall, just west of its door.
    assert ray(-90) == pytest.approx(1.4, abs=2e-3)
    assert ray(180) == pytest.approx(1.5, abs=2e-3)
    assert ray(-170) == pytest.approx(1.1 / math.cos(math.radians(10)), abs=2e-3)
    assert ray(97) == pytest.approx(2.4 / math.sin(math.radians(97)), abs=2e-3)
    assert scan.angle_max == pytest.approx(scan.angle_min + 359 * scan.angle_increment)


async def test_scans_come_at_the_rate_of_the_parameter(lab: Any) -> None:
    scans = lab.watch("/scan")
    lab.clock.advance(1.0)
    assert len(scans) == 10
    await lab.user.params.set(lab.parameter("scan_rate"), 4.0)
    scans.clear()
    lab.clock.advance(1.0)
    assert len(scans) == 4
    assert scans[-1].scan_time == pytest.approx(0.25)


async def test_the_map_is_kept_and_is_the_world(lab: Any) -> None:
    lab.clock.advance(60.0)
    (message,) = lab.watch("/map")
    drawn = draw_map(house())
    assert (message.info.width, message.info.height) == (drawn.columns, drawn.rows)
    assert message.info.resolution == pytest.approx(drawn.resolution)
    assert (message.info.origin.position.x, message.info.origin.position.y) == (-5.0, -4.0)
    assert message.header.frame_id == "map"
    assert tuple(message.data) == tuple(drawn.cells)


async def test_the_battery_drains_and_faster_while_driving(lab: Any) -> None:
    states = lab.watch("/battery_state")
    lab.clock.advance(60.0)
    resting = 1.0 - states[-1].percentage
    lab.command(angular=1.5, linear=0.3, seconds=60.0)
    driving = 1.0 - states[-1].percentage - resting
    assert len(states) == 120
    assert 0 < resting < driving
    assert states[-1].current < 0


def test_an_empty_battery_is_swapped() -> None:
    clock = SimulatedClock()
    graph = MemoryGraph(clock=clock)
    robot, user = DemoRobot(graph), Node(graph, "user")
    states: list[Any] = []
    lines: list[str] = []
    user.subscribe("/battery_state", states.append)
    user.subscribe("/rosout", lambda line: lines.append(line.msg))
    stick = user.advertise("/cmd_vel", "geometry_msgs/Twist")
    for _ in range(80 * 120):
        stick.publish({"angular": {"z": 2.0}})
        clock.advance(0.5)
    robot.close()
    emptiest = min(states, key=lambda state: state.percentage)
    assert emptiest.percentage < 0.01
    assert states[-1].percentage > 0.9
    assert (emptiest.voltage, states[0].voltage) == pytest.approx((EMPTY_VOLTAGE, FULL_VOLTAGE), abs=0.03)
    assert any("swapped" in line for line in lines)


async def test_the_description_is_kept_as_topic_and_as_parameter(lab: Any) -> None:
    lab.clock.advance(60.0)
    (message,) = lab.watch("/robot_description")
    assert ET.fromstring(message.data).get("name") == "demo_robot"
    await lab.settle()
    if not lab.graph.distro.parameters_belong_to_nodes:
        assert await lab.user.params.get("/robot_description") == message.data
    else:
        assert await lab.user.params.get("/demo_robot:robot_description") == message.data
        with pytest.raises(ParameterRejected):
            await lab.user.params.set("/demo_robot:robot_description", "<robot/>")


async def test_diagnostics_report_each_part_once_a_second(lab: Any) -> None:
    reports = lab.watch("/diagnostics")
    await lab.user.call("/enable_motors", {"data": False})
    lab.clock.advance(3.0)
    assert len(reports) == 3
    levels = {status.name: (int(status.level), status.message) for status in reports[-1].status}
    assert set(levels) == {"demo_robot: motors", "demo_robot: battery", "demo_robot: navigation"}
    assert levels["demo_robot: motors"] == (1, "disabled; call /enable_motors")


async def test_it_says_hello_once_a_second(lab: Any) -> None:
    heard = lab.watch("/chatter")
    lab.clock.advance(3.0)
    assert [message.data for message in heard] == ["hello world 1", "hello world 2", "hello world 3"]


async def test_nothing_is_measured_for_nobody(lab: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    cast: list[Pose] = []
    real = Lidar.scan

    def counted(lidar: Lidar, pose: Pose) -> list[float]:
        cast.append(pose)
        return real(lidar, pose)

    monkeypatch.setattr(Lidar, "scan", counted)
    lab.clock.advance(2.0)
    assert cast == []
    lab.watch("/scan")
    lab.clock.advance(1.0)
    assert len(cast) == 10


async def test_a_closed_robot_leaves_nothing_behind_and_its_place_to_another(lab: Any) -> None:
    lab.clock.advance(1.0)
    lab.robot.close()
    assert "/demo_robot" not in {node.name for node in lab.graph.nodes()}
    assert lab.graph.topic("/odom") is None
    assert lab.graph.service("/add_two_ints") is None
    lab.clock.advance(5.0)
    DemoRobot(lab.graph)
    assert lab.latest("/odom").pose.pose.position.x == 0.0
