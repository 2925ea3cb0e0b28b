"""The faults that the suite has to find, each with the cases that ask about it."""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Callable
from functools import partial

from rosbridge_conformance.suite.values import Json
from tests.conformance.faults import Alter, Fault, Memory, Message, drop, on, put, twice, without

Change = Callable[[str, Json], Json]
"""Alters a value inside a payload, of a key."""


def _in_payload(op: str, key: str, change: Change) -> Alter:
    """Alter every value inside the payload of an op, leaves first; `change` gets the value's key too."""

    def walk(name: str, value: Json) -> Json:
        if isinstance(value, dict):
            return change(name, {inner: walk(inner, item) for inner, item in value.items()})
        if isinstance(value, list):
            return change(name, [walk(name, item) for item in value])
        return change(name, value)

    return on(op, lambda message: {**message, key: walk("", message.get(key))})


def _message(change: Change) -> Alter:
    return _in_payload("publish", "msg", change)


def _values(change: Change) -> Alter:
    return _in_payload("service_response", "values", change)


def _reply(change: Callable[[Message], Message | None]) -> Alter:
    return on("service_response", change)


def _call(change: Callable[[Message], Message | None]) -> Alter:
    return on("call_service", change)


def _every_third_lost(message: Message, memory: Memory) -> list[Message] | None:
    if message.get("op") != "publish":
        return None
    seen = memory.here.get("seen", 0)
    memory.here["seen"] = int(seen) + 1 if isinstance(seen, int) else 0
    return [] if memory.here["seen"] == 3 else [message]


def _pairs_swapped(message: Message, memory: Memory) -> list[Message] | None:
    if message.get("op") != "publish" or "probe" in str(message.get("topic")):
        return None
    held = memory.here.pop("held", None)
    if isinstance(held, dict):
        return [message, held]
    memory.here["held"] = message
    return []


def _feedback_late(message: Message, memory: Memory) -> list[Message] | None:
    if message.get("op") == "action_feedback":
        memory.here["held"] = message
        return []
    held = memory.here.pop("held", None)
    if message.get("op") == "action_result" and isinstance(held, dict):
        return [message, held]
    return None


def _arrival_order(message: Message, memory: Memory) -> list[Message] | None:
    if message.get("op") != "fragment":
        return None
    key = f"num {message.get('id')}"
    num = memory.here.get(key, 0)
    memory.here[key] = int(num) + 1 if isinstance(num, int) else 1
    return [{**message, "num": num}]


def _shared_lists(message: Message, memory: Memory) -> list[Message] | None:
    """Fragments of all connections in one table."""
    num, total, text = message.get("num"), message.get("total"), message.get("data")
    if message.get("op") != "fragment" or not isinstance(num, int) or not isinstance(total, int):
        return None
    pieces = memory.server.setdefault(str(message.get("id")), {})
    if not isinstance(pieces, dict):
        return None
    pieces[str(num)] = text
    if len(pieces) < total:
        return []
    whole = "".join(str(pieces[str(index)]) for index in range(total) if str(index) in pieces)
    return [{"op": "fragment", "id": "whole", "num": 0, "total": 1, "data": whole}]


def _sticky_fragments(message: Message, memory: Memory) -> list[Message] | None:
    size = message.get("fragment_size")
    if isinstance(size, int):
        memory.here["size"] = size
    if message.get("op") in ("subscribe", "call_service") and "size" in memory.here:
        return [{**message, "fragment_size": memory.here["size"]}]
    return None


def _first_throttle(message: Message, memory: Memory) -> list[Message] | None:
    if message.get("op") != "subscribe":
        return None
    first = memory.here.setdefault(f"rate {message.get('topic')}", message.get("throttle_rate", 0))
    return [{**message, "throttle_rate": first}]


