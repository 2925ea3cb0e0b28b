"""MCP's own inspector, by its command line, uses the gateway and `rwt mcp`."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from pathlib import Path
from typing import Any

import anyio
import pytest

from rwt import Settings
from tests.extensions.mcp.agents import url_of
from tests.extensions.mcp.robots import small_robot
from tests.extensions.mcp.test_gateway import GUARDED, PILOT
from tests.processes import ROOT

NODE = Path(__file__).parent / "node" / "node_modules"
INSPECTOR = NODE / "@modelcontextprotocol" / "inspector" / "cli" / "build" / "index.js"

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.clients,
    pytest.mark.timeout(180),
    pytest.mark.skipif(
        not INSPECTOR.is_file() and "CI" not in os.environ,
        reason="needs the inspector: npm ci --prefix tests/extensions/mcp/node",
    ),
]


async def inspect(*arguments: str) -> Any:
    """Return the output of the inspector for one method of a server."""
    process = await asyncio.create_subprocess_exec(
        "node",
        str(INSPECTOR),
        *arguments,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
    )
    printed, complained = await process.communicate()
    assert process.returncode == 0, complained.decode()
    return json.loads(printed)


async def test_it_uses_the_gateway() -> None:
    async with small_robot(Settings.model_validate(GUARDED)) as (server, robot):
        http = (
            url_of(server),
            "--transport",
            "http",
            "--header",
            f"Authorization: Bearer {PILOT}",
            "--method",
        )
        drive = ("topic=/cmd_vel", 'message={"linear":{"x":0.5}}')
        answers: dict[str, Any] = {}

        async def ask(name: str, *arguments: str) -> None:
            answers[name] = await inspect(*http, *arguments)

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(ask, "tools", "tools/list")
            tasks.start_soon(ask, "battery", *_call("read_topic", "topic=/battery"))
            tasks.start_soon(ask, "drive", *_call("publish", *drive))
            tasks.start_soon(ask, "refused", *_call("read_topic", "topic=/status"))
            tasks.start_soon(ask, "resource", "resources/read", "--uri", "robot://topics/battery")
            prompt = ("--prompt-name", "drive_to", "--prompt-args", "place=the red box")
            tasks.start_soon(ask, "prompt", "prompts/get", *prompt)
        names = {tool["name"] for tool in answers["tools"]["tools"]}
        assert {"read_topic", "publish"} <= names and "call_service" not in names
        assert '"percentage":0.75' in answers["battery"]["content"][0]["text"]
        assert robot.heard == [0.5] and not answers["drive"].get("isError")
        assert answers["refused"]["isError"] and "ready" not in str(answers["refused"])
        assert '"percentage":0.75' in answers["resource"]["contents"][0]["text"]
        assert "the red box" in answers["prompt"]["messages"][0]["content"]["text"]


async def test_it_uses_the_command() -> None:
    async with small_robot() as (server, _):
        command = (sys.executable, "-m", "rwt.cli", "mcp", "--robot", server.urls[0], "--method")
        answer = await inspect(*command, *_call("read_topic", "topic=/battery"))
        assert '"percentage":0.75' in answer["content"][0]["text"]


def _call(tool: str, *arguments: str) -> tuple[str, ...]:
    """The inspector's arguments for a call of a tool."""
    pairs = (part for argument in arguments for part in ("--tool-arg", argument))
    return ("tools/call", "--tool-name", tool, *pairs)


async def test_the_typescript_sdk_uses_the_gateway() -> None:
    rules = {
        "slow": {"topics": ["/cmd_vel"], "fields": {"linear.x": {"max": 0.25, "beyond": "clamp"}}},
        "asked": {"services": ["/add"], "approval": {"roles": ["guest"], "seconds": 20}},
    }
    roles = {**GUARDED["roles"], "pilot": {**GUARDED["roles"]["pilot"], "call": ["/add"]}}
    settings = Settings.model_validate({**GUARDED, "roles": roles, "gate": {"rules": rules}})
    async with small_robot(settings) as (server, robot):
        done = await anyio.run_process(["node", str(NODE.parent / "client.mjs"), url_of(server), PILOT])
    found = json.loads(done.stdout)
    assert found["annotations"]["read_topic"] == {"readOnlyHint": True, "openWorldHint": False}
    assert {row["name"] for row in found["listed"]["topics"]["rows"]} >= {"/battery", "/cmd_vel"}
    assert found["battery"]["message"]["percentage"] == 0.75
    assert robot.heard == [0.25] and "0.25 in place of 0.5" in found["clamped"]["gate"][0]
    assert "waiting for approval by guest" in found["waits"]
    assert found["updated"] == "robot://topics/battery"
