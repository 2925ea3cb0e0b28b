"""The faults that the suite has to find, each with the cases that ask about it."""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Callable
from functools import partial

from rosbridge_conformance.suite.values import Json
from tests.conformance.faults import Alter, Fault, Memory, Message


def _on(op: str, change: Callable[[Message], Message | None]) -> Alter:
    """Alter messages of one op; None drops them."""

    def alter(message: Message, memory: Memory) -> list[Message] | None:
        if message.get("op") != op:
            return None
        changed = change(dict(message))
        return [] if changed is None else [changed]

    return alter


def _put(op: str, **fields: Json) -> Alter:
    return _on(op, lambda message: {**message, **fields})


def _without(op: str, key: str) -> Alter:
    return _on(op, lambda message: {name: value for name, value in message.items() if name != key})


def _drop(op: str, when: Callable[[Message], bool]) -> Alter:
    return _on(op, lambda message: None if when(message) else message)


def _twice(op: str) -> Alter:
    return lambda message, memory: [message, message] if message.get("op") == op else None


def _in_payload(op: str, key: str, change: Callable[[str, Json], Json]) -> Alter:
    """Alter every value inside the payload of an op, leaves first; `change` gets the value's key too."""

    def walk(name: str, value: Json) -> Json:
        if isinstance(value, dict):
            return change(name, {inner: walk(inner, item) for inner, item in value.items()})
        if isinstance(value, list):
            return change(name, [walk(name, item) for item in value])
        return change(name, value)

    return _on(op, lambda message: {**message, key: walk("", message.get(key))})


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


def _rename(value: Json, names: dict[str, str]) -> Json:
    return {names.get(key, key): item for key, item in value.items()} if isinstance(value, dict) else value


def _bytes_listed(key: str, value: Json) -> Json:
    if key != "data" or not isinstance(value, str) or not value:
        return value
    try:
        return list(base64.b64decode(value, validate=True))
    except binascii.Error:
        return value


def _throttle(change: Callable[[int], int]) -> Alter:
    def alter(message: Message) -> Message:
        rate = message.get("throttle_rate")
        return {**message, "throttle_rate": change(rate)} if isinstance(rate, int) and rate > 0 else message

    return _on("subscribe", alter)


def _queue(change: Callable[[int], int]) -> Alter:
    def alter(message: Message) -> Message:
        length = message.get("queue_length")
        return {**message, "queue_length": change(length)} if isinstance(length, int) and length else message

    return _on("subscribe", alter)


def _slash(key: str) -> Callable[[Message], Message]:
    return lambda message: {**message, key: f"/{str(message.get(key)).lstrip('/')}"}


def _failed(change: Callable[[Message], Message]) -> Alter:
    return _on("service_response", lambda message: message if message.get("result") else change(message))


def _fragment(change: Callable[[Message], Message]) -> Alter:
    return _on("fragment", change)


def _number(message: Message, key: str) -> int:
    value = message.get(key)
    return value if isinstance(value, int) else 0


def _two_parts(key: str, value: Json) -> Json:
    return value.replace("/msg/", "/").replace("/srv/", "/") if isinstance(value, str) else value


def _raw_keys(data: bytes) -> bytes:
    return data.replace(b"\x64secs", b"\x63sec").replace(b"\x65nsecs", b"\x67nanosec")


def _integers_as(change: Callable[[int], Json]) -> Callable[[str, Json], Json]:
    return lambda key, value: (
        change(value) if isinstance(value, int) and not isinstance(value, bool) else value
    )


def _no_extra(value: Json) -> Json:
    known = {"x", "y", "z", "linear", "angular", "data", "points", "layout"}
    return {key: item for key, item in value.items() if key in known} if isinstance(value, dict) else value


def _plain_value(message: Message, kinds: type = str) -> Message:
    values = message.get("values")
    if not str(message.get("service")).endswith("get_param") or not isinstance(values, dict):
        return message
    value = json.loads(str(values["value"]))
    return {**message, "values": {**values, "value": str(value)}} if isinstance(value, kinds) else message


