"""Every bad frame is answered or logged; the connection lives, and others see nothing."""

from __future__ import annotations

import json
import logging
from typing import Any

import pytest

from rwt_protocol.ops import OPS
from tests.core.rosbridge.recording_client import Client

FRAMES: dict[str, str | bytes] = {
    "not json": "hello",
    "empty": "",
    "a number": "42",
    "a string": '"op"',
    "true": "true",
    "null": "null",
    "an array": "[1,2]",
    "half a message": '{"op":"subscribe","topic":',
    "no op": '{"topic":"/x"}',
    "op is a number": '{"op":5}',
    "op is an object": '{"op":{}}',
    "op is an array": '{"op":[]}',
    "unknown op": '{"op":"frobnicate"}',
    "version 1": '{"receiver":"/x","msg":{}}',
    "deep nesting": '{"op":"publish","topic":"/x","msg":' + "[" * 100_000 + "]" * 100_000 + "}",
    "deep objects": '{"a":' * 50_000 + "1" + "}" * 50_000,
    "bad utf-8": b'{"op":"publish","topic":"/x","type":"std_msgs/String","msg":{"data":"\xff\xfe"}}',
    "bad utf-8 in the topic": b'{"op":"subscribe","topic":"/\xff","type":"std_msgs/String"}',
    "lone surrogate": '{"op":"publish","topic":"/x","type":"std_msgs/String","msg":{"data":"\\ud800"}}',
    "nul bytes": b"\x00" * 100,
    "garbage with a brace": '{"op" "publish"}',
    "huge number": '{"op":"publish","topic":"/n","type":"std_msgs/Int64","msg":{"data":' + "9" * 5000 + "}}",
    "bad topic name": '{"op":"subscribe","topic":"/a b//c","type":"std_msgs/String"}',
    "empty topic name": '{"op":"subscribe","topic":"","type":"std_msgs/String"}',
    "bad base64": '{"op":"publish","topic":"/i","type":"sensor_msgs/Image","msg":{"data":"!!!"}}',
}


@pytest.mark.parametrize("name", FRAMES)
def test_a_bad_frame_disturbs_nobody(
    client: Client, other: Client, caplog: pytest.LogCaptureFixture, name: str
) -> None:
    other.say("subscribe", topic="/x", type="std_msgs/String")
    caplog.set_level(logging.DEBUG, "rwt.bridge")
    client.say_raw(FRAMES[name])
    assert f"[client {client.peer.number}]" in caplog.text
    assert "Traceback" not in caplog.text
    assert client.heard() == []
    client.say("set_level", level="error")
    client.say_raw(FRAMES[name])
    (status,) = client.heard()
    assert (status["op"], status["level"]) == ("status", "error")
    assert status["msg"]
    assert client.close_code is None
    assert other.heard() == []
    client.say("publish", topic="/x", msg={"data": "still here"})
    assert other.heard_of("/x") == [{"data": "still here"}]


def _members() -> list[tuple[str, str]]:
    return [
        (name, member)
        for name, spec in OPS.items()
        for member in spec.model.model_fields
        if member not in ("op", "id")
    ]


@pytest.mark.parametrize("value", [None, 1, -1, 1.5, True, "x", [], {}, [[1]], {"a": {"b": None}}], ids=repr)
@pytest.mark.parametrize(("op", "member"), _members(), ids=lambda part: str(part))
def test_any_value_in_any_member_of_any_op(client: Client, op: str, member: str, value: Any) -> None:
    valid: dict[str, Any] = {
        "topic": "/t",
        "type": "std_msgs/String",
        "service": "/s",
        "action": "/a",
        "action_type": "example_interfaces/Fibonacci",
        "result": True,
        "status": 4,
        "level": "error",
        "msg": {"data": "x"} if op == "publish" else "text",
        "data": "x",
        "num": 0,
        "total": 2,
        "id": "i",
    }
    client.say("set_level", level="info")
    message = {key: part for key, part in valid.items() if key in OPS[op].model.model_fields or key == "id"}
    client.say_raw(json.dumps({**message, "op": op, member: value}))
    heard = client.heard()
    assert all(reply["op"] in ("status", "service_response", "action_result", "publish") for reply in heard)
    assert not any("internal error" in str(reply) for reply in heard)
    assert client.close_code is None


@pytest.mark.parametrize("token", ["NaN", "Infinity", "-Infinity", "1e999999", "null"])
def test_numbers_that_json_has_not_go_out_as_null(client: Client, token: str) -> None:
    client.say("subscribe", topic="/f", type="std_msgs/Float64")
    client.say_raw('{"op":"publish","topic":"/f","msg":{"data":' + token + "}}")
    assert client.heard_of("/f") == [{"data": None}]