def _one_subscription_id(message: Message, memory: Memory) -> list[Message] | None:
    """A table of subscriptions without ids: the last wish counts for all."""
    if message.get("op") not in ("subscribe", "unsubscribe"):
        return None
    return [{key: value for key, value in message.items() if key != "id"}]


def _success_told(message: Message, memory: Memory) -> list[Message] | None:
    if message.get("op") != "publish":
        return None
    return [{"op": "status", "level": "info", "msg": "delivered"}, message]


def _texts(change: Callable[[str], Json]) -> Change:
    return lambda key, value: change(value) if isinstance(value, str) else value


def _objects(change: Callable[[Message], Json]) -> Change:
    return lambda key, value: change(value) if isinstance(value, dict) else value


def _renamed(**names: str) -> Change:
    return _objects(lambda value: {names.get(key, key): item for key, item in value.items()})


_ROS_1_TIMES = _renamed(sec="secs", nanosec="nsecs")
_ROS_2_TIMES = _renamed(secs="sec", nsecs="nanosec")


def _bytes_listed(key: str, value: Json) -> Json:
    if key != "data" or not isinstance(value, str) or not value:
        return value
    try:
        return list(base64.b64decode(value, validate=True))
    except binascii.Error:
        return value


def _option(key: str, change: Callable[[int], int]) -> Alter:
    """Alter a number of subscriptions, where it is given."""

    def alter(message: Message) -> Message:
        number = message.get(key)
        return {**message, key: change(number)} if isinstance(number, int) and number > 0 else message

    return on("subscribe", alter)


def _slash(key: str) -> Callable[[Message], Message]:
    return lambda message: {**message, key: f"/{str(message.get(key)).lstrip('/')}"}


def _failed(change: Callable[[Message], Message]) -> Alter:
    return _reply(lambda message: message if message.get("result") else change(message))


def _fragment(change: Callable[[Message], Message]) -> Alter:
    return on("fragment", change)


def _number(message: Message, key: str) -> int:
    value = message.get(key)
    return value if isinstance(value, int) else 0


def _two_parts(key: str, value: Json) -> Json:
    return value.replace("/msg/", "/").replace("/srv/", "/") if isinstance(value, str) else value


def _raw_keys(data: bytes) -> bytes:
    return data.replace(b"\x64secs", b"\x63sec").replace(b"\x65nsecs", b"\x67nanosec")


def _integers_as(change: Callable[[int], Json]) -> Change:
    return lambda key, value: (
        change(value) if isinstance(value, int) and not isinstance(value, bool) else value
    )


def _bytes(old: bytes, new: bytes) -> Callable[[bytes], bytes]:
    return lambda data: data.replace(old, new)


def _no_extra(value: Json) -> Json:
    known = {"x", "y", "z", "linear", "angular", "data", "points", "layout"}
    return {key: item for key, item in value.items() if key in known} if isinstance(value, dict) else value


def _plain_value(message: Message, kinds: type = str) -> Message:
    values = message.get("values")
    if not str(message.get("service")).endswith("get_param") or not isinstance(values, dict):
        return message
    value = json.loads(str(values["value"]))
    return {**message, "values": {**values, "value": str(value)}} if isinstance(value, kinds) else message


_throttle, _queue = partial(_option, "throttle_rate"), partial(_option, "queue_length")


def _says(name: str, cases: str, alter: Alter, ros: int = 2) -> Fault:
    return Fault(name, tuple(cases.split()), says=alter, ros=ros)


def _hears(name: str, cases: str, alter: Alter) -> Fault:
    return Fault(name, tuple(cases.split()), hears=alter)


def _says_bytes(name: str, cases: str, alter: Callable[[bytes], bytes]) -> Fault:
    return Fault(name, tuple(cases.split()), says_bytes=alter)


