"""Globs of the settings that match nothing are reported; names that require a rule are refused."""

from __future__ import annotations

import asyncio
import json
import logging
from typing import Any

import httpx
import pytest
from anyio.lowlevel import checkpoint
from websockets.asyncio.client import connect

from rwt import Server, Settings
from rwt.access.settings import NamesOf
from rwt.observability.unmatched import CHECK_SECONDS, GlobCheck, globs_of
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from tests.processes import ended, running

TWIST = "geometry_msgs/Twist"


def check_of(settings: dict[str, Any]) -> tuple[GlobCheck, SimulatedClock, Node]:
    """A check of a robot that listens to `/cmd_vel` and offers `/arm/reset`."""
    clock = SimulatedClock()
    graph = MemoryGraph(Registry(DISTROS["jazzy"]), clock)
    robot = Node(graph, "robot")
    robot.subscribe("/cmd_vel", lambda message: None, TWIST)
    robot.advertise_service("/arm/reset", "std_srvs/Trigger", lambda request: {})
    return GlobCheck(graph, Settings.model_validate(settings)), clock, robot


GATE = {"topics": ["/cmd_vle"], "messages_per_second": 9, "type": TWIST}


_VLE = "gate rule `/cmd_vle` guards no topic (`gate.rules.a.topics`); near: `/cmd_vel`, which is"
_RESET = "gate rule `/arm/rest` guards no service (`gate.rules.a.services`); near: `/arm/reset`, which is"
_CONFIRM = "`mcp.confirm`: /arm/rest matches no topic or service or action; near: /arm/reset"


