"""rosapi as clients ask it: every service of the table, relative and absolute, on both distributions."""

from __future__ import annotations

import json
import socket
from collections.abc import AsyncIterator
from typing import Any

import anyio.lowlevel
import pytest

from rwt import Settings
from rwt.rosapi import Rosapi
from rwt.rosapi.parameter_services import MOST_DEFAULT, MOST_VALUES
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph, Node
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from tests.core.rosbridge.recording_client import Client

pytestmark = pytest.mark.anyio


class Asker:
    """A client that asks rosapi and waits for the answer."""

    def __init__(self, bridge: Bridge) -> None:
        self._client = Client(bridge)
        self._asked = 0

    async def ask(self, service: str, /, **args: object) -> Any:
        reply = await self.reply(service, **args)
        assert reply["result"] is True, reply
        return reply["values"]

    def at_once(self, service: str, /, **args: object) -> Any:
        self._asked += 1
        self._client.say("call_service", id=self._asked, service=service, args=args)
        (message,) = self._client.heard()
        return message

    async def reply(self, service: str, /, **args: object) -> Any:
        self._asked += 1
        self._client.say("call_service", id=self._asked, service=service, args=args)
        for _ in range(1000):
            for message in self._client.heard():
                assert message["id"] == self._asked
                return message
            await anyio.lowlevel.checkpoint()
        raise AssertionError(f"{service} did not answer")


@pytest.fixture(params=["jazzy", "noetic"])
def distro(request: pytest.FixtureRequest) -> str:
    """Each: the services and the spelling of types differ."""
    return str(request.param)


@pytest.fixture
async def graph(distro: str) -> AsyncIterator[MemoryGraph]:
    graph = MemoryGraph(registry=Registry(DISTROS[distro]))
    async with graph:
        with Rosapi(graph):
            yield graph


@pytest.fixture
def robot(graph: MemoryGraph) -> Node:
    node = Node(graph, "robot")
    node.advertise("/odom", "nav_msgs/Odometry")
    node.subscribe("/cmd_vel", lambda _: None, type="geometry_msgs/Twist")
    node.advertise_service("/enable", "std_srvs/SetBool", lambda _: {"success": True})
    return node


@pytest.fixture
def asker(graph: MemoryGraph, robot: Node) -> Asker:
    return Asker(Bridge(graph, Settings()))


def _spelled(distro: str, package: str, kind: str, name: str) -> str:
    return f"{package}/{kind}/{name}" if distro == "jazzy" else f"{package}/{name}"


@pytest.mark.parametrize("service", ["/rosapi/topics", "rosapi/topics"])
async def test_topics(asker: Asker, distro: str, service: str) -> None:
    answer = await asker.ask(service)
    types = dict(zip(answer["topics"], answer["types"], strict=True))
    assert types["/odom"] == _spelled(distro, "nav_msgs", "msg", "Odometry")
    assert types["/cmd_vel"] == _spelled(distro, "geometry_msgs", "msg", "Twist")
    log = ("rcl_interfaces", "msg", "Log") if distro == "jazzy" else ("rosgraph_msgs", "msg", "Log")
    assert types["/rosout"] == _spelled(distro, *log)


SET_BOOL = {"jazzy": "std_srvs/srv/SetBool", "noetic": "std_srvs/SetBool"}
ODOMETRY = {"jazzy": "nav_msgs/msg/Odometry", "noetic": "nav_msgs/Odometry"}


@pytest.mark.parametrize(
    ("question", "argument", "answer"),
    [
        ("topic_type", {"topic": "/odom"}, {"type": ODOMETRY}),
        ("topic_type", {"topic": "/nothing"}, {"type": ""}),
        ("topics_for_type", {"type": "nav_msgs/Odometry"}, {"topics": ["/odom"]}),
        ("topics_for_type", {"type": "nav_msgs/msg/Odometry"}, {"topics": ["/odom"]}),
        ("topics_for_type", {"type": "no such type"}, {"topics": []}),
        ("publishers", {"topic": "/odom"}, {"publishers": ["/robot"]}),
        ("publishers", {"topic": "/nothing"}, {"publishers": []}),
        ("subscribers", {"topic": "cmd_vel"}, {"subscribers": ["/robot"]}),
        ("service_type", {"service": "/enable"}, {"type": SET_BOOL}),
        ("service_type", {"service": "/nothing"}, {"type": ""}),
        ("services_for_type", {"type": "std_srvs/SetBool"}, {"services": ["/enable"]}),
        ("service_node", {"service": "/enable"}, {"node": "/robot"}),
        ("service_node", {"service": "/nothing"}, {"node": ""}),
        ("service_providers", {"service": "std_srvs/SetBool"}, {"providers": ["/robot"]}),
        ("service_host", {"service": "/enable"}, {"host": socket.gethostname()}),
        ("service_host", {"service": "/nothing"}, {"host": ""}),
        ("has_param", {"name": "/nothing"}, {"exists": False}),
    ],
)
async def test_questions_about_one_name(
    asker: Asker, distro: str, question: str, argument: dict[str, str], answer: dict[str, Any]
) -> None:
    """A mapping has the answer of each distribution."""
    ((field, value),) = answer.items()
    wanted = value[distro] if isinstance(value, dict) else value
    assert await asker.ask(f"/rosapi/{question}", **argument) == {field: wanted}


