"""Permissions of roles, rejections, and visible names in rosapi."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Mapping
from typing import Any

import anyio.lowlevel
import pytest

from rwt import Settings
from rwt.access.access import Access
from rwt.access.errors import NotAllowed
from rwt.access.roles import ACTS, Role
from rwt.access.settings import RoleSettings
from rwt.rosapi import DISCLOSURES, Rosapi
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph, Node
from rwt_graph.api import Graph
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from tests.core.rosbridge.recording_client import Client, Message
from tests.held import held


def role(**globs: Any) -> Role:
    return Role("r", RoleSettings.model_validate(globs))


# -- globs -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("glob", "name", "fits"),
    [
        ("*", "/a/b", True),
        ("/a/*", "/a/b/c", True),
        ("/a/*", "/a", False),
        ("/a", "/a", True),
        ("a", "/a", True),
        ("/a", "/ab", False),
        ("/a", "/A", False),
        ("/cam?", "/cam1", True),
        ("/cam[12]", "/cam3", False),
        ("*/image", "/left/image", True),
        ("/a.b", "/axb", False),
        ("", "/", True),
        ("", "/a", False),
    ],
)
def test_globs_have_the_meaning_of_fnmatch_on_resolved_names(glob: str, name: str, fits: bool) -> None:
    assert role(publish=[glob]).allows("publish", name) is fits
    assert role(publish=["/other", glob]).allows("publish", name) is fits


def test_what_is_not_named_is_refused() -> None:
    nobody = role()
    assert not any(nobody.allows(act, "/x") for act in ACTS)


def test_read_only_is_one_line() -> None:
    viewer = role(read_only=True)
    assert {act for act in ACTS if viewer.allows(act, "/x")} == {"subscribe", "get_param"}


def test_a_read_only_role_may_have_more() -> None:
    assert role(read_only=True, call=["/reset"]).allows("call", "/reset")


def test_rosapi_may_always_be_called() -> None:
    assert role().allows("call", "/rosapi/topics")
    assert not role().allows("publish", "/rosapi/topics")


def test_a_refusal_names_the_setting() -> None:
    with pytest.raises(NotAllowed, match=r"role 'r' may not publish on /x \(roles\.r\.publish\)"):
        role().require("publish", "/x")


def test_what_a_role_remembers_is_bounded() -> None:
    busy = role(publish=["/a*"])
    before = held(busy)
    for number in range(10_000):
        busy.allows("publish", f"/b{number}")
    assert held(busy) - before <= 3 * 4096 + 2
    assert busy.allows("publish", "/a")


# -- ops ---------------------------------------------------------------------------------------------------


def _client(graph: Graph, globs: Mapping[str, object], *, level: str | None = "error") -> Client:
    settings = Settings.model_validate({"auth": {"default_role": "guest"}, "roles": {"guest": globs}})
    client = Client(Bridge(graph, settings, Access(graph, settings, DISCLOSURES)))
    if level:
        client.say("set_level", level=level)
    return client


ACTION = {"action": "/a", "action_type": "example_interfaces/Fibonacci"}
TOPIC = {"topic": "/x", "type": "std_msgs/String"}
SERVICE = {"service": "/s", "type": "std_srvs/Trigger"}
OPS: list[tuple[str, str, Message, str]] = [
    ("publish", "advertise", TOPIC, "status"),
    ("publish", "publish", {**TOPIC, "msg": {}}, "status"),
    ("subscribe", "subscribe", TOPIC, "status"),
    ("call", "call_service", {"service": "/s"}, "service_response"),
    ("provide", "advertise_service", SERVICE, "status"),
    ("provide", "advertise_action", {"action": "/a", "type": "example_interfaces/Fibonacci"}, "status"),
    ("goals", "send_action_goal", ACTION, "action_result"),
]


@pytest.mark.parametrize(("act", "op", "members", "answer"), OPS, ids=[op for _, op, _, _ in OPS])
def test_each_op_is_refused_with_its_own_answer(
    graph: MemoryGraph, act: str, op: str, members: Message, answer: str
) -> None:
    client = _client(graph, {other: ["*"] for other in ACTS if other != act})
    client.say(op, id="i", **members)
    (reply,) = client.heard()
    assert reply["op"] == answer
    assert reply["id"] == "i"
    assert f"(roles.guest.{act})" in str(reply)
    assert client.close_code is None


@pytest.mark.parametrize(("act", "op", "members", "answer"), OPS, ids=[op for _, op, _, _ in OPS])
def test_each_op_needs_only_its_own_permission(
    graph: MemoryGraph, act: str, op: str, members: Message, answer: str
) -> None:
    client = _client(graph, {act: ["*"]})
    client.say(op, id="i", **members)
    assert "roles.guest" not in str(client.heard())


@pytest.mark.parametrize("spelling", ["secret", "/secret", "//secret", "/secret/"])
def test_another_spelling_gets_nobody_round_a_glob(graph: MemoryGraph, spelling: str) -> None:
    client = _client(graph, {"publish": ["/open*"], "subscribe": ["/open*"]})
    client.say("publish", topic=spelling, type="std_msgs/String", msg={})
    client.say("subscribe", topic=spelling, type="std_msgs/String")
    assert len(client.heard()) == 2
    assert graph.topic("/secret") is None


def test_a_legacy_suffix_gets_nobody_round_a_glob(graph: MemoryGraph) -> None:
    graph.node("n").advertise_service("/secret", "std_srvs/Trigger", lambda _: {"success": True})
    client = _client(graph, {"call": ["/open*"]})
    client.say("call_service", service="/secret#/open")
    assert client.heard()[0]["result"] is False


def test_the_publish_path_asks_once(graph: MemoryGraph, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    real = Role.require

    def counting(self: Role, act: Any, name: str) -> None:
        asked.append(name)
        real(self, act, name)

    monkeypatch.setattr(Role, "require", counting)
    client = _client(graph, {"publish": ["/x"]})
    for _ in range(10):
        client.say("publish", **TOPIC, msg={})
    assert asked == ["/x"]


# -- rosapi ------------------------------------------------------------------------------------------------


@pytest.fixture
async def robot(distro: str) -> AsyncIterator[Node]:
    graph = MemoryGraph(registry=Registry(DISTROS[distro]))
    async with graph:
        with Rosapi(graph):
            robot = Node(graph, "robot")
            robot.advertise("/open", "std_msgs/String")
            robot.advertise("/secret", "std_msgs/String")
            robot.advertise_service("/open_door", "std_srvs/Trigger", lambda _: {"success": True})
            robot.advertise_service("/secret_door", "std_srvs/Trigger", lambda _: {"success": True})
            hidden = Node(graph, "hidden")
            hidden.advertise("/secret2", "std_msgs/String")
            robot.parameters.declare("open_speed", 1.0)
            robot.parameters.declare("secret_speed", 2.0)
            yield robot


async def _ask(client: Client, service: str, /, **args: object) -> Any:
    client.say("call_service", id="q", service=service, args=args)
    for _ in range(1000):
        for message in client.heard():
            return message
        await anyio.lowlevel.checkpoint()
    raise AssertionError(f"{service} did not answer")


GUEST = {
    "subscribe": ["/open*"],
    "call": ["/open*", "/robot/*"],
    "get_param": ["*open*"],
    "set_param": ["*open*"],
}


@pytest.mark.anyio
async def test_lists_hold_what_the_role_may_see(robot: Node, distro: str) -> None:
    client = _client(robot.graph, GUEST, level=None)

    async def ask(service: str, /, **args: object) -> Any:
        reply = await _ask(client, f"/rosapi/{service}", **args)
        assert reply["result"] is True, reply
        return reply["values"]

    string = "std_msgs/msg/String" if distro == "jazzy" else "std_msgs/String"
    assert await ask("topics") == {"topics": ["/open"], "types": [string]}
    raw = await ask("topics_and_raw_types")
    assert (raw["topics"], raw["types"], len(raw["typedefs_full_text"])) == (["/open"], [string], 1)
    assert await ask("topics_for_type", type="std_msgs/String") == {"topics": ["/open"]}
    services = (await ask("services"))["services"]
    assert "/open_door" in services
    assert "/rosapi/topics" in services
    assert not any("secret" in name for name in services)
    assert await ask("services_for_type", type="std_srvs/Trigger") == {"services": ["/open_door"]}
    assert await ask("topic_type", topic="/open") == {"type": string}
    assert await ask("topic_type", topic="/secret") == {"type": ""}
    assert await ask("topic_type", topic="secret") == {"type": ""}
    assert await ask("publishers", topic="/open") == {"publishers": ["/robot"]}
    assert await ask("publishers", topic="/secret") == {"publishers": []}
    assert (await ask("service_type", service="/open_door"))["type"].endswith("Trigger")
    assert await ask("service_type", service="/secret_door") == {"type": ""}
    assert await ask("service_node", service="/secret_door") == {"node": ""}
    nodes = (await ask("nodes"))["nodes"]
    assert "/robot" in nodes
    assert "/hidden" not in nodes
    details = await ask("node_details", node="/robot")
    assert details["publishing"] == ["/open"]
    assert "/secret_door" not in details["services"]


@pytest.mark.anyio
async def test_parameters_follow_their_own_globs(robot: Node, distro: str) -> None:
    client = _client(robot.graph, GUEST, level=None)
    prefix = "/robot:" if distro == "jazzy" else "/robot/"

    async def ask(service: str, /, **args: object) -> Any:
        return await _ask(client, f"/rosapi/{service}", **args)

    names = (await ask("get_param_names"))["values"]["names"]
    assert f"{prefix}open_speed" in names
    assert not any("secret" in name for name in names)
    assert json.loads((await ask("get_param", name=f"{prefix}open_speed"))["values"]["value"]) == 1.0
    assert (await ask("set_param", name=f"{prefix}open_speed", value="3.0"))["result"] is True
    assert robot.parameters.get("open_speed") == 3.0
    for service, act in (
        ("get_param", "get_param"),
        ("set_param", "set_param"),
        ("delete_param", "set_param"),
    ):
        args = {"value": "9.0"} if service == "set_param" else {}
        reply = await ask(service, name=f"{prefix}secret_speed", **args)
        assert reply["result"] is False
        assert f"(roles.guest.{act})" in reply["values"]
    assert robot.parameters.get("secret_speed") == 2.0
    assert (await ask("has_param", name=f"{prefix}open_speed"))["values"] == {"exists": True}
    assert (await ask("has_param", name=f"{prefix}secret_speed"))["values"] == {"exists": False}


@pytest.mark.anyio
@pytest.mark.parametrize("distro", ["jazzy"])
async def test_a_nodes_own_parameter_services_are_no_way_round(robot: Node) -> None:
    client = _client(robot.graph, GUEST, level=None)
    reply = await _ask(client, "/robot/get_parameters", names=["open_speed"])
    assert reply["result"] is True
    reply = await _ask(client, "/robot/get_parameters", names=["open_speed", "secret_speed"])
    assert (reply["result"], "roles.guest.get_param" in reply["values"]) == (False, True)
    value = {"type": 3, "double_value": 9.0}
    for service in ("set_parameters", "set_parameters_atomically"):
        reply = await _ask(client, f"/robot/{service}", parameters=[{"name": "secret_speed", "value": value}])
        assert (reply["result"], "roles.guest.set_param" in reply["values"]) == (False, True)
    assert robot.parameters.get("secret_speed") == 2.0
    listed = (await _ask(client, "/robot/list_parameters"))["values"]["result"]["names"]
    assert "open_speed" in listed
    assert "secret_speed" not in listed


@pytest.mark.anyio
async def test_who_may_do_everything_sees_everything(robot: Node) -> None:
    client = Client(Bridge(robot.graph, Settings()))
    topics = (await _ask(client, "/rosapi/topics"))["values"]["topics"]
    assert {"/open", "/secret", "/secret2"} <= set(topics)


def test_the_services_of_the_node_as_which_clients_act_are_not_theirs_to_replace() -> None:
    graph = MemoryGraph()
    settings = Settings.model_validate(
        {"roles": {"operator": {"provide": ["*"], "call": ["*"]}}, "auth": {"default_role": "operator"}}
    )
    bridge = Bridge(graph, settings)
    client = Client(bridge)
    Node(graph, "/rosbridge_websocket")
    client.say("set_level", level="error")
    for service, type in (("get_parameters", "GetParameters"), ("new", "GetParameters")):
        name = f"/rosbridge_websocket/{service}"
        client.say("advertise_service", service=name, type=f"rcl_interfaces/{type}")
    (refusal,) = client.heard()
    assert "/rosbridge_websocket/get_parameters" in refusal["msg"]
    assert "displace" in refusal["msg"]