@pytest.mark.parametrize(
    ("settings", "texts"),
    [
        ({"gate": {"rules": {"a": GATE}}}, [f"{_VLE} not guarded"]),
        ({"gate": {"rules": {"a": GATE, "b": {"topics": ["/cmd_*"]}}}}, [f"{_VLE} guarded"]),
        ({"gate": {"rules": {"a": {"services": ["/arm/rest"]}}}}, [f"{_RESET} not guarded"]),
        (
            {"roles": {"a": {"publish": ["/cmd_vle", "/cmd_vel", "*"]}}},
            ["`roles.a.publish`: /cmd_vle matches no topic; near: /cmd_vel"],
        ),
        (
            {"roles": {"a": {"call": ["arm/*", "/rosapi/*"], "provide": ["/new"], "goals": ["/go*"]}}},
            ["`roles.a.goals`: /go* matches no action"],
        ),
        ({"gateways": ["mcp"], "mcp": {"confirm": ["/arm/rest"]}}, [_CONFIRM]),
        ({"roles": {"a": {"publish": ["/cmd_vel"], "call": ["/arm/reset"]}}}, []),
    ],
)
@pytest.mark.anyio
async def test_globs_that_match_nothing_are_logged_once(
    settings: dict[str, Any], texts: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    check, clock, robot = check_of(settings)
    with caplog.at_level(logging.WARNING):
        async with robot.graph:
            clock.advance(CHECK_SECONDS / 2)
            await _settle()
            assert not check.found
            for _ in range(3):
                clock.advance(CHECK_SECONDS)
                await _settle()
    assert [each.text for each in check.found] == texts
    assert [record.getMessage() for record in caplog.records] == texts
    check.close()


@pytest.mark.anyio
async def test_the_topic_of_the_gate_itself_is_not_the_robots() -> None:
    check, clock, robot = check_of({"gate": {"rules": {"a": GATE}}})
    async with robot.graph:
        Node(robot.graph, "gate").publish("/cmd_vle", {}, TWIST)
        clock.advance(CHECK_SECONDS * 2)
        await _settle()
        assert len(check.found) == 1
        robot.subscribe("/cmd_vle", lambda message: None, TWIST)
        clock.advance(CHECK_SECONDS)
        await _settle()
        assert not check.found


async def _settle() -> None:
    """Let the check, which takes turns of the event loop, come to its end."""
    for _ in range(100):
        await checkpoint()


@pytest.mark.parametrize(
    ("settings", "guarded"),
    [
        ({}, False),
        ({"gate": {"rules": {"a": GATE}}}, False),
        ({"gate": {"rules": {"a": {"actions": ["/cmd_vel"]}}}}, False),
        ({"gate": {"rules": {"a": {"topics": ["cmd_*"]}}}}, True),
    ],
)
@pytest.mark.parametrize("kind", [TWIST, "geometry_msgs/TwistStamped"])
def test_topics_that_move_the_robot_are_reported_without_a_rule(
    settings: dict[str, Any], guarded: bool, kind: str
) -> None:
    clock = SimulatedClock()
    graph = MemoryGraph(Registry(DISTROS["jazzy"]), clock)
    robot = Node(graph, "robot")
    robot.subscribe("/cmd_vel", lambda message: None, kind)
    robot.subscribe("/name", lambda message: None, "std_msgs/String")
    robot.publish("/measured", {}, kind)
    check = GlobCheck(graph, Settings.model_validate(settings))
    assert [each.glob for each in check.unguarded] == ([] if guarded else ["/cmd_vel"])
    check.take(Settings.model_validate({"gate": {"rules": {"b": {"topics": ["/cmd_vel"]}}}}))
    assert not check.unguarded
    check.close()


def test_settings_with_names_of_the_robot_are_marked() -> None:
    """A new setting with globs is marked, or says here why its names need not exist."""
    may_be_new = {"provide", "displace", "get_param", "set_param", "parameters", "require"}
    rule = {"topics": ["/a"], "stop": {}, "lease": {"seconds": 1}}
    settings = Settings.model_validate({"roles": {"a": {}}, "gate": {"rules": {"a": rule}}, "mcp": {}})
    marked = {key.rpartition(".")[2]: kinds for key, kinds, _ in globs_of(settings)}
    assert marked == {
        "publish": NamesOf(("topic",)), "subscribe": NamesOf(("topic",)), "topics": NamesOf(("topic",)),
        "call": NamesOf(("service",)), "services": NamesOf(("service",)),
        "goals": NamesOf(("action",)), "actions": NamesOf(("action",)),
        "confirm": NamesOf(("topic", "service", "action")),
    }  # fmt: skip
    assert not may_be_new & marked.keys()


@pytest.mark.anyio
async def test_commands_on_a_name_that_requires_a_rule_are_refused_without() -> None:
    gate = {"require": ["/cmd_vel", "/arm/*"], "rules": {"drive": {"topics": ["/cmd_vle"]}}}
    server = Server("ws://127.0.0.1:0", settings=Settings.model_validate({"gate": gate}))
    async with server, connect(server.urls[0]) as client:
        server.node("robot").advertise_service("/arm/reset", "std_srvs/Trigger", lambda request: {})

        async def ask(op: str, **fields: object) -> dict[str, Any]:
            await client.send(json.dumps({"op": op, **fields}))
            answer: dict[str, Any] = json.loads(await asyncio.wait_for(client.recv(), 20))
            return answer

        await client.send(json.dumps({"op": "set_level", "level": "warning"}))
        assert "gate.require" in (await ask("advertise", topic="/cmd_vel", type=TWIST))["msg"]
        assert "gate.require" in (await ask("publish", topic="/cmd_vel", msg={}))["msg"]
        called = await ask("call_service", service="/arm/reset", id="r")
        assert called["result"] is False and "gate.require" in str(called["values"])
        page = await asyncio.to_thread(httpx.get, server.urls[0].replace("ws:", "http:", 1) + "/healthz")
        assert page.json()["unmatched_globs"] == 0


def test_a_doctor_reports_a_misspelt_rule(tmp_path: Any) -> None:
    file = tmp_path / "rwt.toml"
    file.write_text('demo = true\n[gate.rules.drive]\ntopics = ["/cmd_vle"]\n')
    with running("serve", "ws://127.0.0.1:0", "--config", str(file)) as (process, url):
        assert process.stderr is not None
        assert any("guards no topic" in line for line in iter(process.stderr.readline, ""))
        found = ended("doctor", url)
        metrics = httpx.get(url.replace("ws:", "http:", 1) + "/metrics").text
    assert "gate rule `/cmd_vle` guards no topic" in found.stdout and "which is not guarded" in found.stdout
    assert "no gate rule guards `/cmd_vel` (geometry_msgs/Twist)" in found.stdout
    assert "rwt_unmatched_globs 1\n" in metrics
