"""NaN, infinity and null pass no rule: in every encoding, over every gateway, by every verb."""

from __future__ import annotations

import base64
import json
import math
import struct
import zlib
from collections.abc import Callable, Mapping
from typing import Any

import bson
import cbor2
import httpx
import pytest

from rwt import Server, Settings
from rwt.access.gate.fields import has_finite_numbers
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.rosapi import Rosapi
from rwt.rosbridge.bridge import Bridge
from rwt_interfaces.payload import Payload
from tests.core.access.gated_robot import TWIST, GatedRobot, token
from tests.extensions.foxglove.viewer import Viewer
from tests.extensions.mcp.agents import agent_at, url_of

RULES: Mapping[str, Any] = {
    "any": {"topics": ["*"], "services": ["/spawn"], "actions": ["*"]},
    "parameters": {"parameters": ["*"]},
}
VALUES = ("NaN", "Infinity", "-Infinity", "1e999", "null")
ARRAY = "std_msgs/Float64MultiArray"
SCAN = "sensor_msgs/LaserScan"
GO = "nav2_msgs/NavigateToPose"

JSON, CBOR = ({"Content-Type": f"application/{kind}"} for kind in ("json", "cbor"))

Op = dict[str, Any]


def _publish(topic: str, type: str, **msg: object) -> Op:
    return {"op": "publish", "topic": topic, "type": type, "msg": msg}


def _call(service: str, args: object) -> Op:
    return {"op": "call_service", "service": service, "args": args}


def _array(*items: object) -> Op:
    return _publish("/array", ARRAY, layout={"dim": [], "data_offset": 0}, data=[*items])


def _set_parameter(name: str, **value: object) -> Op:
    return _call("/robot/set_parameters", {"parameters": [{"name": name, "value": value}]})


def _set_by_rosapi(name: str, value: object) -> Op:
    return _call("/rosapi/set_param", {"name": name, "value": json.dumps(value).replace('"', "")})


def _pose(x: object) -> dict[str, Any]:
    return {"pose": {"pose": {"position": {"x": x}}}}


ZERO = {"x": 0.0, "y": 0.0, "z": 0.0}
VERBS: Mapping[str, Callable[[Any], Op]] = {
    "field": lambda x: _publish("/cmd_vel", TWIST, linear={**ZERO, "x": x}, angular=ZERO),
    "partial": lambda x: _publish("/cmd_vel", TWIST, linear={"x": x}),
    "array": lambda x: _array(0.5, x),
    "long array": lambda x: _array(*[0.5] * 9000, x),
    "float32 array": lambda x: _publish("/scan", SCAN, ranges=[x]),
    "call": lambda x: _call("/spawn", {"x": x}),
    "call by position": lambda x: _call("/spawn", [x]),
    "goal": lambda x: {"op": "send_action_goal", "action": "/go", "action_type": GO, "args": _pose(x)},
    "goal as a call": lambda x: _call("/raw/_action/send_goal", {"goal": _pose(x)}),
    "parameter": lambda x: _set_parameter("speed", type=3, double_value=x),
    "parameter list": lambda x: _set_parameter("gains", type=8, double_array_value=[1.0, x]),
    "parameter by rosapi": lambda x: _set_by_rosapi("/robot:speed", x),
    "parameter list by rosapi": lambda x: _set_by_rosapi("/robot:gains", [1.0, x]),
}
"""Members that may hold a number, by op of rosbridge."""


class Ears(GatedRobot):
    """A robot that notes everything that reaches it."""

    def __init__(self, distro: str = "jazzy") -> None:
        super().__init__(RULES, distro)
        self.reached: list[object] = []
        registry, base = self.graph.registry, self.graph.participant("/base")
        for topic, type in (("/array", ARRAY), ("/scan", SCAN)):
            base.subscribe(topic, self.reached.append, registry.message(type))
        base.advertise_service("/spawn", registry.service("turtlesim/Spawn"), self.reached.append)
        base.advertise_action("/go", registry.action(GO), self.reached.append)
        if distro == "jazzy":
            send_goal = registry.service("nav2_msgs/NavigateToPose_SendGoal")
            base.advertise_service("/raw/_action/send_goal", send_goal, self.reached.append)
            self.node.parameters.declare("speed", 1.0)
            self.node.parameters.declare("gains", [1.0])
        Rosapi(self.graph)

    @property
    def is_untouched(self) -> bool:
        """True if nothing has reached it."""
        known = self.node.parameters
        are_set = known.has("speed") and (known.get("speed"), list(known.get("gains"))) != (1.0, [1.0])
        return not (self.heard or self.reached or are_set)


def _raw(op: Op, value: str) -> str:
    """An op in JSON, with a value that JSON may not have."""
    return json.dumps(op).replace("12345.5", value)


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("value", VALUES)
def test_over_rosbridge_in_json(verb: str, value: str) -> None:
    robot = Ears()
    client = robot.client()
    client.say_raw(_raw(VERBS[verb](12345.5), value))
    assert robot.is_untouched, verb
    client.say_raw(_raw(VERBS[verb](12345.5), "2.5"))
    assert not robot.is_untouched, verb


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("value", [math.nan, math.inf, None])
def test_over_rosbridge_in_cbor(verb: str, value: object) -> None:
    robot = Ears()
    robot.client().say_raw(cbor2.dumps(VERBS[verb](value)), binary=True)
    assert robot.is_untouched


@pytest.mark.parametrize("tag", [85, 86])
def test_over_rosbridge_in_typed_arrays(tag: int) -> None:
    robot = Ears()
    for name in ("array", "float32 array"):
        op = VERBS[name](0.5)
        field = "data" if name == "array" else "ranges"
        op["msg"][field] = cbor2.CBORTag(tag, struct.pack("<2f" if tag == 85 else "<2d", 0.5, math.nan))
        robot.client().say_raw(cbor2.dumps(op), binary=True)
    assert robot.is_untouched