_REPLIES = (
    Fault("loses the id of replies", ("SRV-01", "ENV-02"), says=_without("service_response", "id")),
    Fault(
        "turns the id of replies into text",
        ("ENV-02", "SRV-01"),
        says=_on("service_response", lambda m: {**m, "id": str(m["id"])} if "id" in m else m),
    ),
    Fault(
        "gives replies without id the id null",
        ("SRV-01",),
        says=_on("service_response", lambda m: {"id": None, **m}),
    ),
    Fault(
        "names the service as resolved",
        ("services/name-as-written",),
        says=_on("service_response", _slash("service")),
    ),
    Fault("reports failures as success", ("SRV-04", "SRV-05"), says=_failed(lambda m: {**m, "result": True})),
    Fault("says nothing about failures", ("SRV-05",), says=_failed(lambda m: {**m, "values": ""})),
    Fault(
        "puts failures into an object",
        ("SRV-05",),
        says=_failed(lambda m: {**m, "values": {"error": m.get("values")}}),
    ),
    Fault(
        "leaves out empty values",
        ("JSN-09",),
        says=_on("service_response", lambda m: {k: v for k, v in m.items() if v != {}}),
    ),
    Fault("answers twice", ("SRV-14",), says=_twice("service_response")),
    Fault(
        "never answers calls to unknown services",
        ("SRV-04",),
        says=_drop("service_response", lambda m: not m.get("result")),
    ),
    Fault(
        "asks providers without args",
        ("SVP-02",),
        says=_on("call_service", lambda m: {k: v for k, v in m.items() if v != {}}),
    ),
    Fault("asks providers without id", ("SVP-02",), says=_without("call_service", "id")),
    Fault("asks providers under one id", ("SVP-02",), says=_put("call_service", id="request")),
    Fault(
        "calls the args of a request data",
        ("SVP-01",),
        says=_on("call_service", lambda m: {("data" if k == "args" else k): v for k, v in m.items()}),
    ),
    Fault(
        "reverses positional arguments",
        ("SRV-02",),
        hears=_on(
            "call_service",
            lambda m: {**m, "args": list(reversed(a))} if isinstance(a := m.get("args"), list) else m,
        ),
    ),
    Fault(
        "ignores positional arguments",
        ("SRV-02",),
        hears=_on("call_service", lambda m: {**m, "args": {}} if isinstance(m.get("args"), list) else m),
    ),
    Fault("needs args", ("SRV-02",), hears=_drop("call_service", lambda m: "args" not in m)),
    Fault("ignores the timeout of calls", ("SRV-10",), hears=_without("call_service", "timeout")),
    Fault(
        "takes timeouts for milliseconds",
        ("services/timeout*",),
        hears=_on(
            "call_service",
            lambda m: {**m, "timeout": t / 1000} if isinstance(t := m.get("timeout"), int | float) else m,
        ),
    ),
    Fault(
        "does not know the legacy #id",
        ("SRV-09",),
        hears=_on("call_service", lambda m: {**m, "service": str(m.get("service")).partition("#")[0]}),
    ),
    Fault(
        "does not resolve relative service names",
        ("SRV-12",),
        hears=_drop("call_service", lambda m: not str(m.get("service")).startswith("/")),
    ),
    Fault(
        "takes a provider's failure for success",
        ("SVP-04",),
        hears=_on(
            "service_response",
            lambda m: (
                m
                if m.get("result")
                else {**m, "result": True, "values": m["values"] if isinstance(m.get("values"), dict) else {}}
            ),
        ),
    ),
    Fault(
        "refuses answers without values",
        ("SVP-05",),
        hears=_drop("service_response", lambda m: "values" not in m),
    ),
    Fault(
        "refuses answers whose values are text",
        ("SVP-05",),
        hears=_drop("service_response", lambda m: isinstance(m.get("values"), str)),
    ),
    Fault("does not withdraw services", ("SVP-09",), hears=_drop("unadvertise_service", lambda m: True)),
)

