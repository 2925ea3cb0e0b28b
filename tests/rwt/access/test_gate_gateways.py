"""One gate for all gateways of a server: who drives over one protocol keeps those of the others from it."""

from __future__ import annotations

import json
from collections.abc import Iterator

import httpx
import pytest

from rwt import Server, connect
from rwt.gateways.foxglove.gateway import FoxgloveGateway
from rwt.gateways.foxglove.settings import FoxgloveSettings
from tests.rwt.access.gated_robot import DRIVE, GatedRobot, call, drive, token
from tests.rwt.gateways.foxglove.viewer import Viewer
from tests.rwt.gateways.mcp.agents import agent_at, url_of

RULE = {**DRIVE, "emergency": True}


@pytest.fixture
def robot() -> GatedRobot:
    return GatedRobot({"drive": RULE})


@pytest.fixture
def viewer(robot: GatedRobot) -> Iterator[Viewer]:
    """A client over Foxglove's protocol, which advertises velocities."""
    gateway = FoxgloveGateway(robot.graph, robot.access, FoxgloveSettings())
    viewer = Viewer(gateway, headers={"authorization": f"Bearer {token('operator')}"})
    viewer.advertise("/cmd_vel", "geometry_msgs/msg/Twist")
    viewer.heard()
    yield viewer
    gateway.close()


def _publish(viewer: Viewer, speed: float) -> str:
    viewer.publish(json.dumps({"linear": {"x": speed}}).encode())
    return " ".join(viewer.statuses())


def test_two_protocols_never_both_drive(robot: GatedRobot, viewer: Viewer) -> None:
    client = robot.client()
    assert drive(client, 0.25) == ""
    assert "/cmd_vel is held by rosbridge:1 (role operator)" in _publish(viewer, -1.0)
    robot.clock.advance(0.5)
    assert [speed for speed, _ in robot.take()] == [0.25, 0.0]
    assert _publish(viewer, 0.125) == ""
    assert "/cmd_vel is held by foxglove:1 (role operator)" in drive(client, -1.0)
    assert [speed for speed, _ in robot.take()] == [0.125]


def test_a_stop_over_one_protocol_holds_over_the_others(robot: GatedRobot, viewer: Viewer) -> None:
    assert _publish(viewer, 0.125) == ""
    call(robot.client(), "/gate/stop")
    assert "the emergency stop is on" in _publish(viewer, 0.125)
    assert [speed for speed, _ in robot.take()] == [0.125, 0.0]


def test_a_viewer_that_goes_stops_the_robot(robot: GatedRobot, viewer: Viewer) -> None:
    _publish(viewer, 0.125)
    viewer.leave()
    assert [speed for speed, _ in robot.take()] == [0.125, 0.0]


@pytest.mark.anyio
async def test_a_request_over_http_does_not_drive_what_another_holds() -> None:
    gate = {"rules": {"drive": {**RULE, "lease": {"seconds": 60}}}}
    async with Server("ws://127.0.0.1:0", gate=gate) as server:
        heard: list[float] = []
        node = server.node("base")
        node.subscribe("/cmd_vel", lambda twist: heard.append(twist.linear.x), "geometry_msgs/Twist")
        base = server.urls[0].replace("ws", "http", 1)
        async with connect(server.urls[0]) as one, httpx.AsyncClient(base_url=base) as http:
            taken = await one.call("/gate/take_lease", {"topic": "/cmd_vel"}, "rwt_gate_msgs/Lease")
            assert taken.success
            refused = await http.post("/api/topics/cmd_vel", json={"linear": {"x": 0.5}})
            assert (refused.status_code, "is held by rosbridge:1" in refused.text) == (403, True)
            assert heard == []


@pytest.mark.anyio
async def test_an_agent_publishes_no_longer_than_the_lease_without_a_word() -> None:
    gate = {"rules": {"drive": RULE}}
    mcp = {"default_role": "admin"}
    async with Server("ws://127.0.0.1:0", gate=gate, gateways=["mcp"], mcp=mcp) as server:
        server.node("base").subscribe("/cmd_vel", lambda twist: None, "geometry_msgs/Twist")
        async with agent_at(url_of(server)) as agent:
            asked = {"topic": "/cmd_vel", "message": {"linear": {"x": 0.5}}, "rate": 50}
            refused = await agent.call_tool("publish", {**asked, "seconds": 0.6})
            assert refused.is_error
            assert "(safety gate) lasts 0.5 s" in str(refused.content)
            assert not (await agent.call_tool("publish", {**asked, "seconds": 0.1})).is_error