async def test_raw_types_are_full_texts(asker: Asker) -> None:
    answer = await asker.ask("/rosapi/topics_and_raw_types")
    texts = dict(zip(answer["topics"], answer["typedefs_full_text"], strict=True))
    assert "linear" in texts["/cmd_vel"]
    assert "=" * 80 + "\nMSG: geometry_msgs/Vector3\n" in texts["/cmd_vel"]
    assert all(texts.values())


async def test_services(asker: Asker) -> None:
    assert {"/enable", "/rosapi/topics"} <= set((await asker.ask("/rosapi/services"))["services"])


async def test_nodes(asker: Asker, distro: str) -> None:
    assert {"/robot", "/rosapi", "/rosbridge_websocket"} <= set((await asker.ask("/rosapi/nodes"))["nodes"])
    details = await asker.ask("/rosapi/node_details", node="/robot")
    assert "/cmd_vel" in details["subscribing"]
    assert "/odom" in details["publishing"]
    assert "/enable" in details["services"]
    unknown = await asker.reply("/rosapi/node_details", node="/nobody")
    assert unknown["result"] is (distro == "noetic")


async def test_message_details(asker: Asker, distro: str) -> None:
    answer = await asker.ask("/rosapi/message_details", type="geometry_msgs/TwistStamped")
    (root, *nested) = answer["typedefs"]
    assert root == {
        "type": "geometry_msgs/TwistStamped",
        "fieldnames": ["header", "twist"],
        "fieldtypes": ["std_msgs/Header", "geometry_msgs/Twist"],
        "fieldarraylen": [-1, -1],
        "examples": ["{}", "{}"],
        "constnames": [],
        "constvalues": [],
    }
    time = "builtin_interfaces/Time" if distro == "jazzy" else "time"
    assert [definition["type"] for definition in nested] == [
        "std_msgs/Header",
        time,
        "geometry_msgs/Twist",
        "geometry_msgs/Vector3",
    ]
    double = "double" if distro == "jazzy" else "float64"
    assert nested[-1]["fieldtypes"] == [double] * 3
    assert nested[-1]["examples"] == ["0.0"] * 3


async def test_arrays_and_constants_in_details(asker: Asker) -> None:
    (imu, *_) = (await asker.ask("/rosapi/message_details", type="sensor_msgs/Imu"))["typedefs"]
    lengths = dict(zip(imu["fieldnames"], imu["fieldarraylen"], strict=True))
    assert lengths["orientation_covariance"] == 9
    answer = await asker.ask("/rosapi/message_details", type="diagnostic_msgs/DiagnosticStatus")
    (status, *_) = answer["typedefs"]
    assert dict(zip(status["constnames"], status["constvalues"], strict=True))["ERROR"] == "2"
    assert dict(zip(status["fieldnames"], status["fieldarraylen"], strict=True))["values"] == 0


async def test_details_of_services_and_actions(asker: Asker) -> None:
    for part, fields in (("request", ["data"]), ("response", ["success", "message"])):
        answer = await asker.ask(f"/rosapi/service_{part}_details", type="std_srvs/SetBool")
        assert answer["typedefs"][0]["fieldnames"] == fields
    for part, fields in (("goal", ["order"]), ("result", ["sequence"]), ("feedback", ["sequence"])):
        answer = await asker.ask(f"/rosapi/action_{part}_details", type="example_interfaces/Fibonacci")
        assert answer["typedefs"][0]["fieldnames"] == fields