_TOPICS = (
    Fault("delivers with an id", ("PUB-10",), says=_put("publish", id="p")),
    Fault("delivers with a type", ("PUB-10",), says=_put("publish", type="std_msgs/String")),
    Fault("names the topic as resolved", ("PUB-09",), says=_on("publish", _slash("topic"))),
    Fault("delivers twice", ("PUB-01", "SUB-04"), says=_twice("publish")),
    Fault("loses every third message", ("PUB-11",), says=_every_third_lost),
    Fault("swaps messages", ("PUB-11",), says=_pairs_swapped),
    Fault("ignores throttle_rate", ("THR-02",), hears=_without("subscribe", "throttle_rate")),
    Fault("takes throttle_rate for seconds", ("THR-09",), hears=_throttle(lambda rate: rate * 1000)),
    Fault("throttles a little too much", ("THR-02", "THR-03"), hears=_throttle(lambda rate: rate * 2)),
    Fault("throttles a little too little", ("THR-02", "THR-03"), hears=_throttle(lambda rate: rate // 2)),
    Fault("follows the first throttle_rate", ("SUB-05", "SUB-09"), hears=_first_throttle),
    Fault("ignores queue_length", ("THR-03",), hears=_without("subscribe", "queue_length")),
    Fault("queues one too many", ("THR-03", "THR-05"), hears=_queue(lambda length: length + 1)),
    Fault("queues one too few", ("THR-03", "THR-05"), hears=_queue(lambda length: length - 1)),
    Fault("ends all subscriptions at once", ("UNS-01",), hears=_without("unsubscribe", "id")),
    Fault("never unsubscribes", ("UNS-01", "UNS-03"), hears=_drop("unsubscribe", lambda m: True)),
    Fault("needs an id to unsubscribe", ("UNS-04",), hears=_drop("unsubscribe", lambda m: "id" not in m)),
    Fault("keeps one subscription for all ids", ("SUB-05", "UNS-01"), hears=_one_subscription_id),
    Fault("needs a type to subscribe", ("SUB-01",), hears=_drop("subscribe", lambda m: "type" not in m)),
    Fault("ignores the type of subscribe", ("SUB-02",), hears=_without("subscribe", "type")),
    Fault(
        "refuses unknown compressions",
        ("SUB-10",),
        hears=_drop("subscribe", lambda m: m.get("compression") == "zip"),
    ),
    Fault("refuses null options", ("SUB-11",), hears=_drop("subscribe", lambda m: None in m.values())),
    Fault("ignores latch", ("SUB-13", "ADV-07"), hears=_without("advertise", "latch")),
    Fault("refuses latch and queue_size", ("ADV-06",), hears=_drop("advertise", lambda m: "queue_size" in m)),
    Fault("refuses publish without msg", ("PUB-04",), hears=_drop("publish", lambda m: "msg" not in m)),
    Fault(
        "takes any op in capitals",
        ("ENV-05",),
        hears=lambda m, _: [{**m, "op": str(m["op"]).lower()}] if "op" in m else None,
    ),
    Fault("refuses extra keys", ("ENV-01",), hears=lambda m, _: [] if "colour" in m else None),
    Fault(
        "dies of the key png",
        ("ENV-13",),
        hears=lambda m, memory: (
            []
            if memory.here.setdefault("dead", "png" in m)
            or (memory.here.update(dead="png" in m) or "png" in m)
            else None
        ),
    ),
    Fault(
        "takes rosbridge v1 messages",
        ("ENV-04",),
        hears=lambda m, _: (
            [{"op": "publish", "topic": m["receiver"], "msg": m["msg"]}] if "receiver" in m else None
        ),
    ),
)

_CONVERSION = (
    Fault("sends bytes as lists", ("JSN-01",), says=_in_payload("publish", "msg", _bytes_listed)),
    Fault(
        "sends base64 without padding",
        ("JSN-01",),
        says=_in_payload("publish", "msg", lambda k, v: v.rstrip("=") if isinstance(v, str) else v),
    ),
    Fault(
        "sends large integers as text",
        ("JSN-06",),
        says=_in_payload("publish", "msg", _integers_as(lambda n: str(n) if abs(n) > 2**53 else n)),
    ),
    Fault(
        "sends integers as floats",
        ("JSN-24", "JSN-03"),
        says=_in_payload("publish", "msg", _integers_as(float)),
    ),
    Fault(
        "sends NaN as text",
        ("JSN-04",),
        says=_in_payload("publish", "msg", lambda k, v: "NaN" if v is None else v),
    ),
    Fault(
        "sends booleans as integers",
        ("JSN-07",),
        says=_in_payload("publish", "msg", lambda k, v: int(v) if isinstance(v, bool) else v),
    ),
    Fault(
        "leaves out fields of zero",
        ("JSN-08",),
        says=_in_payload(
            "publish",
            "msg",
            lambda k, v: (
                {n: i for n, i in v.items() if i != 0 or isinstance(i, bool)} if isinstance(v, dict) else v
            ),
        ),
    ),
    Fault(
        "spells times as ROS 1 does",
        ("JSN-05",),
        says=_in_payload("publish", "msg", lambda k, v: _rename(v, {"sec": "secs", "nanosec": "nsecs"})),
    ),
    Fault(
        "spells times as ROS 2 does",
        ("JSN-05",),
        says=_in_payload("publish", "msg", lambda k, v: _rename(v, {"secs": "sec", "nsecs": "nanosec"})),
        ros=1,
    ),
    Fault(
        "keeps seq in ROS 2 headers",
        ("JSN-08",),
        says=_in_payload(
            "publish", "msg", lambda k, v: {"seq": 0, **v} if k == "header" and isinstance(v, dict) else v
        ),
    ),
    Fault(
        "leaves stamps at zero",
        ("PUB-05",),
        says=_in_payload("publish", "msg", lambda k, v: {"sec": 0, "nanosec": 0} if k == "stamp" else v),
    ),
    Fault(
        "loses text outside ASCII",
        ("JSN-32",),
        says=_in_payload(
            "publish", "msg", lambda k, v: v.encode("ascii", "replace").decode() if isinstance(v, str) else v
        ),
    ),
    Fault(
        "truncates floats for integers",
        ("JSN-22",),
        hears=_in_payload("publish", "msg", lambda k, v: int(v) if isinstance(v, float) else v),
    ),
    Fault(
        "takes booleans for integers",
        ("JSN-22",),
        hears=_in_payload("publish", "msg", lambda k, v: int(v) if isinstance(v, bool) else v),
    ),
    Fault(
        "takes null for a default",
        ("JSN-23",),
        hears=_in_payload(
            "publish",
            "msg",
            lambda k, v: {n: i for n, i in v.items() if i is not None} if isinstance(v, dict) else v,
        ),
    ),
    Fault(
        "wraps bytes around",
        ("JSN-24",),
        hears=_in_payload("publish", "msg", _integers_as(lambda n: n % 256 if n < 1000 else n)),
    ),
    Fault(
        "skips unknown fields",
        ("JSN-25",),
        hears=_on("publish", lambda m: {**m, "msg": _no_extra(m.get("msg"))}),
    ),
    Fault(
        "publishes the fields that fit",
        ("PUB-03",),
        hears=_in_payload(
            "publish", "msg", lambda k, v: 0 if k in ("x", "y", "z") and isinstance(v, str) else v
        ),
    ),
    Fault(
        "does not know now",
        ("JSN-28",),
        hears=_in_payload("publish", "msg", lambda k, v: {} if v == "now" else v),
    ),
    Fault(
        "does not know secs and nsecs",
        ("JSN-27",),
        hears=_in_payload(
            "publish",
            "msg",
            lambda k, v: (
                {n: i for n, i in v.items() if n not in ("secs", "nsecs")} if isinstance(v, dict) else v
            ),
        ),
    ),
    Fault(
        "takes no base64",
        ("JSN-20",),
        hears=_drop(
            "publish",
            lambda m: (
                isinstance(b := m.get("msg"), dict) and "layout" in b and isinstance(b.get("data"), str)
            ),
        ),
    ),
)

_WRAPPINGS = (
    Fault("joins fragments in arrival order", ("FRG-01",), hears=_arrival_order),
    Fault(
        "counts incoming fragments from one",
        ("FRG-01", "FRG-02"),
        hears=_fragment(lambda m: {**m, "num": _number(m, "num") - 1}),
    ),
    Fault("keeps one table of fragments", ("FRG-08",), hears=_shared_lists),
    Fault(
        "sends a float total",
        ("FRG-23",),
        says=_fragment(lambda m: {**m, "total": _number(m, "total") + 0.5}),
    ),
    Fault("sends fragments under the id 0", ("FRG-24",), says=_put("fragment", id=0)),
    Fault("sends all fragments under one id", ("FRG-24",), says=_put("fragment", id="f")),
    Fault(
        "counts sent fragments from one",
        ("FRG-20", "FRG-21"),
        says=_fragment(lambda m: {**m, "num": _number(m, "num") + 1}),
    ),
    Fault(
        "sends fragments in reversed order",
        ("FRG-28",),
        says=_fragment(lambda m: {**m, "num": _number(m, "total") - 1 - _number(m, "num")}),
    ),
    Fault(
        "announces a fragment too many",
        ("FRG-20",),
        says=_fragment(lambda m: {**m, "total": _number(m, "total") + 1}),
    ),
    Fault("never cuts messages", ("FRG-20",), hears=_without("subscribe", "fragment_size")),
    Fault("keeps fragment_size for the connection", ("FRG-20",), hears=_sticky_fragments),
    Fault(
        "breaks the lines of base64 pictures",
        ("PNG-04",),
        says=_on("png", lambda m: {**m, "data": f"{str(m['data'])[:40]}\n{str(m['data'])[40:]}"}),
    ),
    Fault("numbers pictures", ("FRG-26", "PNG-01"), says=_put("png", num=0, total=1)),
    Fault("ignores compression", ("CBR-01", "PNG-01"), hears=_without("subscribe", "compression")),
    Fault(
        "says that float32 are big-endian",
        ("CBR-02",),
        says_bytes=lambda data: data.replace(b"\xd8\x55", b"\xd8\x51"),
    ),
    Fault(
        "tags int16 as uint16", ("CBR-02",), says_bytes=lambda data: data.replace(b"\xd8\x4d", b"\xd8\x45")
    ),
    Fault(
        "tags byte strings",
        ("CBR-03",),
        says_bytes=lambda data: data.replace(b"\x64data\x44", b"\x64data\xd8\x40\x44"),
    ),
    Fault("spells the keys of cbor-raw as ROS 2 does", ("CBR-10",), says_bytes=_raw_keys),
    Fault(
        "writes a big-endian CDR header",
        ("CBR-11",),
        says_bytes=lambda data: data.replace(b"\x00\x01\x00\x00", b"\x00\x00\x00\x00"),
    ),
    Fault(
        "sends maps of unknown length",
        ("CBR-01", "CBR-08"),
        says_bytes=lambda data: b"\xbf" + data[1:] + b"\xff",
    ),
)

_ACTIONS = (
    Fault("calls every outcome a success", ("ACT-03", "ACT-15"), says=_put("action_result", status=4)),
    Fault(
        "reports an aborted goal as not run",
        ("ACT-03",),
        says=_on("action_result", lambda m: {**m, "result": m.get("status") == 4}),
    ),
    Fault(
        "sends the status as text",
        ("ACT-03",),
        says=_on("action_result", lambda m: {**m, "status": str(m.get("status"))}),
    ),
    Fault("loses the id of results", ("ACT-01",), says=_without("action_result", "id")),
    Fault("loses the id of feedback", ("ACT-02",), says=_without("action_feedback", "id")),
    Fault("sends feedback twice", ("ACT-02",), says=_twice("action_feedback")),
    Fault("sends feedback after the result", ("ACT-06",), says=_feedback_late),
    Fault("sends feedback to all", ("ACT-02",), hears=_put("send_action_goal", feedback=True)),
    Fault("sends feedback to nobody", ("ACT-02",), hears=_put("send_action_goal", feedback=False)),
    Fault("ignores cancels", ("ACT-07",), hears=_drop("cancel_action_goal", lambda m: True)),
    Fault(
        "refuses results without status",
        ("ACT-16",),
        hears=_drop("action_result", lambda m: "status" not in m),
    ),
    Fault(
        "does not check the type of goals",
        ("ACT-04",),
        hears=_put("send_action_goal", action_type="example_interfaces/Fibonacci"),
    ),
    Fault("sends goals without feedback wish", ("ACT-12",), says=_without("send_action_goal", "feedback")),
    Fault("sends cancels without action", ("ACT-13",), says=_without("cancel_action_goal", "action")),
)

_REST = (
    Fault("loses the id of status", ("STA-03",), says=_without("status", "id")),
    Fault("calls every status a warning", ("STA-04", "STA-03"), says=_put("status", level="warning")),
    Fault("sends empty status", ("STA-03",), says=_put("status", msg="")),
    Fault("tells of success unasked", ("STA-05",), says=_success_told),
    Fault("tells clients without status of success", ("status/unsolicited",), says=_success_told),
    Fault("gives text parameters as plain text", ("API-07",), says=_on("service_response", _plain_value)),
    Fault(
        "gives text parameters as plain text, ROS 1",
        ("API-07",),
        says=_on("service_response", _plain_value),
        ros=1,
    ),
    Fault(
        "gives parameters as Python prints them",
        ("rosapi/param-boolean-json-ros2",),
        says=_on("service_response", partial(_plain_value, kinds=bool)),
    ),
    Fault(
        "ignores set_level none",
        ("STA-02",),
        hears=_on("set_level", lambda m: {**m, "level": "info"} if m.get("level") == "none" else m),
    ),
    Fault(
        "mixes up the types of topics",
        ("API-02",),
        says=_on(
            "service_response",
            lambda m: (
                {**m, "values": {**v, "types": ["x"] * 3}}
                if isinstance(v := m.get("values"), dict) and "types" in v
                else m
            ),
        ),
    ),
    Fault(
        "reports types in two parts on ROS 2",
        ("API-02",),
        says=_in_payload("service_response", "values", _two_parts),
    ),
    Fault(
        "gives the time as ROS 1 does",
        ("API-11",),
        says=_in_payload(
            "service_response", "values", lambda k, v: _rename(v, {"sec": "secs", "nanosec": "nsecs"})
        ),
    ),
    Fault(
        "calls lists scalars",
        ("API-03",),
        says=_in_payload(
            "service_response", "values", lambda k, v: -1 if k == "fieldarraylen" and v == 0 else v
        ),
    ),
    Fault(
        "gives nested types first",
        ("API-03",),
        says=_in_payload(
            "service_response",
            "values",
            lambda k, v: list(reversed(v)) if k == "typedefs" and isinstance(v, list) else v,
        ),
    ),
    Fault(
        "answers null for unknown types",
        ("API-02",),
        says=_in_payload("service_response", "values", lambda k, v: None if k == "type" and v == "" else v),
    ),
    Fault(
        "separates full texts by 79 signs",
        ("API-06",),
        says=_in_payload(
            "service_response",
            "values",
            lambda k, v: v.replace("=" * 80, "=" * 79) if isinstance(v, str) else v,
        ),
    ),
)

FAULTS = (*_REPLIES, *_TOPICS, *_CONVERSION, *_WRAPPINGS, *_ACTIONS, *_REST)
"""All faults."""
