"""Roles and limits over `/mcp`."""

from __future__ import annotations

import asyncio
import http.client
import json
import logging
import re
from contextlib import closing
from typing import Any
from urllib.parse import urlsplit

import anyio
import pytest
from mcp_types import Implementation

from rwt import Server, Settings
from rwt.extensions.mcp.agent import RESULT_BYTES
from rwt_client import connect
from tests.extensions.mcp.agents import OPEN, Era, agent_at, done, refused, served, url_of
from tests.extensions.mcp.robots import small_robot
from tests.waiting import until

pytestmark = [pytest.mark.anyio, pytest.mark.timeout(120)]

PILOT, GUEST = "the-token-of-a-pilot", "the-token-of-a-guest"
GUARDED: dict[str, Any] = {
    "gateways": ["mcp"],
    "auth": {
        "default_role": "admin",
        "tokens": {"pilot": {"token": PILOT, "role": "pilot"}, "guest": {"token": GUEST, "role": "guest"}},
    },
    "roles": {
        "pilot": {"subscribe": ["/battery"], "publish": ["/cmd_vel"]},
        "guest": {"subscribe": ["/status"]},
    },
}


async def post(
    server: Server, body: object, headers: dict[str, str] | None = None, method: str = "POST"
) -> tuple[int, str, str]:
    """One request; status and session of its answer, and the first 10,000 bytes of its text."""
    usual = {"Content-Type": "application/json", "Accept": "application/json, text/event-stream"}
    data = body if isinstance(body, bytes) else json.dumps(body).encode()

    def request() -> tuple[int, str, str]:
        with closing(http.client.HTTPConnection(urlsplit(url_of(server)).netloc, timeout=60)) as connection:
            connection.request(method, "/mcp", data, {**usual, **(headers or {})})
            answer = connection.getresponse()
            return answer.status, answer.getheader("mcp-session-id") or "", answer.read(10_000).decode()

    return await asyncio.to_thread(request)


INITIALIZE = {
    "jsonrpc": "2.0",
    "id": 1,
    "method": "initialize",
    "params": {
        "protocolVersion": "2025-11-25",
        "capabilities": {},
        "clientInfo": {"name": "by hand", "version": "1"},
    },
}
LISTING = {"jsonrpc": "2.0", "id": 2, "method": "tools/list"}


async def test_an_agent_without_a_token_only_looks(era: Era) -> None:
    async with small_robot(gateways=["mcp"]) as (server, robot):
        async with agent_at(url_of(server), era) as agent:
            tools = {tool.name: tool for tool in (await agent.list_tools()).tools}
            assert "read_topic" in tools and not {"publish", "call_service", "send_goal"} & set(tools)
            assert all(tool.annotations and tool.annotations.read_only_hint for tool in tools.values())
            assert '"percentage":0.75' in await done(agent, "read_topic", topic="/battery")
            text = await refused(agent, "publish", topic="/cmd_vel", message={"linear": {"x": 1.0}})
            assert "this agent may only look" in text and "mcp.default_role" in text
        assert robot.heard == []


async def test_each_agent_has_the_role_of_its_token_and_no_more(era: Era) -> None:
    async with small_robot(Settings.model_validate(GUARDED)) as (server, robot):
        async with agent_at(url_of(server), era, PILOT) as agent:
            listed = await done(agent, "list_robot")
            assert "/battery" in listed and "/status" not in listed and "/scan" not in listed
            await done(agent, "publish", topic="/cmd_vel", message={"linear": {"x": 1.0}})
            assert robot.heard == [1.0]
            assert "there is no topic /status" in await refused(agent, "read_topic", topic="/status")
            assert "roles.pilot.publish" in await refused(
                agent, "publish", topic="/status", type="std_msgs/String", message={"data": "x"}
            )
            assert "needs a role with `call`" in await refused(agent, "call_service", service="/add")
        async with agent_at(url_of(server), era, GUEST) as agent:
            listed = await done(agent, "list_robot")
            assert "/battery" not in listed
            hidden = r"^services \(0\):\n\d+ more require `call` \(roles\.guest\.call\)$"
            assert re.search(hidden, listed, re.MULTILINE)
            await done(agent, "read_topic", topic="/status")


async def test_an_unknown_token_is_turned_away() -> None:
    async with served(Settings.model_validate(GUARDED)) as server:
        headers = {"Authorization": "Bearer somebody-elses-token"}
        status, _, text = await post(server, INITIALIZE, headers)
        assert status == 401 and "auth.tokens" in text


