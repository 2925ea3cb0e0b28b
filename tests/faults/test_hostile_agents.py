"""Hostile requests to `/mcp`: they are answered, and other clients are not affected."""

from __future__ import annotations

import asyncio
import json
import logging
from typing import Any

import pytest

from rwt import Server, Settings
from tests.extensions.mcp.agents import OPEN, agent_at, done, refused, served, url_of
from tests.extensions.mcp.robots import small_robot
from tests.extensions.mcp.test_gateway import GUARDED, GUEST, INITIALIZE, PILOT, post
from tests.waiting import until

pytestmark = [pytest.mark.anyio, pytest.mark.timeout(120)]

MODERN = {"Mcp-Protocol-Version": "2026-07-28"}
_META = {
    "io.modelcontextprotocol/protocolVersion": "2026-07-28",
    "io.modelcontextprotocol/clientCapabilities": {},
}


def modern(method: str, **params: Any) -> dict[str, Any]:
    return {"jsonrpc": "2.0", "id": 1, "method": method, "params": {"_meta": _META, **params}}


BODIES: dict[str, object] = {
    "nothing": b"",
    "no JSON": b"\xff\xfe{",
    "half": b'{"jsonrpc": "2.0", "id": 1, "meth',
    "deep": b"[" * 100_000,
    "deep object": b'{"a":' * 50_000 + b"1" + b"}" * 50_000,
    "long number": b'{"jsonrpc": "2.0", "id": ' + b"9" * 100_000 + b', "method": "ping"}',
    "batch": [INITIALIZE] * 100,
    "null": None,
    "text": "initialize",
    "no id": {"jsonrpc": "2.0", "method": "initialize"},
    "odd id": {**INITIALIZE, "id": {"a": 1}},
    "odd version": {**INITIALIZE, "jsonrpc": "1.0"},
    "odd params": {**INITIALIZE, "params": [1, 2]},
    "unknown method": {"jsonrpc": "2.0", "id": 1, "method": "x" * 10_000},
    "response": {"jsonrpc": "2.0", "id": 1, "result": {}},
    "surrogates": b'{"jsonrpc": "2.0", "id": "\\ud800", "method": "\\udfff"}',
    "tool": modern("tools/call", name="read_topic", arguments={"topic": "/x" * 50_000}),
    "odd arguments": modern("tools/call", name="read_topic", arguments=[1]),
    "no tool": modern("tools/call", name="\x00" * 1000, arguments={}),
    "odd resource": modern("resources/read", uri="robot://" + "%00" * 1000),
    "odd prompt": modern("prompts/get", name="drive_to", arguments={"place": "x" * 100_000, "y": ""}),
}


@pytest.mark.parametrize("headers", [{}, MODERN], ids=["older", "newest"])
async def test_any_body_is_answered_and_leaves_nothing(
    headers: dict[str, str], caplog: pytest.LogCaptureFixture
) -> None:
    async with served(**OPEN) as server:
        for name, body in BODIES.items():
            wanted = dict(headers)
            if headers and isinstance(body, dict) and isinstance(body.get("method"), str):
                wanted["Mcp-Method"] = body["method"][:100]
            status, _, text = await post(server, body, wanted)
            assert 200 <= status < 500 and len(text) < 10_100, (name, status, text[:300])
            assert "Traceback" not in text
        assert "rwt_mcp_requests 0" in server.metrics.text().decode()
        assert "rwt_mcp_sessions 0" in server.metrics.text().decode()
        async with agent_at(url_of(server)) as agent:
            await done(agent, "list_robot")
    assert [record for record in caplog.records if record.levelno >= logging.ERROR] == []


@pytest.mark.parametrize("session", ["nought", "x" * 4000, "\x7f", "../..", "0" * 32])
async def test_a_made_up_session_is_no_session(session: str) -> None:
    async with served(**OPEN) as server:
        for method in ("POST", "GET", "DELETE"):
            headers = {"Mcp-Session-Id": session}
            assert 400 <= (await post(server, INITIALIZE, headers, method))[0] < 500, method


async def test_a_body_that_is_too_long_is_not_read() -> None:
    async with served(**OPEN) as server:
        status, _, text = await post(server, b" " * (1024 * 1024 + 1))
        assert status == 413 and "http_body_bytes" in text


async def test_foreign_pages_may_not_act() -> None:
    async with served(**OPEN) as server:
        foreign = {"Origin": "https://elsewhere.example"}
        status, _, text = await post(server, INITIALIZE, foreign)
        assert status == 403 and "origins.allow" in text


async def test_goals_that_nobody_asks_about_are_bounded() -> None:
    async with (
        small_robot(gateways=["mcp"], mcp={"default_role": "admin", "goals": 8}) as (server, _),
        agent_at(url_of(server)) as agent,
    ):
        for _ in range(2):
            await done(agent, "send_goal", action="/count", goal={"order": 0}, timeout=0)
        text = await refused(agent, "send_goal", action="/count", goal={"order": 0}, timeout=0)
        assert "2 goals are under way" in text and "cancel_goal" in text


async def test_those_who_hang_up_at_once_leave_nothing() -> None:
    async with served(**OPEN) as server:
        host, port = url_of(server).removeprefix("http://").removesuffix("/mcp").split(":")
        body = json.dumps(modern("tools/call", name="list_frames", arguments={"seconds": 30})).encode()
        head = (
            f"POST /mcp HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\n"
            "Accept: application/json, text/event-stream\r\nMcp-Protocol-Version: 2026-07-28\r\n"
            f"Mcp-Method: tools/call\r\nMcp-Name: list_frames\r\nContent-Length: {len(body)}\r\n\r\n"
        )
        before = _listeners(server)
        for _ in range(20):
            _, writer = await asyncio.open_connection(host, int(port))
            writer.write(head.encode() + body)
            await writer.drain()
            writer.close()
        await until(lambda: "rwt_mcp_requests 0" in server.metrics.text().decode())
        await until(lambda: _listeners(server) == before)


def _listeners(server: Server) -> int:
    return len(getattr(server.graph.topic("/tf"), "subscribers", ()))


async def test_refusals_do_not_flood_the_log(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    async with served(Settings.model_validate(GUARDED)) as server:
        _, session, _ = await post(server, INITIALIZE, {"Authorization": f"Bearer {PILOT}"})
        stolen = {"Authorization": f"Bearer {GUEST}", "Mcp-Session-Id": session}
        for _ in range(150):
            assert (await post(server, INITIALIZE, stolen))[0] == 404
    lines = [record for record in caplog.records if "credential does not match" in record.getMessage()]
    assert 0 < len(lines) < 150
