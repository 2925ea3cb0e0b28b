"""One gate for all gateways of a server: who drives over one protocol keeps those of the others from it."""

from __future__ import annotations

import json
import re
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import anyio
import httpx
import pytest

from rwt import Server
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.extensions.http.clients import MAX_SESSIONS
from tests.core.access.gated_robot import DRIVE, FIBONACCI, TWIST, GatedRobot, call, drive, settings_of, token
from tests.core.rosbridge.recording_client import Client
from tests.extensions.foxglove.viewer import Viewer
from tests.extensions.mcp.agents import agent_at, url_of

RULE = {**DRIVE, "emergency": True}
CLAMP = {"linear.x": {"max": 0.8, "beyond": "clamp"}}
CLAMPED = "publish /cmd_vel: linear.x: 0.8 in place of 2 (gate.rules.drive)"


@pytest.fixture
def robot() -> GatedRobot:
    return GatedRobot({"drive": {**RULE, "fields": CLAMP}})


@pytest.fixture
def viewer(robot: GatedRobot) -> Iterator[Viewer]:
    """A client over Foxglove's protocol, which advertises velocities."""
    gateway = FoxgloveGateway(robot.graph, robot.access)
    viewer = Viewer(gateway, headers={"authorization": f"Bearer {token('operator')}"})
    viewer.advertise("/cmd_vel", "geometry_msgs/msg/Twist")
    viewer.heard()
    yield viewer
    gateway.close()


def _http(server: Server, **headers: str) -> httpx.AsyncClient:
    return httpx.AsyncClient(base_url=server.urls[0].replace("ws", "http", 1), headers=headers)


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
    call(client, "/gate/stop")
    assert "the emergency stop is on" in _publish(viewer, 0.125)
    assert "the emergency stop is on" in call(client, "/gate/take_lease", topic="/cmd_vel")["message"]
    assert [speed for speed, _ in robot.take()] == [0.0]


def test_a_viewer_that_goes_stops_the_robot(robot: GatedRobot, viewer: Viewer) -> None:
    _publish(viewer, 0.125)
    viewer.leave()
    assert [speed for speed, _ in robot.take()] == [0.125, 0.0]


def test_a_client_is_told_what_was_clamped(robot: GatedRobot, viewer: Viewer) -> None:
    assert CLAMPED in _publish(viewer, 2.0)
    assert _publish(viewer, 2.0) == "", "not for each message"
    viewer.leave()
    client = robot.client()
    twist = {"topic": "/cmd_vel", "type": TWIST, "msg": {"linear": {"x": 2.0}}}
    client.say("publish", **twist)
    assert f"gate: {CLAMPED}" in [each["msg"] for each in client.heard()]
    client.say("set_level", level="error")
    client.say("publish", **twist)
    assert client.heard() == []


@pytest.mark.anyio
async def test_two_tokens_of_one_role_behind_one_address_are_two_clients() -> None:
    tokens = {name: {"token": f"{name}-token-of-the-test", "role": "driver"} for name in ("one", "two")}
    gate = {"rules": {"drive": {**RULE, "lease": {"seconds": 60}}}}
    roles = {"driver": {"publish": ["*"], "call": ["*"]}}
    async with Server("ws://127.0.0.1:0", gate=gate, auth={"tokens": tokens}, roles=roles) as server:
        heard: list[float] = []
        server.node("base").subscribe("/cmd_vel", lambda twist: heard.append(twist.linear.x), TWIST)
        async with _http(server) as http:
            for _ in range(3):
                for name, speed, status in (("one", 0.5, 204), ("two", -0.5, 403)):
                    headers = {"Authorization": f"Bearer {name}-token-of-the-test"}
                    answer = await http.post(
                        "/api/topics/cmd_vel", json={"linear": {"x": speed}}, headers=headers
                    )
                    assert answer.status_code == status
                    assert status == 204 or "is held by http:1" in answer.text
        assert heard == [0.5] * 3


SPAWN = "turtlesim/Spawn"
REQUESTS: dict[str, dict[str, Any]] = {
    "topic": {"linear": {"x": 5.0}},
    "service": {"x": 5.0},
    "action": {"order": 5},
    "parameter": {"name": "/base:asked", "value": "2.0"},
}


async def _over_rosbridge(server: Server, kind: str, name: str) -> str:
    client = Client(server.bridge, headers={"authorization": f"Bearer {token('agent')}"})
    client.say("set_level", level="warning")
    request = REQUESTS[kind]
    ops: dict[str, dict[str, Any]] = {
        "topic": {"op": "publish", "topic": name, "type": TWIST, "msg": request},
        "service": {"op": "call_service", "service": name, "args": request},
        "action": {"op": "send_action_goal", "action": name, "action_type": FIBONACCI, "args": request},
        "parameter": {"op": "call_service", "service": "/rosapi/set_param", "args": request},
    }
    client.say(**ops[kind])
    told = " ".join(each["msg"] for each in client.heard() if each["op"] == "status")
    client.leave()
    return told


