"""`rwt mcp`: a robot for an agent's program that starts a command."""

from __future__ import annotations

import subprocess

import pytest

from tests.mcp.agents import Era, agent_of_command, done, refused
from tests.mcp.robots import small_robot
from tests.processes import LONGEST, ended, rwt_command

pytestmark = pytest.mark.timeout(120)


@pytest.mark.anyio
@pytest.mark.asyncio_only
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


def test_its_end_is_that_of_standard_input(url: str) -> None:
    process = subprocess.run(
        rwt_command("mcp", "--robot", url), input="", capture_output=True, text=True, timeout=LONGEST
    )
    assert (process.returncode, process.stdout) == (0, "")


def test_a_robot_that_cannot_be_reached_is_said_on_standard_error() -> None:
    process = ended("mcp", "--robot", "ws://127.0.0.1:1")
    assert process.returncode == 3 and process.stdout == "" and "127.0.0.1:1" in process.stderr