async def test_a_session_is_of_no_use_to_whoever_did_not_open_it() -> None:
    async with served(Settings.model_validate(GUARDED)) as server:
        opened, session, _ = await post(server, INITIALIZE, {"Authorization": f"Bearer {PILOT}"})
        assert opened == 200 and session
        for token, expected in ((PILOT, 200), (GUEST, 404)):
            headers = {"Authorization": f"Bearer {token}", "Mcp-Session-Id": session}
            assert (await post(server, LISTING, headers))[0] == expected, token


async def test_sessions_are_bounded_and_closed() -> None:
    async with served(gateways=["mcp"], mcp={"sessions": 2}) as server:
        opened = [await post(server, INITIALIZE) for _ in range(3)]
        assert [answer[0] for answer in opened] == [200, 200, 503]
        assert "rwt_mcp_sessions 2" in server.metrics.text().decode()
        assert (await post(server, b"", {"Mcp-Session-Id": opened[0][1]}, "DELETE"))[0] == 200
        assert (await post(server, INITIALIZE))[0] == 200


async def test_what_a_request_may_hold_is_bounded_and_less_where_the_server_keeps_it() -> None:
    async with served(gateways=["mcp"], mcp={"request_bytes": 16_384}) as server:
        status, _, text = await post(server, {**INITIALIZE, "x": "x" * 2000})
        assert status == 413 and "the limit is 1024 here (mcp.request_bytes)" in text
        headers = {"Mcp-Session-Id": (await post(server, INITIALIZE))[1]}
        for size, expected in ((10_000, 200), (17_000, 413)):
            status, _, text = await post(server, {**LISTING, "params": {"x": "x" * size}}, headers)
            assert status == expected
        assert "the limit is 16384 here (mcp.request_bytes)" in text


async def test_a_silent_session_ends() -> None:
    async with served(gateways=["mcp"], mcp={"sessions": 1, "session_idle_seconds": 0.2}) as server:
        assert (await post(server, INITIALIZE))[0] == 200
        with anyio.fail_after(20):
            while (await post(server, INITIALIZE))[0] != 200:
                pass  # Each try takes its time, and keeps no session open.


async def test_requests_under_way_are_bounded() -> None:
    async with small_robot(gateways=["mcp"], mcp={"requests": 2}) as (server, _):
        async with agent_at(url_of(server)) as agent, anyio.create_task_group() as tasks:
            waits = {"topic": "/number", "field": "data", "comparison": "<", "value": -1}
            for _ in range(2):
                tasks.start_soon(agent.call_tool, "wait_for", waits)
            await until(lambda: "rwt_mcp_requests 2" in server.metrics.text().decode())
            status, _, text = await post(server, INITIALIZE)
            assert status == 503 and "mcp.requests" in text
            tasks.cancel_scope.cancel()
        await until(lambda: "rwt_mcp_requests 0" in server.metrics.text().decode())


async def test_the_robot_stops_when_whoever_drives_it_is_gone(era: Era) -> None:
    async with small_robot(**OPEN) as (server, robot):
        async with anyio.create_task_group() as tasks:

            async def drive() -> None:
                async with agent_at(url_of(server), era) as agent:
                    await done(agent, "publish", topic="/cmd_vel", message={"linear": {"x": 1.0}}, seconds=50)

            tasks.start_soon(drive)
            await until(lambda: bool(robot.heard))
            tasks.cancel_scope.cancel()
        with anyio.fail_after(20):
            await robot.stopped.wait()
        await until(lambda: "rwt_mcp_requests 0" in server.metrics.text().decode())
        assert robot.heard[-1] == 0.0


async def test_an_agent_whose_role_is_taken_away_stops() -> None:
    settings = [Settings.model_validate(GUARDED)]
    less = {**GUARDED, "roles": {**GUARDED["roles"], "pilot": {"subscribe": ["/battery"]}}}
    async with small_robot(settings[0], reload=lambda: settings[0]) as (server, robot):
        async with agent_at(url_of(server), token=PILOT) as agent, anyio.create_task_group() as tasks:
            texts: list[str] = []

            async def drive() -> None:
                texts.append(
                    await refused(
                        agent, "publish", topic="/cmd_vel", message={"linear": {"x": 1.0}}, seconds=50
                    )
                )

            tasks.start_soon(drive)
            await until(lambda: bool(robot.heard))
            settings[0] = Settings.model_validate(less)
            server.reload()
        assert "roles.pilot.publish" in texts[0]


