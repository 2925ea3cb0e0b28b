"""An agent looks at recordings: what is there, what one holds, and a message of it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rwt import Server, Settings
from tests.extensions.mcp.agents import agent_at, agent_of_connection, done, refused, served, text_of, url_of
from tests.waiting import until

pytestmark = [pytest.mark.anyio, pytest.mark.timeout(120)]


async def _record(folder: Path) -> None:
    """A walk of ten steps, and a secret."""
    async with Server("ws://127.0.0.1:0", record=folder / "walk.mcap") as server:
        node = server.node("walker")
        steps, secret = (
            node.advertise("/step", "std_msgs/Int32"),
            node.advertise("/secret", "std_msgs/String"),
        )
        await until(lambda: all(len(_listeners(server, name)) for name in ("/step", "/secret")))
        for step in range(10):
            steps.publish({"data": step})
        secret.publish({"data": "12345"})
        node.close()
    (folder / "notes.txt").write_text("no recording")
    (folder / "broken.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(100))


def _listeners(server: Server, name: str) -> tuple[object, ...]:
    """Those who listen to a topic."""
    return tuple(getattr(server.graph.topic(name), "subscribers", ()))


def _settings(folder: Path) -> Settings:
    return Settings.model_validate(
        {
            "gateways": ["mcp"],
            "roles": {"watcher": {"subscribe": ["/step"]}},
            "mcp": {"default_role": "watcher", "recordings": folder},
        }
    )


async def test_what_is_recorded_is_read(tmp_path: Path) -> None:
    await _record(tmp_path)
    async with served(_settings(tmp_path)) as server, agent_at(url_of(server)) as agent:
        assert (await done(agent, "describe_recording")).splitlines() == [
            "recordings (2):", "broken.mcap", "walk.mcap"
        ]  # fmt: skip
        told = await done(agent, "describe_recording", recording="walk.mcap")
        assert "/step [std_msgs/msg/Int32] (10 messages)" in told and "/secret" not in told
        first = await done(agent, "read_recording", recording="walk.mcap", topic="/step")
        assert first.startswith("recorded at 0.") and first.endswith('{"data":0}')
        assert "has no topic /secret" in await refused(
            agent, "read_recording", recording="walk.mcap", topic="/secret"
        )
        assert "has no message of /step from 1000 s on" in await refused(
            agent, "read_recording", recording="walk.mcap", topic="/step", at=1000
        )
        assert "did you mean walk.mcap?" in await refused(agent, "describe_recording", recording="walk.mcp")
        for outside in ("../walk.mcap", "notes.txt", "/etc/passwd", ""):
            result = await agent.call_tool("read_recording", {"recording": outside, "topic": "/step"})
            assert result.is_error and str(tmp_path) not in text_of(result), outside
        broken = await agent.call_tool("describe_recording", {"recording": "broken.mcap"})
        assert str(tmp_path) not in text_of(broken) and "topics:" in text_of(broken)  # As far as it goes.


async def test_the_command_reads_them_too(tmp_path: Path) -> None:
    await _record(tmp_path)
    async with (
        served(gateways=[]) as server,
        agent_of_connection(server.urls[0], recordings=tmp_path) as agent,
    ):
        assert "/secret" in await done(agent, "describe_recording", recording="walk.mcap")
        told = await done(agent, "read_recording", recording="walk.mcap", topic="/secret")
        assert told.endswith('{"data":"12345"}')


async def test_without_a_folder_there_are_no_such_tools() -> None:
    async with served() as server, agent_at(url_of(server)) as agent:
        assert "describe_recording" not in {tool.name for tool in (await agent.list_tools()).tools}
        assert "mcp.recordings" in await refused(agent, "describe_recording")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")
async def test_only_files_with_printable_names_are_recordings(tmp_path: Path) -> None:
    await _record(tmp_path)
    os.mkfifo(tmp_path / "pipe.mcap")  # To open it would wait forever.
    (tmp_path / "device.mcap").symlink_to("/dev/zero")
    (tmp_path / "a\nforged.mcap").write_bytes((tmp_path / "walk.mcap").read_bytes())
    async with served(_settings(tmp_path)) as server, agent_at(url_of(server)) as agent:
        assert (await done(agent, "describe_recording")).splitlines()[1:] == ["broken.mcap", "walk.mcap"]
        for name in ("pipe.mcap", "device.mcap", "a\nforged.mcap"):
            assert "there is no recording" in await refused(agent, "describe_recording", recording=name)
