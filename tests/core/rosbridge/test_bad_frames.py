"""Members of any value, and numbers that JSON has not. The conformance cases `malformed` have bad frames."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rwt_protocol.ops import OPS
from tests.core.rosbridge.recording_client import Client


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
