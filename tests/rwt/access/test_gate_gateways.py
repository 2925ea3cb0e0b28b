"""One gate for all gateways of a server: who drives over one protocol keeps those of the others from it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import anyio
import httpx
import pytest

from rwt import Server, connect
from rwt.gateways.foxglove.gateway import FoxgloveGateway
from rwt.gateways.foxglove.settings import FoxgloveSettings
from rwt.gateways.http.clients import MAX_SESSIONS
from tests.rwt.access.gated_robot import DRIVE, GatedRobot, call, drive, token
from tests.rwt.gateways.foxglove.viewer import Viewer
from tests.rwt.gateways.mcp.agents import agent_at, url_of
from tests.waiting import until

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


@pytest.mark.anyio
async def test_two_tokens_of_one_role_behind_one_address_are_two_clients() -> None:
    tokens = {name: {"token": f"{name}-token-of-the-test", "role": "driver"} for name in ("one", "two")}
    roles = {"driver": {"publish": ["*"], "call": ["*"]}}
    asked = {"services": ["/blink"], "approval": {"roles": ["admin"], "remember_seconds": 60}}
    gate = {"rules": {"drive": {**RULE, "lease": {"seconds": 60}}, "asked": asked}}
    auth = {"tokens": tokens, "default_role": "admin"}
    async with Server("ws://127.0.0.1:0", gate=gate, auth=auth, roles=roles) as server:
        heard: list[float] = []
        done: list[object] = []
        node = server.node("base")
        node.subscribe("/cmd_vel", lambda twist: heard.append(twist.linear.x), "geometry_msgs/Twist")

        def blink(request: object) -> dict[str, bool]:
            done.append(request)
            return {"success": True}

        node.advertise_service("/blink", "std_srvs/SetBool", blink)
        base = server.urls[0].replace("ws", "http", 1)
        one, two = ({"Authorization": f"Bearer {name}-token-of-the-test"} for name in ("one", "two"))
        async with httpx.AsyncClient(base_url=base) as http:
            for _ in range(3):
                driving = await http.post("/api/topics/cmd_vel", json={"linear": {"x": 0.5}}, headers=one)
                refused = await http.post("/api/topics/cmd_vel", json={"linear": {"x": -0.5}}, headers=two)
                assert (driving.status_code, refused.status_code) == (204, 403)
                assert "is held by http:1" in refused.text
            assert heard == [0.5] * 3
            # An approval of one is not valid for the other.
            waiting: list[list[str]] = []
            node.subscribe(
                "/gate/approvals",
                lambda message: waiting.append([each.id for each in message.approvals]),
                "rwt_gate_msgs/Approvals",
            )

            async def ask(headers: dict[str, str]) -> None:
                await http.post("/api/services/blink", json={"data": True}, headers=headers)

            async with connect(server.urls[0]) as admin, anyio.create_task_group() as tasks:
                tasks.start_soon(ask, one)
                await until(lambda: ["1"] in waiting)
                approval = {"id": "1", "approve": True, "seconds": 60.0}
                assert (await admin.call("/gate/approve", approval, "rwt_gate_msgs/Approve")).success
                await ask(one)
                assert len(done) == 2
                tasks.start_soon(ask, two)
                await until(lambda: ["2"] in waiting)
                assert len(done) == 2
                refused_too = {"id": "2", "approve": False, "seconds": 0.0}
                await admin.call("/gate/approve", refused_too, "rwt_gate_msgs/Approve")


CLAMP = {"linear.x": {"max": 0.8, "beyond": "clamp"}}
CLAMPED = "linear.x: 0.8 in place of 2 (gate.rules.drive)"


def test_a_client_is_told_what_was_clamped_and_what_waits() -> None:
    approval = {"services": ["/blink"], "approval": {"roles": ["supervisor"], "seconds": 45}}
    spawn = {"services": ["/spawn"], "fields": {"x": {"max": 1, "beyond": "clamp"}}}
    robot = GatedRobot({"drive": {**RULE, "fields": CLAMP}, "asked": approval, "spawn": spawn})
    robot.node.advertise_service("/blink", "std_srvs/SetBool", lambda _: {"success": True})
    robot.node.advertise_service("/spawn", "turtlesim/Spawn", lambda _: {})
    client = robot.client()
    twist = {"linear": {"x": 2.0}}
    client.say("publish", topic="/cmd_vel", type="geometry_msgs/Twist", msg=twist)
    client.say("call_service", service="/blink", args={"data": True})
    client.say("call_service", service="/spawn", args={"x": 5.0})
    told = [each["msg"] for each in client.heard() if each["op"] == "status" and each["level"] == "warning"]
    assert [each for each in told if each.startswith("gate:")] == [
        f"gate: publish /cmd_vel: {CLAMPED}",
        "gate: call /blink: waiting for approval by supervisor (45 s left, id 1)",
        "gate: call /spawn: x: 1 in place of 5 (gate.rules.spawn)",
    ]
    client.say("set_level", level="error")
    client.say("publish", topic="/cmd_vel", type="geometry_msgs/Twist", msg=twist)
    assert client.heard() == []


def test_a_foxglove_client_is_told_what_was_clamped() -> None:
    robot = GatedRobot({"drive": {**RULE, "fields": CLAMP}})
    gateway = FoxgloveGateway(robot.graph, robot.access, FoxgloveSettings())
    viewer = Viewer(gateway, headers={"authorization": f"Bearer {token('operator')}"})
    viewer.advertise("/cmd_vel", "geometry_msgs/msg/Twist")
    viewer.heard()
    assert f"publish /cmd_vel: {CLAMPED}" in _publish(viewer, 2.0)
    assert _publish(viewer, 2.0) == "", "not for each message"
    gateway.close()


@pytest.mark.anyio
async def test_results_over_http_and_mcp_tell_what_was_clamped() -> None:
    spawn = {"services": ["/spawn"], "fields": {"x": {"max": 1, "beyond": "clamp"}}}
    gate = {"rules": {"drive": {**RULE, "fields": CLAMP}, "spawn": spawn}}
    mcp = {"default_role": "admin"}
    async with Server("ws://127.0.0.1:0", gate=gate, gateways=["http", "mcp"], mcp=mcp) as server:
        node = server.node("base")
        node.subscribe("/cmd_vel", lambda twist: None, "geometry_msgs/Twist")
        node.advertise_service("/spawn", "turtlesim/Spawn", lambda _: {})
        async with httpx.AsyncClient(base_url=server.urls[0].replace("ws", "http", 1)) as http:
            answer = await http.post("/api/topics/cmd_vel", json={"linear": {"x": 2.0}})
            assert (answer.status_code, answer.json()) == (200, {"gate": [f"publish /cmd_vel: {CLAMPED}"]})
            answer = await http.post("/api/topics/cmd_vel", json={"linear": {"x": 0.5}})
            assert (answer.status_code, answer.content) == (204, b"")
            answer = await http.post("/api/services/spawn", json={"x": 5.0})
            assert answer.headers["gate-notice"] == "call /spawn: x: 1 in place of 5 (gate.rules.spawn)"
            await http.post("/api/services/gate/release_lease", json={"topic": "/cmd_vel"})
        async with agent_at(url_of(server)) as agent:
            asked = {"topic": "/cmd_vel", "message": {"linear": {"x": 2.0}}, "rate": 20, "seconds": 0.2}
            answered = str((await agent.call_tool("publish", asked)).content)
            assert answered.count(CLAMPED) == 1
            answered = str(
                (await agent.call_tool("call_service", {"service": "/spawn", "request": {"x": 5}})).content
            )
            assert "x: 1 in place of 5 (gate.rules.spawn)" in answered


@pytest.mark.anyio
async def test_programs_with_one_token_do_not_alternate_commands_over_http() -> None:
    gate = {"rules": {"drive": {**RULE, "lease": {"seconds": 60}}}}
    async with Server("ws://127.0.0.1:0", gate=gate) as server:
        server.node("base").subscribe("/cmd_vel", lambda twist: None, "geometry_msgs/Twist")
        async with httpx.AsyncClient(base_url=server.urls[0].replace("ws", "http", 1)) as http:

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
async def test_what_waits_for_approval_over_http_is_answered_at_once() -> None:
    asked = {
        "services": ["/blink", "/rosapi/set_param"],
        "actions": ["/count"],
        "approval": {"roles": ["admin"], "seconds": 45},
    }
    tokens = {"agent": {"token": "agent-token-of-the-test", "role": "agent"}}
    rights = {act: ["*"] for act in ("call", "goals", "get_param", "set_param")}
    auth = {"tokens": tokens, "default_role": "admin"}
    async with Server(
        "ws://127.0.0.1:0", gate={"rules": {"asked": asked}}, auth=auth, roles={"agent": rights}
    ) as server:
        node = server.node("base")
        node.advertise_service("/blink", "std_srvs/SetBool", lambda _: {"success": True, "message": "done"})
        node.parameters.declare("speed", 1.0)

        async def execute(goal: Any) -> dict[str, list[int]]:
            return {"sequence": [1]}

        node.advertise_action("/count", "example_interfaces/Fibonacci", execute)
        base = server.urls[0].replace("ws", "http", 1)
        agent = {"Authorization": "Bearer agent-token-of-the-test"}
        async with (
            connect(server.urls[0]) as admin,
            httpx.AsyncClient(base_url=base, headers=agent) as http,
        ):

            async def answer(id: str, *, approve: bool = True) -> None:
                request = {"id": id, "approve": approve}
                with anyio.fail_after(10):
                    while True:
                        answered = await admin.call("/gate/approve", request, "rwt_gate_msgs/Approve")
                        if answered.success:
                            return
                        await anyio.sleep(0.01)

            # A call: its state, and then its response.
            waiting = await http.post("/api/services/blink", json={"data": True})
            state = waiting.json()
            assert (waiting.status_code, state["state"], state["approval"]["roles"]) == (
                202,
                "waiting",
                ["admin"],
            )
            assert re.fullmatch(
                r"call /blink: waiting for approval by admin \(4[45](\.\d)? s left, id 1\)", state["reason"]
            )
            where = waiting.headers["location"]
            assert (await http.get(where)).status_code == 202
            async with httpx.AsyncClient(base_url=base) as other:
                assert (await other.get(where)).status_code == 404, "another client's call"
            await answer("1")
            for _ in range(2):
                done = await http.get(where)
                assert (done.status_code, done.json()) == (200, {"success": True, "message": "done"})
            # A client that prefers to wait.
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(answer, "2")
                patient = {"Prefer": "wait=20"}
                done = await http.post("/api/services/blink", json={"data": True}, headers=patient)
            assert (done.status_code, done.json()["message"]) == (200, "done")
            # A denied call.
            where = (await http.post("/api/services/blink", json={"data": True})).headers["location"]
            await answer("3", approve=False)
            denied = await http.get(where)
            assert (denied.status_code, "a person said no" in denied.text) == (502, True)
            # A parameter, by the service of rosapi.
            where = (await http.put("/api/parameters/base:speed", json=2.0)).headers["location"]
            assert node.parameters.get("speed") == 1.0
            await answer("4")
            assert (await http.get(where)).status_code == 200
            assert node.parameters.get("speed") == 2.0
            # A goal.
            goal = await http.post("/api/actions/count/goals", json={"order": 1})
            state = goal.json()
            assert (goal.status_code, state["state"], state["approval"]["id"]) == (201, "waiting", "5")
            await answer("5")
            with anyio.fail_after(10):
                while state["state"] != "succeeded":
                    await anyio.sleep(0.01)
                    state = (await http.get(goal.headers["location"])).json()
