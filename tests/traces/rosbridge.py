"""Sessions of rosbridge's protocol, in JSON and in its other encodings."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any, Final

import bson
import cbor2

from tests.traces.transcript import Session, Transcript
from tests.traces.wires import Wire, serving

ROBOT: Final = Path(__file__).with_name("robot.toml")
NEXT: Final = "/rwt_script/next"
ADD: Final = "example_interfaces/AddTwoInts"
FIBONACCI: Final = "example_interfaces/Fibonacci"

_WRONG_VALUES: Final[tuple[Any, ...]] = (42, "word", True, None, [1], {"x": 1}, -1, 1.5, 2**64)
#: A member of each type, which gets all wrong values; all others get one.
_OF_EACH_TYPE: Final = (
    ("publish", "topic"),
    ("publish", "latch"),
    ("subscribe", "throttle_rate"),
    ("subscribe", "compression"),
    ("subscribe", "qos"),
    ("call_service", "timeout"),
    ("action_result", "status"),
)
#: Members of each op, with values that are right. Names that are in no graph, so that all is refused at once.
_OPS: Final[dict[str, dict[str, Any]]] = {
    "advertise": {"topic": "/w", "type": "std_msgs/String", "latch": False, "queue_size": 1, "qos": {}},
    "unadvertise": {"topic": "/w"},
    "publish": {"topic": "/w", "type": "std_msgs/String", "msg": {}, "latch": False, "qos": {}},
    "subscribe": {
        "topic": "/v",
        "type": "std_msgs/Bool",
        "throttle_rate": 0,
        "queue_length": 0,
        "fragment_size": 0,
        "compression": "none",
        "qos": {},
    },
    "unsubscribe": {"topic": "/v"},
    "call_service": {"service": "/none", "type": "", "args": {}, "timeout": 1, "fragment_size": 0},
    "service_response": {"service": "/none", "values": {}, "result": True},
    "advertise_service": {"service": "/u", "type": "std_srvs/Trigger"},
    "unadvertise_service": {"service": "/u"},
    "send_action_goal": {"action": "/none", "action_type": FIBONACCI, "args": {}, "feedback": False},
    "cancel_action_goal": {"action": "/none"},
    "action_feedback": {"action": "/none", "values": {}},
    "action_result": {"action": "/none", "values": {}, "result": True, "status": 4},
    "advertise_action": {"action": "/t", "type": FIBONACCI},
    "unadvertise_action": {"action": "/t"},
    "fragment": {"data": "{", "num": 0, "total": 2},
    "png": {"data": "AAAA"},
    "auth": {"mac": "", "client": "", "dest": "", "rand": "", "t": 0, "level": "", "end": 0},
    "status": {"level": "info", "msg": ""},
    "set_level": {"level": "info"},
}
_BAD_FRAMES: Final = (
    "",
    " ",
    "nonsense",
    "{",
    '{"op":"publish"',
    "[]",
    "42",
    '"text"',
    "null",
    "true",
    "{}",
    '{"op":42}',
    '{"op":null}',
    '{"op":""}',
    '{"op":"fly"}',
    '{"op":"Publish","topic":"/x"}',
    '{"op":"set_status_level","level":"loud"}',
    '{"op":"status_level","level":"info","id":"s"}',
    '{"op":"publish","topic":"/x","msg":{"data":1e400},"type":"std_msgs/Float64","id":"big"}',
    '{"op":"publish","topic":"/x","msg":{"data":18446744073709551616},"type":"std_msgs/UInt64","id":"big"}',
    '{"op":"publish","topic":"/x","msg":{"data":' + "9" * 5000 + '},"type":"std_msgs/UInt64","id":"long"}',
    '{"op":"publish","topic":"/x","id":"deep","msg":' + '{"a":' * 120 + "1" + "}" * 120 + "}",
    '{"op":"call_service","service":"/x","id":"deep","args":' + "[" * 120 + "]" * 120 + "}",
    '{"op":"publish","topic":"/x","msg":{"data":"\\ud800"},"type":"std_msgs/String","id":"surrogate"}',
    '{"op":"publish","topic":"\\ud800","msg":{},"id":"surrogate"}',
    '{"op":"publish","op":"subscribe","topic":"/x","id":"twice"}',
    '{"op":"unsubscribe","topic":"/x","id":1}{"op":"unsubscribe","topic":"/x","id":2}',
    '{"op":"unsubscribe","topic":"/x","id":3} trailing',
    '{"op":"unsubscribe","topic":"/x","id":"' + "i" * 4097 + '"}',
    '{"op":"unsubscribe","topic":"/x","id":{}}',
    '{"op":"unsubscribe","topic":"/x","id":1.5}',
    '{"op":"unsubscribe","topic":"' + "t" * 70000 + '","id":"long"}',
    b'{"op":"unsubscribe","topic":"/x","id":"binary JSON"}',
    b"\xff\xfe",
    b"{\x80",
    b"\x80",
    b"\xa1",
    b"\x00\x01\x02",
)
_BAD_MESSAGES: Final[tuple[tuple[str, Any], ...]] = (
    ("std_msgs/String", {"data": 42}),
    ("std_msgs/String", {"dada": ""}),
    ("std_msgs/String", "text"),
    ("std_msgs/Bool", {"data": 1}),
    ("std_msgs/Int8", {"data": 128}),
    ("std_msgs/Int8", {"data": 1.5}),
    ("std_msgs/UInt64", {"data": 2**64}),
    ("std_msgs/Float32", {"data": "fast"}),
    ("std_msgs/Float32", {"data": 1e39}),
    ("std_msgs/UInt8MultiArray", {"data": "!!!"}),
    ("std_msgs/UInt8MultiArray", {"data": [256]}),
    ("std_msgs/UInt8MultiArray", {"layout": {"dim": [{"size": -1}]}}),
    ("std_msgs/Header", {"stamp": "then"}),
    ("std_msgs/Header", {"stamp": {"sec": 1, "nsecs": 2}}),
    ("geometry_msgs/PoseWithCovariance", {"covariance": [1, 2]}),
    ("geometry_msgs/Polygon", {"points": [{"x": 1}, 2]}),
)
_BAD_TYPES: Final = (
    "nothing_msgs/Nothing",
    "String",
    "std_msgs/",
    "std_msgs/srv/String",
    "",
    "std_srvs/Trigger",
)
_NAMES: Final = ("", "/", "a b", "/a//b", "/1st", "a/", "~private", "/ünï", "relative", "/a-b", "{x}")


def session(transcript: Transcript, *, distro: str) -> None:
    """Record all ops in JSON with one distribution."""
    with serving("--script", str(ROBOT), "--distro", distro) as url:
        with Wire(transcript, "a", url) as a, Wire(transcript, "b", url) as b:
            transcript.title("handshake")
            transcript.add(a.head)
            transcript.title("refusals before set_level")
            a.ask({"op": "fly", "id": 1}, {"op": "publish", "topic": "/cmd_vel", "msg": {"linear": 1}})
            transcript.title("acknowledgements at level info")
            a.ask({"op": "set_level", "level": "info", "id": "level"})
            _topics(transcript, a, b)
            _services(transcript, a, b)
            _client_services(transcript, a, b)
            _actions(transcript, a, b)
            _fragments(transcript, a)
            _rosapi(transcript, a)
        with Wire(transcript, "c", url) as c:
            c.ask({"op": "set_level", "level": "info", "id": "level"})
            _refusals(transcript, c)


def _topics(transcript: Transcript, a: Wire, b: Wire) -> None:
    text = "std_msgs/String"
    transcript.title("topics")
    a.ask({"op": "advertise", "id": "ad", "topic": "/chat", "type": text})
    a.ask({"op": "advertise", "id": "ad2", "topic": "chat", "type": "std_msgs/msg/String"})
    a.ask({"op": "advertise", "id": "ad3", "topic": "/chat", "type": "std_msgs/Bool"})
    b.ask({"op": "subscribe", "id": "sub", "topic": "/chat", "type": text})
    b.ask({"op": "subscribe", "id": "sub2", "topic": "chat"})
    b.ask({"op": "subscribe", "id": "sub3", "topic": "/chat", "type": "std_msgs/Bool"})
    a.ask({"op": "publish", "id": "p", "topic": "/chat", "msg": {"data": 'hello \u00e4\u2028"\\\n'}})
    b.hear(2)
    a.ask({"op": "publish", "id": "p", "topic": "/chat"})
    b.hear(2)
    b.ask({"op": "unsubscribe", "id": "sub2", "topic": "chat"})
    b.ask({"op": "unsubscribe", "id": "sub9", "topic": "/chat"})
    a.ask({"op": "publish", "topic": "/chat", "msg": {"data": "x" * 300}, "type": text})
    b.hear()
    b.ask({"op": "unsubscribe", "topic": "/chat"}, {"op": "unsubscribe", "topic": "/chat"})
    a.ask({"op": "unadvertise", "id": "ad", "topic": "/chat"}, {"op": "unadvertise", "topic": "/chat"})
    a.ask({"op": "unadvertise", "topic": "/chat"})

    transcript.title("latched topics")
    b.say({"op": "subscribe", "topic": "/map_name"})
    b.hear()
    a.ask({"op": "advertise", "topic": "/kept", "type": text, "latch": True, "queue_size": 3})
    a.ask({"op": "publish", "topic": "/kept", "msg": {"data": "kept"}})
    b.say({"op": "subscribe", "topic": "/kept", "type": text})
    b.hear()
    qos = {"durability": "transient_local", "reliability": "best_effort", "history": "keep_last", "depth": 2}
    a.ask({"op": "advertise", "topic": "/qos", "type": text, "qos": qos})
    a.ask({"op": "advertise", "topic": "/qos", "type": text, "qos": {"depth": -1}})
    a.ask({"op": "advertise", "topic": "/qos", "type": text, "qos": {"durability": "eternal"}})
    a.ask({"op": "advertise", "topic": "/qos", "type": text, "qos": {"colour": "red"}})
    a.ask({"op": "subscribe", "topic": "/qos", "type": text, "qos": {"reliability": "reliable"}})
    a.ask({"op": "subscribe", "topic": "/qos", "type": text, "qos": "sensor_data"})

    transcript.title("values of messages")
    values = "std_msgs/Float64MultiArray"
    b.ask({"op": "subscribe", "topic": "/values", "type": values})
    a.ask({"op": "publish", "topic": "/values", "type": values, "msg": {"data": [0.1, None, 1e300, -0.0, 3]}})
    b.hear()
    bytes_ = "std_msgs/UInt8MultiArray"
    b.ask({"op": "subscribe", "topic": "/bytes", "type": bytes_})
    a.ask({"op": "publish", "topic": "/bytes", "type": bytes_, "msg": {"data": "AAEC/w=="}})
    b.hear()
    b.ask({"op": "subscribe", "topic": "/imu", "type": "sensor_msgs/Imu"})
    stamp = {"stamp": {"secs": 3, "nsecs": 4}, "frame_id": "imu"}
    imu = {"op": "publish", "topic": "/imu", "type": "sensor_msgs/Imu", "msg": {"header": stamp}}
    a.ask(imu, {**imu, "msg": {}}, {**imu, "msg": {"header": {"stamp": "now"}}})
    b.hear(3)

    transcript.title("throttled, with and without a queue")
    for number in (2, 3):
        topic = f"/slow{number}"
        throttled = {"throttle_rate": 60_000, "queue_length": number - 2}
        b.ask({"op": "subscribe", "topic": topic, "type": text, **throttled})
        for each in ("first", "dropped", "dropped too"):
            a.ask({"op": "publish", "topic": topic, "type": text, "msg": {"data": each}})
        b.hear()
    b.settle()

    transcript.title("in fragments, and as PNG")
    long = {"op": "publish", "type": text, "msg": {"data": "0123456789" * 12}}
    b.ask({"op": "subscribe", "topic": "/cut", "type": text, "fragment_size": 60})
    a.ask({**long, "topic": "/cut"})
    b.hear_fragments()
    b.ask({"op": "subscribe", "topic": "/drawn", "type": text, "compression": "png"})
    a.ask({**long, "topic": "/drawn"})
    b.hear()
    b.ask({"op": "subscribe", "topic": "/drawn2", "type": text, "compression": "png", "fragment_size": 150})
    a.ask({**long, "topic": "/drawn2"})
    b.hear_fragments()
    b.ask({"op": "subscribe", "topic": "/odd", "type": text, "compression": "brotli"})
    b.settle()


def _services(transcript: Transcript, a: Wire, b: Wire) -> None:
    call = {"op": "call_service", "service": "/add"}
    transcript.title("services of the robot")
    calls: tuple[dict[str, Any], ...] = (
        {"args": {"a": 2, "b": 3}},
        {"args": [2, 3], "type": ADD},
        {},
        {"args": None},
        {"args": {"a": 13}},
        {"args": {"a": 14}, "timeout": 0.05},
        {"args": {"c": 1}},
        {"args": {"a": "two"}},
        {"args": {"a": 1.5}},
        {"args": [1, 2, 3]},
        {"args": [1]},
        {"args": "two"},
        {"args": {"a": 2}, "fragment_size": 50},
        {"args": {"a": 2}, "compression": "png"},
        {"args": {"a": 2}, "type": "std_srvs/Trigger"},
        {"service": "add", "args": {"a": 2}},
        {"service": "/nothing"},
        {"service": "/lab/get_parameters", "args": {"names": ["max_speed", "none"]}},
        {"service": "/rosapi/get_param", "args": {"name": "/lab:max_speed"}},
        {"service": "/rosapi/get_param", "args": {"name": "/max_speed", "default": '"none"'}},
        {"service": "/rosapi/set_param", "args": {"name": "/lab:max_speed", "value": "0.75"}},
        {"service": "/rosapi/set_param", "args": {"name": "/lab:max_speed", "value": "nonsense{"}},
        {"service": "/rosapi/has_param", "args": {"name": "/lab:max_speed"}},
    )
    for number, more in enumerate(calls):
        a.say({**call, "id": f"call {number}", **more})
        a.hear_until(f'"id":"call {number}"')
        a.settle()
    a.say(call)
    a.hear()


def _client_services(transcript: Transcript, a: Wire, b: Wire) -> None:
    transcript.title("a service of a client")
    offered = {"op": "advertise_service", "service": "/sum", "type": ADD}
    b.ask({"op": "set_level", "level": "info"}, {**offered, "type": "std_srvs/Trigger"})
    b.ask(offered, offered)
    b.ask({**offered, "service": "/add"}, {"op": "unadvertise_service", "service": "/add"})
    taken = {"op": "advertise_service", "service": "/taken", "type": "std_srvs/Trigger"}
    b.ask(taken)
    a.ask(taken)
    b.ask({"op": "unadvertise_service", "service": "/taken"})
    a.ask({"op": "unadvertise_service", "service": "/taken"})
    answers: tuple[dict[str, Any], ...] = (
        {"values": {"sum": 5}, "result": True},
        {"values": {"sum": 5}},
        {"result": True},
        {"values": "no", "result": False},
        {"values": {"reason": "no"}, "result": False},
        {"result": False},
        {"values": {"sum": "five"}, "result": True},
        {"values": {"total": 5}, "result": True},
        {"values": [5], "result": True},
        {"values": "text", "result": True},
    )
    for number, answer in enumerate(answers):
        a.say({"op": "call_service", "service": "/sum", "id": f"sum {number}", "args": {"a": number}})
        asked = b.hear_json()
        b.ask({"op": "service_response", "service": "/sum", "id": asked["id"], **answer})
        a.hear_until(f'"id":"sum {number}"')
    b.ask({"op": "service_response", "service": "/sum", "id": "another", "values": {}, "result": True})
    b.ask({"op": "service_response", "service": "/sum", "values": {}, "result": True})
    b.ask({"op": "service_response", "service": "/add", "id": "x", "values": {}, "result": True})
    a.say({"op": "call_service", "service": "/sum", "id": "late", "timeout": 0.05})
    asked = b.hear_json()
    a.hear()
    b.ask({"op": "service_response", "service": "/sum", "id": asked["id"], "values": {"sum": 1}})
    a.say({"op": "call_service", "service": "/sum", "id": "left alone"})
    b.hear()
    b.ask({"op": "unadvertise_service", "service": "/sum", "id": "end"})
    a.hear()
    b.ask({"op": "unadvertise_service", "service": "/sum"}, {"op": "unadvertise_service", "service": "/add"})


def _actions(transcript: Transcript, a: Wire, b: Wire) -> None:
    transcript.title("actions of the robot")
    goal = {"op": "send_action_goal", "action": "/dock", "action_type": FIBONACCI, "args": {"order": 3}}
    goals: tuple[dict[str, Any], ...] = (
        {"feedback": True},
        {},
        {"args": [3]},
        {"action": "dock", "fragment_size": 70},
        {"action": "/fall"},
        {"action": "/deny"},
        {"action": "/nothing"},
        {"action_type": "nothing/Nothing"},
        {"action_type": "std_msgs/String"},
        {"action_type": "tf2_msgs/LookupTransform"},
        {"args": {"order": "three"}},
        {"args": {"size": 3}},
        {"args": "three"},
    )
    for number, more in enumerate(goals):
        a.say({**goal, "id": f"goal {number}", **more})
        if "fragment_size" in more:
            a.hear_fragments()
        else:
            a.hear_until('"op":"action_result"')
        a.settle()
    a.say({**goal, "action": "/wait", "id": "held"})
    a.settle()
    a.ask({**goal, "action": "/wait", "id": "held"})
    a.ask({"op": "cancel_action_goal", "action": "/dock", "id": "held"})
    a.say({"op": "cancel_action_goal", "action": "/wait", "id": "held"})
    a.hear_until('"op":"action_result"')
    # Two goals have this id.
    a.say({"op": "cancel_action_goal", "action": "/wait", "id": "held"})
    a.hear_until('"op":"action_result"')
    a.ask({"op": "cancel_action_goal", "action": "/wait", "id": "another"})

    transcript.title("an action of a client")
    offered = {"op": "advertise_action", "action": "/fetch", "type": FIBONACCI}
    b.ask({**offered, "type": "tf2_msgs/LookupTransform"}, offered, offered, {**offered, "action": "/dock"})
    b.ask({"op": "unadvertise_action", "action": "/dock"})
    results: tuple[dict[str, Any], ...] = (
        {"values": {"sequence": [1]}, "status": 4, "result": True},
        {"values": {"sequence": [1]}, "status": 6, "result": True},
        {"values": {"sequence": [1]}, "status": 5, "result": True},
        {"values": {"sequence": [1]}},
        {"values": "could not", "status": 6, "result": False},
        {"values": {"sequence": "one"}, "status": 4, "result": True},
        {"values": {"order": 1}, "status": 4, "result": True},
    )
    for number, answer in enumerate(results):
        sent = {**goal, "action": "/fetch", "id": f"fetch {number}", "feedback": True}
        a.say(sent)
        asked = b.hear_json()
        about = {"action": "/fetch", "id": asked["id"]}
        if number == 0:
            b.ask({"op": "action_feedback", **about, "values": {"sequence": [number]}})
            a.hear_until('"op":"action_feedback"')
            b.ask({"op": "action_feedback", **about, "values": {"sequence": "x"}})
            b.ask({"op": "action_feedback", "action": "/fetch", "id": "another", "values": {}})
            b.ask({"op": "action_feedback", "action": "/dock", "id": "another", "values": {}})
        if number == 2:
            a.say({"op": "cancel_action_goal", "action": "/fetch", "id": sent["id"]})
            b.hear()
        b.ask({"op": "action_result", **about, **answer})
        a.hear_until('"op":"action_result"')
        a.settle()
    b.ask({"op": "action_result", "action": "/fetch", "id": "another", "values": {}})
    b.ask({"op": "action_result", "action": "/dock", "id": "another", "values": {}})
    a.say({**goal, "action": "/fetch", "id": "left alone"})
    b.hear()
    b.ask({"op": "unadvertise_action", "action": "/fetch", "id": "end"})
    a.hear_until('"op":"action_result"')
    b.ask({"op": "unadvertise_action", "action": "/fetch"}, {"op": "unadvertise_action", "action": "/dock"})


def _fragments(transcript: Transcript, a: Wire) -> None:
    transcript.title("fragments of a client")
    text = '{"op":"unsubscribe","topic":"/whole","id":"whole"}'
    pieces = [text[:10], text[10:30], text[30:]]

    def piece(name: str, num: int, total: int = 3) -> dict[str, Any]:
        data = pieces[num] if 0 <= num < 3 else ""
        return {"op": "fragment", "id": name, "data": data, "num": num, "total": total}

    a.ask(*(piece("ordered", number) for number in (0, 1, 2)))
    a.ask(*(piece("any order", number) for number in (2, 0, 1)))
    a.ask(piece("twice", 0), piece("twice", 0), piece("twice", 1, 4), piece("out", 3), piece("out", -1))
    a.ask(piece("none", 0, 0), {"op": "fragment", "id": "broken", "data": "{", "num": 0, "total": 1})
    a.ask({"op": "fragment", "id": "nested", "data": json.dumps(piece("n", 0)), "num": 0, "total": 1})
    a.ask(*(piece(f"open {number}", 0) for number in range(17)))
    transcript.title("PNG of a client")
    a.ask({"op": "png", "id": "png", "data": "!!!"}, {"op": "png", "data": "AAAA"}, {"op": "png"})


def _rosapi(transcript: Transcript, a: Wire) -> None:
    transcript.title("rosapi")
    for service, args in (
        ("topics", {}),
        ("interfaces", {}),
        ("services", {}),
        ("nodes", {}),
        ("action_servers", {}),
        ("get_param_names", {}),
        ("get_ros_version", {}),
        ("topic_type", {"topic": "/map_name"}),
        ("topic_type", {"topic": "/nothing"}),
        ("topics_for_type", {"type": "std_msgs/String"}),
        ("topics_and_raw_types", {}),
        ("services_for_type", {"type": "std_srvs/Trigger"}),
        ("service_type", {"service": "/add"}),
        ("service_type", {"service": "/nothing"}),
        ("service_node", {"service": "/add"}),
        ("service_host", {"service": "/add"}),
        ("service_providers", {"service": "/add"}),
        ("service_request_details", {"type": ADD}),
        ("service_response_details", {"type": ADD}),
        ("service_request_details", {"type": "nothing/Nothing"}),
        ("action_type", {"action": "/dock"}),
        ("action_goal_details", {"type": FIBONACCI}),
        ("action_result_details", {"type": FIBONACCI}),
        ("action_feedback_details", {"type": FIBONACCI}),
        ("node_details", {"node": "/lab"}),
        ("publishers", {"topic": "/map_name"}),
        ("subscribers", {"topic": "/cmd_vel"}),
        ("message_details", {"type": "geometry_msgs/Twist"}),
        ("message_details", {"type": "nothing/Nothing"}),
        ("search_param", {"name": "max_speed"}),
        ("delete_param", {"name": "/lab:label"}),
        ("delete_param", {"name": "/lab:nothing"}),
        ("nothing", {}),
    ):
        a.say({"op": "call_service", "id": f"{service}", "service": f"/rosapi/{service}", "args": args})
        a.hear_until('"op":"service_response"')
        a.settle()


def _refusals(transcript: Transcript, wire: Wire) -> None:
    transcript.title("frames that are no messages")
    wire.ask(*_BAD_FRAMES)
    transcript.title("members that are missing or wrong, op by op")
    for op, members in _OPS.items():
        for name, right in members.items():
            wire.ask({"op": op, "id": op, **{key: value for key, value in members.items() if key != name}})
            one = ("word" if not isinstance(right, str) else 42,)
            for value in _WRONG_VALUES if (op, name) in _OF_EACH_TYPE else one:
                wire.ask({"op": op, "id": op, **members, name: value})
        wire.ask({"op": op, "id": op, **members, "unknown": 1})
    wire.ask({"op": "set_level", "level": "info"})
    transcript.title("messages that do not fit")
    for number, (type, message) in enumerate(_BAD_MESSAGES):
        wire.ask({"op": "publish", "id": number, "topic": f"/bad{number}", "msg": message, "type": type})
    for type in _BAD_TYPES:
        wire.ask({"op": "publish", "topic": "/bad", "msg": {}, "type": type})
        wire.ask({"op": "subscribe", "topic": "/bad", "type": type})
    wire.ask({"op": "publish", "topic": "/cmd_vel", "msg": {"linear": {"x": "fast"}}})
    wire.ask({"op": "publish", "topic": "/cmd_vel", "type": "std_msgs/String", "msg": {"data": "x"}})
    wire.ask({"op": "subscribe", "topic": "/cmd_vel", "type": "std_msgs/String"})
    wire.ask({"op": "subscribe", "topic": "/unknown"}, {"op": "publish", "topic": "/unknown", "msg": {}})
    transcript.title("names")
    for name in _NAMES:
        wire.ask({"op": "advertise", "id": "n", "topic": name, "type": "std_msgs/String"})
    for name in ("relative", "a b"):
        wire.ask({"op": "subscribe", "id": "n", "topic": name, "type": "std_msgs/String"})
        wire.ask({"op": "publish", "id": "n", "topic": name, "type": "std_msgs/String"})
        wire.ask({"op": "advertise_service", "id": "n", "service": name, "type": "std_srvs/Trigger"})
        wire.ask({"op": "advertise_action", "id": "n", "action": name, "type": FIBONACCI})
    wire.ask({"op": "call_service", "id": "n", "service": "a b"})
    wire.ask({"op": "send_action_goal", "id": "n", "action": "a b", "action_type": FIBONACCI})
    transcript.title("levels")
    for level in ("warning", "error", "none"):
        wire.ask({"op": "set_level", "level": level})
        wire.ask({"op": "unsubscribe", "topic": "/no"}, {"op": "fly"}, {"op": "publish", "topic": "/no"})


def encodings(transcript: Transcript) -> None:
    """Record the binary encodings."""
    with (
        serving("--script", str(ROBOT)) as url,
        Wire(transcript, "a", url) as a,
        Wire(transcript, "b", url) as b,
    ):
        a.ask({"op": "set_level", "level": "info"})
        for compression in ("cbor", "cbor-raw", "png", "none"):
            transcript.title(compression)
            b.say({"op": "subscribe", "topic": "/map_name", "compression": compression})
            b.hear()
            for topic in ("/blob", "/pose"):
                b.ask({"op": "subscribe", "topic": topic, "compression": compression})
                _tell(a, f"{NEXT}{topic}")
                b.hear()
            b.ask({"op": "subscribe", "topic": "/cmd_vel", "compression": compression})
            a.ask({"op": "publish", "topic": "/cmd_vel", "msg": {"angular": {"z": 1.5}}})
            b.hear()
            for topic in ("/map_name", "/blob", "/pose", "/cmd_vel"):
                b.ask({"op": "unsubscribe", "topic": topic})
            _tell(a, "/rwt_script/reset")
        transcript.title("CBOR of a client")
        a.ask(
            *map(
                cbor2.dumps,
                (
                    {"op": "unsubscribe", "topic": "/x", "id": 7},
                    {"op": "advertise", "topic": "/c", "type": "std_msgs/Float64"},
                    {"op": "publish", "topic": "/c", "msg": {"data": float("inf")}, "id": "inf"},
                    {"op": "publish", "topic": "/c", "msg": {"data": b"bytes"}, "id": "bytes"},
                    {"op": "publish", "topic": "/c", "msg": {"data": 2**70}, "id": "big"},
                    {"op": "publish", "topic": "/c", "msg": {1: 2}, "id": "key"},
                    {"op": "call_service", "service": "/none", "id": 1},
                    {"op": b"publish"},
                    {"no": "op"},
                    [1, 2],
                    "text",
                    42,
                    None,
                ),
            )
        )
        a.ask(bytes.fromhex("a1626f70"), bytes.fromhex("bf"), bytes.fromhex("d9ffff00"), b"\x9f" * 200)


def bson_only(transcript: Transcript) -> None:
    """Record the mode in which all is BSON."""
    with (
        serving("--script", str(ROBOT), "--set", "bson_only_mode=true") as url,
        Wire(transcript, "a", url, encode=bson.encode) as a,
        Wire(transcript, "b", url, encode=bson.encode) as b,
    ):
        a.ask(
            {"op": "set_level", "level": "info", "id": "level"},
            {"op": "call_service", "id": "c", "service": "/nothing"},
            {"op": "advertise", "topic": "/c", "type": "std_msgs/UInt8MultiArray", "id": "ad"},
            {"op": "publish", "topic": "/c", "msg": {"data": 1}, "id": "bad"},
            {"op": 1},
        )
        for topic in ("/blob", "/pose"):
            b.ask({"op": "subscribe", "topic": topic})
            _tell(a, f"{NEXT}{topic}")
            b.hear()
        a.ask(b"", b"\x05\x00\x00\x00", b"\x10\x00\x00\x00\x02a", b"nonsense")
        a.ask('{"op":"call_service","id":"text","service":"/nothing"}')


def _tell(wire: Wire, service: str) -> None:
    wire.say({"op": "call_service", "id": "told", "service": service})
    wire.hear()


def profile(transcript: Transcript) -> None:
    """Record an op and a member that a profile lacks."""
    with (
        serving("--script", str(ROBOT), "--set", "profile=ros1") as url,
        Wire(transcript, "a", url) as a,
    ):
        a.ask({"op": "advertise_action", "id": "op", "action": "/t", "type": FIBONACCI})
        a.ask({"op": "subscribe", "id": "member", "topic": "/v", "type": "std_msgs/Bool", "qos": 1})


def formats(transcript: Transcript) -> None:
    """Record the encodings and a profile."""
    encodings(transcript)
    transcript.title("BSON")
    bson_only(transcript)
    transcript.title("profile ros1")
    profile(transcript)


SESSIONS: Final[dict[str, Session]] = {
    "rosbridge": partial(session, distro="jazzy"),
    "rosbridge.noetic": partial(session, distro="noetic"),
    "rosbridge.encodings": formats,
}