@pytest.mark.parametrize("service", ["message_details", "service_request_details", "action_goal_details"])
async def test_an_unknown_type_is_told(asker: Asker, service: str) -> None:
    reply = await asker.reply(f"/rosapi/{service}", type="std_msgs/Sting")
    assert reply["result"] is False
    assert "std_msgs/Sting" in reply["values"]


async def test_interfaces(asker: Asker, distro: str) -> None:
    known = (await asker.ask("/rosapi/interfaces"))["interfaces"]
    assert _spelled(distro, "std_msgs", "msg", "String") in known
    assert _spelled(distro, "std_srvs", "srv", "SetBool") in known


async def test_time_and_version(asker: Asker, distro: str) -> None:
    time = (await asker.ask("/rosapi/get_time"))["time"]
    assert list(time) == (["sec", "nanosec"] if distro == "jazzy" else ["secs", "nsecs"])
    version = await asker.reply("/rosapi/get_ros_version")
    if distro == "jazzy":
        assert version["values"] == {"version": 2, "distro": "jazzy"}
    else:
        assert version["result"] is False


@pytest.mark.parametrize("release", ["humble", "kilted", "lyrical", "rolling"])
async def test_the_version_names_the_release(release: str) -> None:
    graph = MemoryGraph(registry=Registry(DISTROS[release]))
    async with graph:
        with Rosapi(graph):
            answer = await graph.node("asker").call("/rosapi/get_ros_version", {})
    assert (answer.version, answer.distro) == (2, release)


async def test_action_servers_of_ros1_are_sets_of_topics(asker: Asker, robot: Node) -> None:
    robot.subscribe("/fib/goal", lambda _: None, type="actionlib_tutorials/FibonacciActionGoal")
    robot.subscribe("/fib/cancel", lambda _: None, type="actionlib_msgs/GoalID")
    for end, kind in (("feedback", "FibonacciActionFeedback"), ("result", "FibonacciActionResult")):
        robot.advertise(f"/fib/{end}", f"actionlib_tutorials/{kind}")
    assert "/fib" not in (await asker.ask("/rosapi/action_servers"))["action_servers"]
    robot.advertise("/fib/status", "actionlib_msgs/GoalStatusArray")
    assert "/fib" in (await asker.ask("/rosapi/action_servers"))["action_servers"]
    answer = await asker.ask("/rosapi/action_type", action="/fib")
    assert answer["type"] == "actionlib_tutorials/Fibonacci"


@pytest.mark.parametrize("value", [1, 2.5, True, "text", [1, 2], ["a"]])
async def test_parameters(asker: Asker, distro: str, value: object) -> None:
    name = "/robot:speed" if distro == "jazzy" else "/robot/speed"
    missing = await asker.ask("/rosapi/get_param", name="/nothing")
    assert missing["value"] == "null"
    for each in ("/plain", name):
        await asker.ask("/rosapi/set_param", name=each, value=json.dumps(value))
        got = await asker.ask("/rosapi/get_param", name=each)
        if each == "/plain" or distro == "noetic":
            assert json.loads(got["value"]) == value
            assert await asker.ask("/rosapi/has_param", name=each) == {"exists": True}
            assert each in (await asker.ask("/rosapi/get_param_names"))["names"]
            await asker.ask("/rosapi/delete_param", name=each)
            assert await asker.ask("/rosapi/has_param", name=each) == {"exists": False}


async def test_declared_parameters(asker: Asker, robot: Node, distro: str) -> None:
    robot.parameters.declare("max_speed", 0.5)
    name = "/robot:max_speed" if distro == "jazzy" else "/robot/max_speed"
    assert json.loads((await asker.ask("/rosapi/get_param", name=name))["value"]) == 0.5
    await asker.ask("/rosapi/set_param", name=name, value="0.75")
    assert robot.parameters.get("max_speed") == 0.75
    assert (await asker.ask("/rosapi/search_param", name="max_speed"))["global_name"] == name


async def test_viewers_find_the_description_of_the_one_robot_under_its_old_name(
    graph: MemoryGraph, asker: Asker, robot: Node, distro: str
) -> None:
    if distro == "noetic":
        pytest.skip("there the parameter has that name")
    robot.parameters.declare("robot_description", "<robot/>")
    robot.parameters.declare("secret", 1)
    for name in ("/robot_description", "robot_description"):
        assert json.loads((await asker.ask("/rosapi/get_param", name=name))["value"]) == "<robot/>"
    assert (await asker.ask("/rosapi/get_param", name="/secret"))["value"] == "null"
    assert "/robot_description" not in (await asker.ask("/rosapi/get_param_names"))["names"]
    Node(graph, "another").parameters.declare("robot_description", "<robot/>")
    assert (await asker.ask("/rosapi/get_param", name="/robot_description"))["value"] == "null"