async def test_what_an_agent_did_is_in_the_audit_under_its_name(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "rwt.bridge")
    async with (
        small_robot(Settings.model_validate(GUARDED)) as (server, _),
        agent_at(
            url_of(server), token=PILOT, client_info=Implementation(name="planner", version="1")
        ) as agent,
    ):
        await done(agent, "publish", topic="/cmd_vel", message={"linear": {"x": 0.25}})
        await done(agent, "read_topic", topic="/battery")
        await refused(agent, "publish", topic="/status", type="std_msgs/String", message={"data": "x"})
    lines = [record.getMessage() for record in caplog.records if "planner" in record.getMessage()]
    assert len(lines) == 3  # What only looks is not written.
    assert "the agent planner (pilot, 127.0.0.1): publish" in lines[0] and '"x":0.25' in lines[0]
    assert "refused: role 'pilot' may not publish on /status" in lines[2]


async def test_what_an_agent_publishes_is_heard_by_rosbridge_and_the_other_way_round() -> None:
    async with served(**OPEN) as server, agent_at(url_of(server)) as agent, connect(server.urls[0]) as robot:
        heard: asyncio.Queue[Any] = asyncio.Queue()
        subscription = robot.subscribe("/said", heard.put_nowait, "std_msgs/String")
        await subscription
        with anyio.fail_after(20):
            while heard.empty():
                await done(agent, "publish", topic="/said", type="std_msgs/String", message={"data": "hello"})
        assert heard.get_nowait().data == "hello"
        robot.publish("/told", {"data": "back"}, "std_msgs/String", latch=True)
        await until(lambda: server.graph.topic("/told") is not None)
        assert await done(agent, "read_topic", topic="/told") == '{"data":"back"}'


async def test_results_are_bounded_in_size() -> None:
    async with served(gateways=["mcp"], mcp={"default_role": "admin"}) as server:
        node = server.node("large")
        node.publish("/large", {"data": "x" * 100_000}, "std_msgs/String", latch=True)
        fields = [{"name": f"field {each}" * 250, "offset": each} for each in range(500)]
        node.publish("/list", {"fields": fields}, "sensor_msgs/PointCloud2", latch=True)
        async with agent_at(url_of(server)) as agent:
            for topic, cut in (("/large", "(100000 characters)"), ("/list", f"cut at {RESULT_BYTES} bytes")):
                text = await done(agent, "read_topic", topic=topic)
                assert len(text.encode()) <= RESULT_BYTES and cut in text
            assert len((await done(agent, "list_robot", plumbing=True)).encode()) <= RESULT_BYTES
        node.close()


async def test_nothing_is_left_of_agents_that_have_gone(era: Era) -> None:
    async with small_robot(**OPEN) as (server, _):
        before = {(each.name, len(each.subscribers)) for each in server.graph.topics()}
        async with agent_at(url_of(server), era) as agent:
            await done(agent, "read_topic", topic="/battery")
            await done(agent, "list_frames", seconds=0.05)
            await done(agent, "watch_numbers", topic="/number", seconds=0.05)
        assert {(each.name, len(each.subscribers)) for each in server.graph.topics()} == before
        assert "rwt_mcp_sessions 0" in server.metrics.text().decode()


async def test_a_session_that_takes_its_time_to_begin_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rwt.extensions.mcp.asgi.PATIENCE_SECONDS", 0.0)
    async with small_robot(gateways=["mcp"]) as (server, _), agent_at(url_of(server), "legacy") as agent:
        # The head of the first answer names the session, without which nothing that follows is heard.
        assert '"percentage":0.75' in await done(agent, "read_topic", topic="/battery")
        assert "rwt_mcp_sessions 1" in server.metrics.text().decode()
        metrics = server.metrics.text().decode()
        assert 'rwt_clients{gateway="mcp"} 1' in metrics
        assert 'rwt_connections_total{gateway="mcp"} 1' in metrics


async def test_a_stop_names_the_program_and_is_answered_by_its_tool(era: Era) -> None:
    drive = {"topics": ["/cmd_vel"], "type": "geometry_msgs/Twist", "stop": {}, "emergency": True}
    gate = {"rules": {"drive": drive}}
    async with served(gate=gate, **OPEN) as server, agent_at(url_of(server), era) as agent:
        answer = await done(agent, "call_service", service="/gate/stop")
        assert json.loads(answer)["message"].startswith("stopped; commands of clients are rejected")
        stop = server.bridge.access.gate
        assert stop is not None and stop.stopped_by == "mcp:mcp (role admin)" and stop.presses == 1
