"""`rwt mcp`: a robot for an agent's program that starts a command."""

from __future__ import annotations

import subprocess
from typing import Any

import pytest

from rwt import Server
from rwt_client import Robot, connect
from tests.extensions.mcp.agents import (
    Era,
    agent_at,
    agent_of_command,
    agent_of_connection,
    done,
    refused,
    url_of,
)
from tests.extensions.mcp.robots import small_robot
from tests.processes import LONGEST, ended, rwt_command
from tests.waiting import until, until_answered

pytestmark = pytest.mark.timeout(120)


@pytest.mark.anyio
@pytest.mark.parametrize(("era", "spoken"), [("legacy", "2025-11-25"), ("auto", "2026-07-28")])
async def test_an_agent_uses_a_robot_elsewhere(era: Era, spoken: str) -> None:
    async with small_robot() as (server, robot):
        async with agent_of_command("--robot", server.urls[0], era=era) as agent:
            assert agent.protocol_version == spoken
            assert '"percentage":0.75' in await done(agent, "read_topic", topic="/battery")
            names = {tool.name for tool in (await agent.list_tools()).tools}
            assert "read_topic" in names and "publish" not in names
            text = await refused(agent, "publish", topic="/cmd_vel", message={"linear": {"x": 1.0}})
            assert "start `rwt mcp` with --act" in text
        assert robot.heard == []


def _driven(server: Server) -> list[float]:
    """Velocities that come to a robot, forward."""
    heard: list[float] = []
    drive = server.node("base").subscribe
    drive("/cmd_vel", lambda twist: heard.append(twist.linear.x), "geometry_msgs/Twist")
    return heard


async def _takes_lease(robot: Robot) -> bool:
    answer: Any = await robot.call("/gate/take_lease", {"topic": "/cmd_vel"}, "rwt_gate_msgs/Lease")
    return bool(answer.success)


@pytest.mark.anyio
@pytest.mark.parametrize("take", ["publish", "service"])
async def test_an_agent_of_a_robot_elsewhere_keeps_to_the_lease(take: str) -> None:
    lease = {"seconds": 30, "take": take}
    gate = {"rules": {"drive": {"topics": ["/cmd_vel"], "lease": lease, "stop": {}, "emergency": True}}}
    async with Server("ws://127.0.0.1:0", gate=gate) as server, connect(server.urls[0]) as other:
        heard = _driven(server)
        async with agent_of_connection(server.urls[0]) as agent:
            drive = {"topic": "/cmd_vel", "message": {"linear": {"x": 0.25}}}
            late = await refused(agent, "publish", **drive, seconds=31)
            assert "but the lease on /cmd_vel (safety gate) lasts 30 s" in late
            assert 0.25 not in heard
            assert "published " in await done(agent, "publish", **drive, seconds=0.1)
            await until(lambda: 0.25 in heard and heard[-1] == 0.0)

            # While another client drives, the error names it and nothing is published.
            await until_answered(lambda: _takes_lease(other), "the agent's lease has not ended")
            heard.clear()
            assert "/cmd_vel is held by rosbridge:" in await refused(agent, "publish", **drive)
            assert heard == []

            await other.call("/gate/stop", {"reason": "a test"}, "rwt_gate_msgs/Stop")
            assert "the emergency stop is on" in await refused(agent, "publish", **drive)
            assert 0.25 not in heard


@pytest.mark.anyio
async def test_what_a_robot_elsewhere_refuses_counts_as_not_published() -> None:
    rule = {"topics": ["/cmd_vel"], "fields": {"linear.x": {"max": 0.5}}}
    async with Server("ws://127.0.0.1:0", gate={"rules": {"slow": rule}}) as server:
        heard = _driven(server)
        async with agent_of_connection(server.urls[0]) as agent:
            for seconds in (0.0, 0.2):
                drive = {"topic": "/cmd_vel", "message": {"linear": {"x": 2.0}}, "seconds": seconds}
                assert "linear.x" in await refused(agent, "publish", **drive)
            assert set(heard) <= {0.0}
            assert "published one message" in await done(
                agent, "publish", topic="/cmd_vel", message={"linear": {"x": 0.5}}
            )
            await until(lambda: heard[-1] == 0.5)


@pytest.mark.anyio
@pytest.mark.parametrize("place", ["elsewhere", "its own port"])
async def test_an_agent_hears_every_kind_of_rejection(place: str) -> None:
    guest = {"subscribe": ["/**"], "publish": ["/cmd_vel"], "call": ["/rosapi/*", "/gate/*"]}
    rules = {"drive": {"topics": ["/cmd_vel"], "fields": {"linear.x": {"max": 0.5}}}}
    async with Server(
        "ws://127.0.0.1:0",
        auth={"default_role": "guest"},
        mcp={"default_role": "guest"},
        roles={"guest": guest},
        gate={"rules": rules},
        gateways=["mcp"],
    ) as server:
        heard = _driven(server)
        server.node("base").subscribe("/odom", print, "nav_msgs/Odometry")
        elsewhere = place == "elsewhere"
        agents = agent_of_connection(server.urls[0]) if elsewhere else agent_at(url_of(server))
        async with agents as agent:
            for topic, message, reason in (
                ("/cmd_vel", {"linear": {"x": 2.0}}, "linear.x: expected at most 0.5, got 2"),
                ("/cmd_vel", {"linar": {}}, '"linar"'),
                ("/odom", {}, "may not publish on /odom"),
            ):
                assert reason in await refused(agent, "publish", topic=topic, message=message)
        assert heard == []


def test_its_end_is_that_of_standard_input(url: str) -> None:
    process = subprocess.run(
        rwt_command("mcp", "--robot", url), input="", capture_output=True, text=True, timeout=LONGEST
    )
    assert (process.returncode, process.stdout) == (0, "")


def test_a_robot_that_cannot_be_reached_is_said_on_standard_error() -> None:
    process = ended("mcp", "--robot", "ws://127.0.0.1:1")
    assert process.returncode == 3 and process.stdout == "" and "127.0.0.1:1" in process.stderr