_REPLIES = (
    _says("loses the id of replies", "SRV-01 ENV-02", without("service_response", "id")),
    _says(
        "turns the id of replies into text",
        "ENV-02 SRV-01",
        _reply(lambda m: {**m, "id": str(m["id"])} if "id" in m else m),
    ),
    _says("gives replies without id the id null", "SRV-01", _reply(lambda m: {"id": None, **m})),
    _says("names the service as resolved", "services/name-as-written", _reply(_slash("service"))),
    _says("reports failures as success", "SRV-04 SRV-05", _failed(lambda m: {**m, "result": True})),
    _says("says nothing about failures", "SRV-05", _failed(lambda m: {**m, "values": ""})),
    _says(
        "puts failures into an object",
        "SRV-05",
        _failed(lambda m: {**m, "values": {"error": m.get("values")}}),
    ),
    _says("leaves out empty values", "JSN-09", _reply(lambda m: {k: v for k, v in m.items() if v != {}})),
    _says("answers twice", "SRV-14", twice("service_response")),
    _says(
        "never answers calls to unknown services",
        "SRV-04",
        drop("service_response", lambda m: not m.get("result")),
    ),
    _says("asks providers without args", "SVP-02", _call(lambda m: {k: v for k, v in m.items() if v != {}})),
    _says("asks providers without id", "SVP-02", without("call_service", "id")),
    _says("asks providers under one id", "SVP-02", put("call_service", id="request")),
    _says(
        "calls the args of a request data",
        "SVP-01",
        _call(lambda m: {("data" if k == "args" else k): v for k, v in m.items()}),
    ),
    _hears(
        "reverses positional arguments",
        "SRV-02",
        _call(lambda m: {**m, "args": list(reversed(a))} if isinstance(a := m.get("args"), list) else m),
    ),
    _hears(
        "ignores positional arguments",
        "SRV-02",
        _call(lambda m: {**m, "args": {}} if isinstance(m.get("args"), list) else m),
    ),
    _hears("needs args", "SRV-02", drop("call_service", lambda m: "args" not in m)),
    _hears("ignores the timeout of calls", "SRV-10", without("call_service", "timeout")),
    _hears(
        "takes timeouts for milliseconds",
        "services/timeout*",
        _call(lambda m: {**m, "timeout": t / 1000} if isinstance(t := m.get("timeout"), int | float) else m),
    ),
    _hears(
        "does not know the legacy #id",
        "SRV-09",
        _call(lambda m: {**m, "service": str(m.get("service")).partition("#")[0]}),
    ),
    _hears(
        "does not resolve relative service names",
        "SRV-12",
        drop("call_service", lambda m: not str(m.get("service")).startswith("/")),
    ),
    _hears(
        "takes a provider's failure for success",
        "SVP-04",
        _reply(
            lambda m: (
                m
                if m.get("result")
                else {**m, "result": True, "values": m["values"] if isinstance(m.get("values"), dict) else {}}
            )
        ),
    ),
    _hears("refuses answers without values", "SVP-05", drop("service_response", lambda m: "values" not in m)),
    _hears(
        "refuses answers whose values are text",
        "SVP-05",
        drop("service_response", lambda m: isinstance(m.get("values"), str)),
    ),
    _hears("does not withdraw services", "SVP-09", drop("unadvertise_service")),
)