async def _over_foxglove(server: Server, kind: str, name: str) -> str:
    gateway = FoxgloveGateway(server.graph, server.bridge.access)
    viewer = Viewer(gateway, headers={"authorization": f"Bearer {token('agent')}"})
    request = json.dumps(REQUESTS[kind]).encode()
    if kind == "topic":
        viewer.advertise(name, "geometry_msgs/msg/Twist")
        viewer.heard()
        viewer.publish(request)
    else:
        viewer.call(name, request)
    told = " ".join(viewer.statuses())
    gateway.close()
    return told


async def _over_http(server: Server, kind: str, name: str) -> str:
    async with _http(server, Authorization=f"Bearer {token('agent')}") as http:
        if kind == "parameter":
            answer = await http.put("/api/parameters/base:asked", json=2.0)
        else:
            end = "/goals" if kind == "action" else ""
            answer = await http.post(f"/api/{kind}s{name}{end}", json=REQUESTS[kind])
    return f"{answer.headers.get('gate-notice')} {answer.text}"


async def _over_mcp(server: Server, kind: str, name: str) -> str:
    tools: dict[str, tuple[str, dict[str, Any]]] = {
        "topic": ("publish", {"topic": name, "message": REQUESTS[kind]}),
        "service": ("call_service", {"service": name, "request": REQUESTS[kind], "timeout": 0.1}),
        "action": ("send_goal", {"action": name, "goal": REQUESTS[kind]}),
    }
    async with agent_at(url_of(server), token=token("agent")) as agent:
        return str((await agent.call_tool(*tools[kind])).content)


@pytest.mark.parametrize(
    ("over", "kind", "says_what_waits"),
    [
        (_over_rosbridge, "topic", "under id 1: send it again"),
        (_over_rosbridge, "service", "waiting for approval by supervisor (45 s left"),
        (_over_rosbridge, "action", "waiting for approval by supervisor (45 s left"),
        (_over_rosbridge, "parameter", "waiting for approval by supervisor (45 s left"),
        (_over_foxglove, "topic", "under id 1: send it again"),
        (_over_foxglove, "service", "waiting for approval by supervisor (45 s left"),
        (_over_http, "topic", "under id 1: send it again"),
        (_over_http, "service", "waiting for approval by supervisor (4"),
        (_over_http, "action", "waiting for approval by supervisor (4"),
        (_over_http, "parameter", "waiting for approval by supervisor (4"),
        (_over_mcp, "topic", "under id 1: send it again"),
        (_over_mcp, "service", "waiting for approval by supervisor (45 s left"),
        (_over_mcp, "action", ""),
    ],
)
@pytest.mark.anyio
async def test_every_gateway_tells_what_was_clamped_and_what_waits(
    over: Callable[[Server, str, str], Awaitable[str]], kind: str, says_what_waits: str
) -> None:
    """Table: gateway by kind of request."""
    beyond = {"max": 1, "beyond": "clamp"}
    rules = {
        "clamp": {"topics": ["/clamp"], "type": TWIST, "fields": {"linear.x": beyond}},
        "clamp_service": {"services": ["/clamp"], "fields": {"x": beyond}},
        "clamp_action": {"actions": ["/clamp"], "fields": {"order": beyond}},
        "asked": {
            "topics": ["/asked"],
            "services": ["/asked"],
            "actions": ["/asked"],
            "parameters": ["*:asked"],
            "type": TWIST,
            "approval": {"roles": ["supervisor"], "seconds": 45},
        },
    }
    settings = settings_of({"rules": rules}, gateways=("http", "mcp"))
    async with Server("ws://127.0.0.1:0", settings=settings) as server:
        node = server.node("base")
        node.parameters.declare("asked", 1.0)
        for name in ("/clamp", "/asked"):
            node.advertise(name, TWIST)
            node.advertise_service(name, SPAWN, lambda _: {})
            node.advertise_action(name, FIBONACCI, _count)
        if kind != "parameter":
            assert "1 in place of 5 (gate.rules.clamp" in await over(server, kind, "/clamp")
        if says_what_waits:
            assert says_what_waits in await over(server, kind, "/asked")


async def _count(goal: Any) -> dict[str, list[int]]:
    return {"sequence": [1]}


@pytest.mark.anyio
async def test_results_over_http_and_mcp_tell_what_was_clamped() -> None:
    gate = {"rules": {"drive": {**RULE, "fields": CLAMP}}}
    mcp = {"default_role": "admin"}
    async with Server("ws://127.0.0.1:0", gate=gate, gateways=["http", "mcp"], mcp=mcp) as server:
        server.node("base").subscribe("/cmd_vel", lambda twist: None, TWIST)
        async with _http(server) as http:
            answer = await http.post("/api/topics/cmd_vel", json={"linear": {"x": 2.0}})
            assert (answer.status_code, answer.json()) == (200, {"gate": [CLAMPED]})
            answer = await http.post("/api/topics/cmd_vel", json={"linear": {"x": 0.5}})
            assert (answer.status_code, answer.content) == (204, b"")
            await http.post("/api/services/gate/release_lease", json={"topic": "/cmd_vel"})
        async with agent_at(url_of(server)) as agent:
            asked = {"topic": "/cmd_vel", "message": {"linear": {"x": 2.0}}, "rate": 20}
            answered = str((await agent.call_tool("publish", {**asked, "seconds": 0.2})).content)
            assert answered.count(CLAMPED) == 1
            # An agent publishes no longer than the lease without a word.
            refused = await agent.call_tool("publish", {**asked, "seconds": 0.6})
            assert refused.is_error
            assert "(safety gate) lasts 0.5 s" in str(refused.content)