@pytest.mark.parametrize("verb", VERBS)
def test_over_rosbridge_in_png(verb: str) -> None:
    robot = Ears()
    text = _raw(VERBS[verb](12345.5), "NaN").encode()
    side = math.ceil(math.sqrt(len(text) / 3))
    pixels = text.ljust(side * side * 3, b"\n")
    rows = b"".join(b"\0" + pixels[row * side * 3 : (row + 1) * side * 3] for row in range(side))

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0))
    png = b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    robot.client().say("png", data=base64.b64encode(png).decode())
    assert robot.is_untouched


def test_over_rosbridge_in_bson() -> None:
    robot = Ears()
    robot.bridge = Bridge(robot.graph, Settings(bson_only_mode=True), robot.access)
    for verb in VERBS:
        op = VERBS[verb](math.nan)
        if isinstance(op.get("args"), dict | type(None)) or "msg" in op:
            robot.client().say_raw(bson.encode(op), binary=True)
    assert robot.is_untouched
    robot.client().say_raw(bson.encode(VERBS["field"](0.5)), binary=True)
    assert not robot.is_untouched


@pytest.mark.parametrize("value", VALUES)
def test_a_goal_as_a_message(value: str) -> None:
    robot = Ears("noetic")
    goals = robot.hear("/move/goal", "move_base_msgs/MoveBaseActionGoal")
    client = robot.client()
    text = '{"op": "publish", "topic": "/move/goal", "type": "move_base_msgs/MoveBaseActionGoal", "msg":'
    text += '{"goal": {"target_pose": {"pose": {"position": {"x": %s}}}}}}'
    client.say_raw(text % value)
    assert goals == []
    client.say_raw(text % "2.5")
    assert len(goals) == 1


@pytest.mark.parametrize("encoding", ["json", "cdr"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_over_foxglove(encoding: str, value: float) -> None:
    robot = Ears()
    viewer = Viewer(
        FoxgloveGateway(robot.graph, robot.access), headers={"authorization": f"Bearer {token('operator')}"}
    )
    viewer.heard()
    twist, spawn = robot.graph.registry.message(TWIST), robot.graph.registry.service("turtlesim/Spawn")
    message = Payload.from_value(twist, {"linear": {"x": value}})
    request = Payload.from_value(spawn.request, {"x": value})
    viewer.advertise("/cmd_vel", "geometry_msgs/msg/Twist", encoding)
    viewer.publish(json.dumps({"linear": {"x": value}}).encode() if encoding == "json" else message.cdr())
    viewer.call(
        "/spawn", json.dumps({"x": value}).encode() if encoding == "json" else request.cdr(), encoding
    )
    viewer.say_raw('{"op": "setParameters", "parameters": [{"name": "/robot.speed", "value": NaN}]}')
    viewer.say_raw(
        '{"op": "setParameters", "parameters": [{"name": "/robot.speed", "value": 1e999, "type": "float64"}]}'
    )
    assert robot.is_untouched


@pytest.mark.anyio
async def test_over_http_and_mcp() -> None:
    gate = {"rules": {"any": RULES["any"], "parameters": RULES["parameters"]}}
    mcp = {"default_role": "admin", "confirm": []}
    async with Server("ws://127.0.0.1:0", gate=gate, gateways=["http", "mcp"], mcp=mcp) as server:
        reached: list[object] = []

        def spawn(request: object) -> dict[str, str]:
            reached.append(request)
            return {}

        node = server.node("base")
        node.subscribe("/cmd_vel", reached.append, TWIST)
        node.advertise_service("/spawn", "turtlesim/Spawn", spawn)
        node.parameters.declare("speed", 1.0)
        async with httpx.AsyncClient(base_url=server.urls[0].replace("ws", "http", 1)) as http:
            bodies = [(cbor2.dumps({"linear": {"x": value}}), CBOR) for value in (math.nan, math.inf, None)]
            bodies += [(b'{"linear": {"x": %s}}' % value.encode(), JSON) for value in VALUES]
            for body, headers in bodies:
                answer = await http.post("/api/topics/cmd_vel", content=body, headers=headers)
                assert answer.status_code == 403, (body, answer.text)
            for value in VALUES:
                answer = await http.post(
                    "/api/services/spawn", content=b'{"x": %s}' % value.encode(), headers=JSON
                )
                assert answer.status_code == 403, (value, answer.text)
                answer = await http.put("/api/parameters/base:speed", content=value.encode(), headers=JSON)
                assert answer.status_code >= 400, (value, answer.text)
            answer = await http.put("/api/parameters/base:speed", content=cbor2.dumps(math.nan), headers=CBOR)
            assert answer.status_code >= 400
        async with agent_at(url_of(server)) as agent:
            for number in (math.nan, math.inf, None):
                asked: Op = {"topic": "/cmd_vel", "message": {"linear": {"x": number}}}
                assert (await agent.call_tool("publish", asked)).is_error
                asked = {"service": "/spawn", "request": {"x": number}}
                assert (await agent.call_tool("call_service", asked)).is_error
        assert reached == []
        assert node.parameters.get("speed") == 1.0


@pytest.mark.parametrize(
    ("text", "is_finite"),
    [
        ("1.5", True), ("[1, 2.5]", True), ('"NaN"', True), ("nan", True), ('{"a": {"b": [1e999]}}', False),
        ("NaN", False), ("-Infinity", False), ("[[NaN]]", False), ("null", False), ("[" * 100_000, True),
    ],
)  # fmt: skip
def test_the_numbers_of_a_text(text: str, is_finite: bool) -> None:
    assert has_finite_numbers(text) is is_finite