_TOPICS = (
    _says("delivers with an id", "PUB-10", put("publish", id="p")),
    _says("delivers with a type", "PUB-10", put("publish", type="std_msgs/String")),
    _says("names the topic as resolved", "PUB-09", on("publish", _slash("topic"))),
    _says("delivers twice", "PUB-01 SUB-04", twice("publish")),
    _says("loses every third message", "PUB-11", _every_third_lost),
    _says("swaps messages", "PUB-11", _pairs_swapped),
    _hears("ignores throttle_rate", "THR-02", without("subscribe", "throttle_rate")),
    _hears("takes throttle_rate for seconds", "THR-09", _throttle(lambda rate: rate * 1000)),
    _hears("throttles a little too much", "THR-02 THR-03", _throttle(lambda rate: rate * 2)),
    _hears("throttles a little too little", "THR-02 THR-03", _throttle(lambda rate: rate // 2)),
    _hears("follows the first throttle_rate", "SUB-05 SUB-09", _first_throttle),
    _hears("ignores queue_length", "THR-03", without("subscribe", "queue_length")),
    _hears("queues one too many", "THR-03 THR-05", _queue(lambda length: length + 1)),
    _hears("queues one too few", "THR-03 THR-05", _queue(lambda length: length - 1)),
    _hears("ends all subscriptions at once", "UNS-01", without("unsubscribe", "id")),
    _hears("never unsubscribes", "UNS-01 UNS-03", drop("unsubscribe")),
    _hears("needs an id to unsubscribe", "UNS-04", drop("unsubscribe", lambda m: "id" not in m)),
    _hears("keeps one subscription for all ids", "SUB-05 UNS-01", _one_subscription_id),
    _hears("needs a type to subscribe", "SUB-01", drop("subscribe", lambda m: "type" not in m)),
    _hears("ignores the type of subscribe", "SUB-02", without("subscribe", "type")),
    _hears(
        "refuses unknown compressions", "SUB-10", drop("subscribe", lambda m: m.get("compression") == "zip")
    ),
    _hears("refuses null options", "SUB-11", drop("subscribe", lambda m: None in m.values())),
    _hears("ignores latch", "SUB-13 ADV-07", without("advertise", "latch")),
    _hears("refuses latch and queue_size", "ADV-06", drop("advertise", lambda m: "queue_size" in m)),
    _hears("refuses publish without msg", "PUB-04", drop("publish", lambda m: "msg" not in m)),
    _hears(
        "takes any op in capitals",
        "ENV-05",
        lambda m, _: [{**m, "op": str(m["op"]).lower()}] if "op" in m else None,
    ),
    _hears("refuses extra keys", "ENV-01", lambda m, _: [] if "colour" in m else None),
    _hears(
        "dies of the key png",
        "ENV-13",
        lambda m, memory: (
            []
            if memory.here.setdefault("dead", "png" in m)
            or (memory.here.update(dead="png" in m) or "png" in m)
            else None
        ),
    ),
    _hears(
        "takes rosbridge v1 messages",
        "ENV-04",
        lambda m, _: (
            [{"op": "publish", "topic": m["receiver"], "msg": m["msg"]}] if "receiver" in m else None
        ),
    ),
)

_CONVERSION = (
    _says("sends bytes as lists", "JSN-01", _message(_bytes_listed)),
    _says("sends base64 without padding", "JSN-01", _message(_texts(lambda v: v.rstrip("=")))),
    _says(
        "sends large integers as text",
        "JSN-06",
        _message(_integers_as(lambda n: str(n) if abs(n) > 2**53 else n)),
    ),
    _says("sends integers as floats", "JSN-24 JSN-03", _message(_integers_as(float))),
    _says("sends NaN as text", "JSN-04", _message(lambda k, v: "NaN" if v is None else v)),
    _says(
        "sends booleans as integers", "JSN-07", _message(lambda k, v: int(v) if isinstance(v, bool) else v)
    ),
    _says(
        "leaves out fields of zero",
        "JSN-08",
        _message(_objects(lambda v: {n: i for n, i in v.items() if i != 0 or isinstance(i, bool)})),
    ),
    _says("spells times as ROS 1 does", "JSN-05", _message(_ROS_1_TIMES)),
    _says("spells times as ROS 2 does", "JSN-05", _message(_ROS_2_TIMES), ros=1),
    _says(
        "keeps seq in ROS 2 headers",
        "JSN-08",
        _message(lambda k, v: {"seq": 0, **v} if k == "header" and isinstance(v, dict) else v),
    ),
    _says(
        "leaves stamps at zero",
        "PUB-05",
        _message(lambda k, v: {"sec": 0, "nanosec": 0} if k == "stamp" else v),
    ),
    _says(
        "loses text outside ASCII",
        "JSN-32",
        _message(_texts(lambda v: v.encode("ascii", "replace").decode())),
    ),
    _hears(
        "truncates floats for integers",
        "JSN-22",
        _message(lambda k, v: int(v) if isinstance(v, float) else v),
    ),
    _hears(
        "takes booleans for integers", "JSN-22", _message(lambda k, v: int(v) if isinstance(v, bool) else v)
    ),
    _hears(
        "takes null for a default",
        "JSN-23",
        _message(_objects(lambda v: {n: i for n, i in v.items() if i is not None})),
    ),
    _hears("wraps bytes around", "JSN-24", _message(_integers_as(lambda n: n % 256 if n < 1000 else n))),
    _hears("skips unknown fields", "JSN-25", on("publish", lambda m: {**m, "msg": _no_extra(m.get("msg"))})),
    _hears(
        "publishes the fields that fit",
        "PUB-03",
        _message(lambda k, v: 0 if k in ("x", "y", "z") and isinstance(v, str) else v),
    ),
    _hears("does not know now", "JSN-28", _message(lambda k, v: {} if v == "now" else v)),
    _hears(
        "does not know secs and nsecs",
        "JSN-27",
        _message(_objects(lambda v: {n: i for n, i in v.items() if n not in ("secs", "nsecs")})),
    ),
    _hears(
        "takes no base64",
        "JSN-20",
        drop(
            "publish",
            lambda m: (
                isinstance(b := m.get("msg"), dict) and "layout" in b and isinstance(b.get("data"), str)
            ),
        ),
    ),
)

_WRAPPINGS = (
    _hears("joins fragments in arrival order", "FRG-01", _arrival_order),
    _hears(
        "counts incoming fragments from one",
        "FRG-01 FRG-02",
        _fragment(lambda m: {**m, "num": _number(m, "num") - 1}),
    ),
    _hears("keeps one table of fragments", "FRG-08", _shared_lists),
    _says("sends a float total", "FRG-23", _fragment(lambda m: {**m, "total": _number(m, "total") + 0.5})),
    _says("sends fragments under the id 0", "FRG-24", put("fragment", id=0)),
    _says("sends all fragments under one id", "FRG-24", put("fragment", id="f")),
    _says(
        "counts sent fragments from one",
        "FRG-20 FRG-21",
        _fragment(lambda m: {**m, "num": _number(m, "num") + 1}),
    ),
    _says(
        "sends fragments in reversed order",
        "FRG-28",
        _fragment(lambda m: {**m, "num": _number(m, "total") - 1 - _number(m, "num")}),
    ),
    _says(
        "announces a fragment too many",
        "FRG-20",
        _fragment(lambda m: {**m, "total": _number(m, "total") + 1}),
    ),
    _hears("never cuts messages", "FRG-20", without("subscribe", "fragment_size")),
    _hears("keeps fragment_size for the connection", "FRG-20", _sticky_fragments),
    _says(
        "breaks the lines of base64 pictures",
        "PNG-04",
        on("png", lambda m: {**m, "data": f"{str(m['data'])[:40]}\n{str(m['data'])[40:]}"}),
    ),
    _says("numbers pictures", "FRG-26 PNG-01", put("png", num=0, total=1)),
    _hears("ignores compression", "CBR-01 PNG-01", without("subscribe", "compression")),
    _says_bytes("says that float32 are big-endian", "CBR-02", _bytes(b"\xd8\x55", b"\xd8\x51")),
    _says_bytes("tags int16 as uint16", "CBR-02", _bytes(b"\xd8\x4d", b"\xd8\x45")),
    _says_bytes("tags byte strings", "CBR-03", _bytes(b"\x64data\x44", b"\x64data\xd8\x40\x44")),
    _says_bytes("spells the keys of cbor-raw as ROS 2 does", "CBR-10", _raw_keys),
    _says_bytes("writes a big-endian CDR header", "CBR-11", _bytes(b"\x00\x01\x00\x00", b"\x00\x00\x00\x00")),
    _says_bytes("sends maps of unknown length", "CBR-01 CBR-08", lambda data: b"\xbf" + data[1:] + b"\xff"),
)

_ACTIONS = (
    _says("calls every outcome a success", "ACT-03 ACT-15", put("action_result", status=4)),
    _says(
        "reports an aborted goal as not run",
        "ACT-03",
        on("action_result", lambda m: {**m, "result": m.get("status") == 4}),
    ),
    _says(
        "sends the status as text",
        "ACT-03",
        on("action_result", lambda m: {**m, "status": str(m.get("status"))}),
    ),
    _says("loses the id of results", "ACT-01", without("action_result", "id")),
    _says("loses the id of feedback", "ACT-02", without("action_feedback", "id")),
    _says("sends feedback twice", "ACT-02", twice("action_feedback")),
    _says("sends feedback after the result", "ACT-06", _feedback_late),
    _hears("sends feedback to all", "ACT-02", put("send_action_goal", feedback=True)),
    _hears("sends feedback to nobody", "ACT-02", put("send_action_goal", feedback=False)),
    _hears("ignores cancels", "ACT-07", drop("cancel_action_goal")),
    _hears("refuses results without status", "ACT-16", drop("action_result", lambda m: "status" not in m)),
    _hears(
        "does not check the type of goals",
        "ACT-04",
        put("send_action_goal", action_type="example_interfaces/Fibonacci"),
    ),
    _says("sends goals without feedback wish", "ACT-12", without("send_action_goal", "feedback")),
    _says("sends cancels without action", "ACT-13", without("cancel_action_goal", "action")),
)

_REST = (
    _says("loses the id of status", "STA-03", without("status", "id")),
    _says("calls every status a warning", "STA-04 STA-03", put("status", level="warning")),
    _says("sends empty status", "STA-03", put("status", msg="")),
    _says("tells of success unasked", "STA-05", _success_told),
    _says("tells clients without status of success", "status/unsolicited", _success_told),
    _says("gives text parameters as plain text", "API-07", _reply(_plain_value)),
    _says("gives text parameters as plain text, ROS 1", "API-07", _reply(_plain_value), ros=1),
    _says(
        "gives parameters as Python prints them",
        "rosapi/param-boolean-json-ros2",
        _reply(partial(_plain_value, kinds=bool)),
    ),
    _hears(
        "ignores set_level none",
        "STA-02",
        on("set_level", lambda m: {**m, "level": "info"} if m.get("level") == "none" else m),
    ),
    _says(
        "mixes up the types of topics",
        "API-02",
        _reply(
            lambda m: (
                {**m, "values": {**v, "types": ["x"] * 3}}
                if isinstance(v := m.get("values"), dict) and "types" in v
                else m
            )
        ),
    ),
    _says("reports types in two parts on ROS 2", "API-02", _values(_two_parts)),
    _says("gives the time as ROS 1 does", "API-11", _values(_ROS_1_TIMES)),
    _says(
        "calls lists scalars", "API-03", _values(lambda k, v: -1 if k == "fieldarraylen" and v == 0 else v)
    ),
    _says(
        "gives nested types first",
        "API-03",
        _values(lambda k, v: list(reversed(v)) if k == "typedefs" and isinstance(v, list) else v),
    ),
    _says(
        "answers null for unknown types",
        "API-02",
        _values(lambda k, v: None if k == "type" and v == "" else v),
    ),
    _says(
        "separates full texts by 79 signs", "API-06", _values(_texts(lambda v: v.replace("=" * 80, "=" * 79)))
    ),
)

FAULTS = (*_REPLIES, *_TOPICS, *_CONVERSION, *_WRAPPINGS, *_ACTIONS, *_REST)
"""All faults."""