@pytest.mark.anyio
async def test_programs_with_one_token_do_not_alternate_commands_over_http() -> None:
    gate = {"rules": {"drive": {**RULE, "lease": {"seconds": 60}}}}
    async with Server("ws://127.0.0.1:0", gate=gate) as server:
        server.node("base").subscribe("/cmd_vel", lambda twist: None, TWIST)
        async with _http(server) as http:

            async def drive_as(**headers: str) -> int:
                names = {name.replace("_", "-"): value for name, value in headers.items()}
                return (await http.post("/api/topics/cmd_vel", json={}, headers=names)).status_code

            assert await drive_as(RWT_Session="one", User_Agent="a") == 204
            assert await drive_as(RWT_Session="one", User_Agent="b") == 204
            assert await drive_as(RWT_Session="two", User_Agent="a") == 403
            assert await drive_as(User_Agent="a") == 403
            assert await drive_as(RWT_Session="no spaces") == 400
            answers = [await drive_as(RWT_Session=f"s{number}") for number in range(MAX_SESSIONS)]
            assert answers[-1] == 429
            assert await drive_as(User_Agent="one more") == 403
            for session in ("one more", "s-more"):
                stop = await http.post("/api/services/gate/stop", json={}, headers={"RWT-Session": session})
                assert stop.json()["success"], session
            await http.post("/api/services/gate/release_stop", json={})
            assert await drive_as(RWT_Session="one") == 204


@pytest.mark.anyio
async def test_what_waits_for_approval_over_http() -> None:
    """A call, one that waits for its answer, one that is denied, a parameter and a goal."""
    asked = {
        "services": ["/blink", "/rosapi/set_param"],
        "actions": ["/count"],
        "approval": {"roles": ["admin"], "seconds": 45},
    }
    settings = settings_of({"rules": {"asked": asked}}, gateways=("http",))
    async with Server("ws://127.0.0.1:0", settings=settings) as server:
        node = server.node("base")
        node.advertise_service("/blink", "std_srvs/SetBool", lambda _: {"success": True, "message": "done"})
        node.parameters.declare("speed", 1.0)
        node.advertise_action("/count", FIBONACCI, _count)
        agent, other, admin = (
            _http(server, Authorization=f"Bearer {token(role)}") for role in ("agent", "operator", "admin")
        )

        async def answer(id: str, *, approve: bool = True) -> None:
            """Answer a request, once it waits."""
            request = {"id": id, "approve": approve}
            with anyio.fail_after(10):
                while True:
                    if (await admin.post("/api/services/gate/approve", json=request)).json()["success"]:
                        return
                    await anyio.sleep(0.01)

        async with agent, other, admin:
            waiting = await agent.post("/api/services/blink", json={"data": True})
            state = waiting.json()
            assert (waiting.status_code, state["state"]) == (202, "waiting")
            assert state["approval"]["roles"] == ["admin"]
            text = r"call /blink: waiting for approval by admin \(4[45](\.\d)? s left, id 1\)"
            assert re.fullmatch(text, state["reason"])
            where = waiting.headers["location"]
            assert (await agent.get(where)).status_code == 202
            assert (await other.get(where)).status_code == 404, "another client's call"
            await answer("1")
            for _ in range(2):
                done = await agent.get(where)
                assert (done.status_code, done.json()) == (200, {"success": True, "message": "done"})

            async with anyio.create_task_group() as tasks:
                tasks.start_soon(answer, "2")
                patient = {"Prefer": "wait=20"}
                done = await agent.post("/api/services/blink", json={"data": True}, headers=patient)
            assert (done.status_code, done.json()["message"]) == (200, "done")

            where = (await agent.post("/api/services/blink", json={"data": True})).headers["location"]
            await answer("3", approve=False)
            denied = await agent.get(where)
            assert (denied.status_code, "a person said no" in denied.text) == (502, True)

            where = (await agent.put("/api/parameters/base:speed", json=2.0)).headers["location"]
            assert node.parameters.get("speed") == 1.0
            await answer("4")
            assert (await agent.get(where)).status_code == 200
            assert node.parameters.get("speed") == 2.0

            goal = await agent.post("/api/actions/count/goals", json={"order": 1})
            state = goal.json()
            assert (goal.status_code, state["state"], state["approval"]["id"]) == (201, "waiting", "5")
            await answer("5")
            with anyio.fail_after(10):
                while state["state"] != "succeeded":
                    await anyio.sleep(0.01)
                    state = (await agent.get(goal.headers["location"])).json()