async def test_the_default_of_a_missing_parameter(asker: Asker, distro: str) -> None:
    field = "default_value" if distro == "jazzy" else "default"
    for default, value in (("42", "42"), ("plain text", '"plain text"'), ('{"a": [1]}', '{"a": [1]}')):
        answer = await asker.ask("/rosapi/get_param", name="/nothing", **{field: default})
        assert answer["value"] == value


async def test_a_default_is_no_longer_than_a_parameter(asker: Asker, distro: str) -> None:
    field = "default_value" if distro == "jazzy" else "default"
    reply = await asker.reply("/rosapi/get_param", name="/nothing", **{field: "x" * (MOST_DEFAULT + 1)})
    assert reply["result"] is False
    assert f"{MOST_DEFAULT} are the most" in reply["values"]


@pytest.mark.parametrize(
    ("value", "is_taken"),
    [
        (json.dumps([0] * (MOST_VALUES - 10)), True),
        (json.dumps([0] * (MOST_VALUES + 10)), False),
        ("[" + "[]," * MOST_VALUES + "0]", False),
        # What is in strings is no value, escaped quotes or not.
        (json.dumps("a,[{" * MOST_VALUES), True),
        (json.dumps({"urdf": '<a b="1,2"/>,' * MOST_VALUES}), True),
        (json.dumps(["\\"] * (MOST_VALUES + 10)), False),
    ],
)
async def test_the_text_of_a_value_holds_only_so_many(
    asker: Asker, distro: str, value: str, is_taken: bool
) -> None:
    name = "/large" if distro == "noetic" else "/rosapi/large"
    reply = await asker.reply("/rosapi/set_param", name=name, value=value)
    refused = not reply["result"] or not reply["values"].get("successful", True)
    assert refused is not is_taken, reply
    if refused:
        assert "set several parameters" in str(reply)


async def test_what_nothing_has_to_be_waited_for_is_answered_at_once(
    asker: Asker, graph: MemoryGraph, robot: Node
) -> None:
    """As part of the caller's work, which is bounded and charged; a task's would not be."""
    robot.parameters.declare("speed", 0.5)
    name = "/robot:speed" if graph.distro.parameters_belong_to_nodes else "/robot/speed"
    questions = {
        "set_param": {"name": name, "value": "0.75"},
        "get_param": {"name": name},
        "has_param": {"name": name},
        "get_param_names": {},
        "search_param": {"name": "speed"},
    }
    for question, args in questions.items():
        assert asker.at_once(f"/rosapi/{question}", **args)["result"] is True, question
    assert robot.parameters.get("speed") == 0.75


async def test_a_parameter_that_is_not_set_can_be_deleted_on_ros_1(asker: Asker, distro: str) -> None:
    reply = await asker.reply("/rosapi/delete_param", name="/nothing")
    assert reply["result"] is True
    assert reply["values"].get("successful", True) is (distro == "noetic")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("/plain", "not json"),
        ("/", "null"),
        ("/", "[1]"),
        ("/a", '{"a":' * 300 + "1" + "}" * 300),
        ("/" + "a/" * 200, "1"),
        ("/a", "[" * 900 + "]" * 900),
        ("/a", "1" + "0" * 400),
        ("/a", "1" + "0" * 4400),
        ("/a", json.dumps("x" * 9_000_000)),
    ],
)
async def test_no_value_keeps_others_from_reading_the_parameters(
    asker: Asker, distro: str, name: str, value: str
) -> None:
    await asker.ask("/rosapi/set_param", name="/kept", value="1")
    reply = await asker.reply("/rosapi/set_param", name=name, value=value)
    refused = reply["values"]["reason"] if distro == "jazzy" else reply["values"]
    assert reply["result"] is (distro == "jazzy") and isinstance(refused, str)
    assert refused and "internal error" not in refused and len(refused) < 300
    assert value != "not json" or "is not JSON: 'not json'" in refused
    assert json.loads((await asker.ask("/rosapi/get_param", name="/"))["value"])["kept"] == 1
    assert "/kept" in (await asker.ask("/rosapi/get_param_names"))["names"]
