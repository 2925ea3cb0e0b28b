"""The models take what clients send, and refuse what is wrong in words that name the member."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rwt_protocol.codecs import ENCODINGS, encoding_of
from rwt_protocol.ops import (
    OPS,
    ActionResult,
    Advertise,
    CallService,
    Direction,
    Op,
    Publish,
    ReplyTo,
    ServiceResponse,
    Status,
    Subscribe,
    inbound,
)
from rwt_protocol.payloads import EMPTY, RawJson
from rwt_protocol.session import Refusal, Session
from tests.core.protocol.wire_examples import EXAMPLES, Example, only, text_of

#: Refused by the type of the payload, or by the protocol text alone.
_NOT_OURS = {"publish-unknown-field", "publish-wrong-type", "result-without-status-from-roslibjs-2024"}

#: Consumed by the session.
_IN_SESSION = {"fragment", "png", "set_level"}


def decode(message: object, direction: Direction = Direction.TO_SERVER) -> list[Op | Refusal]:
    return list(Session(direction=direction).decode(json.dumps(message).encode(), False, 0.0))


def one(message: object, direction: Direction = Direction.TO_SERVER) -> Op | Refusal:
    (found,) = decode(message, direction)
    return found


@pytest.mark.parametrize("example", EXAMPLES.examples, ids=lambda example: str(example.name))
def test_examples_are_taken_or_refused_as_they_say(example: Example) -> None:
    for direction in example.directions:
        found = decode(example.message, direction)
        name = example.message["op"]
        if name in _IN_SESSION and example.valid:
            assert not any(isinstance(item, Refusal) for item in found)
        elif example.valid or example.name in _NOT_OURS:
            (op,) = found
            assert isinstance(op, OPS[name].model), op
            assert op.id == example.message.get("id")
        else:
            (refusal,) = found
            assert isinstance(refusal, Refusal)
            assert refusal.op == name
            assert refusal.reason.startswith(f"{name}.")


@pytest.mark.parametrize("given", ["s", "", 0, -1, 2**64 - 1, -(2**63), "é\u0000"])
def test_id_is_kept_unchanged(given: str | int) -> None:
    op = only(decode({"op": "subscribe", "topic": "/a", "id": given}), Subscribe)
    assert op.id == given
    assert type(op.id) is type(given)


@pytest.mark.parametrize("given", [1.0, True, [], {}, 2**64, -(2**63) - 1, "x" * 4097])
def test_id_of_another_kind_is_refused(given: object) -> None:
    refusal = only(decode({"op": "subscribe", "topic": "/a", "id": given}), Refusal)
    expected = "a string of at most 4096 characters or a 64-bit integer"
    assert refusal.reason.startswith(f"subscribe.id: expected {expected}, got ")
    assert refusal.id is None


def test_null_stands_for_an_absent_optional_member() -> None:
    nulls = {name: None for name in Subscribe.model_fields if name not in ("op", "topic")}
    assert one({"op": "subscribe", "topic": "/a"} | nulls) == Subscribe(topic="/a")
    refusal = only(decode({"op": "subscribe", "topic": None}), Refusal)
    assert refusal.reason == "subscribe.topic: expected a string, got null"


def test_integral_floats_are_integers() -> None:
    op = one(
        {"op": "subscribe", "topic": "/a", "throttle_rate": 20.0, "queue_length": 1.0, "fragment_size": 9.0}
    )
    assert op == Subscribe(topic="/a", throttle_rate=20, queue_length=1, fragment_size=9)


@pytest.mark.parametrize(
    ("member", "value", "text"),
    [
        ("queue_length", -1, "expected a whole number, zero or more, got -1"),
        ("queue_length", 1.5, "expected a whole number, zero or more, got 1.5"),
        ("throttle_rate", "10", 'expected a whole number, got "10"'),
        ("throttle_rate", True, "expected a whole number, got true"),
        ("fragment_size", [1], "expected a whole number, zero or more, got an array"),
        ("compression", 5, "expected a string, got 5"),
        ("type", {"a": 1}, "expected a string, got an object"),
        ("throttle_rate", -5, None),
    ],
)
def test_subscribe_members(member: str, value: object, text: str | None) -> None:
    found = one({"op": "subscribe", "topic": "/a", member: value})
    if text is None:
        assert found == Subscribe.model_validate({"topic": "/a", member: value})
    else:
        assert isinstance(found, Refusal)
        assert found.reason == f"subscribe.{member}: {text}"


@pytest.mark.parametrize("name", ["gzip", "", "PNG", "cbor_raw"])
def test_an_unknown_compression_is_none(name: str) -> None:
    assert encoding_of(name) is ENCODINGS["none"]
    assert one({"op": "subscribe", "topic": "/a", "compression": name}) == Subscribe(
        topic="/a", compression=name
    )


def test_quality_of_service() -> None:
    qos = {
        "history": "KEEP_LAST",
        "depth": 5,
        "reliability": "Best_Effort",
        "durability": "transient_local",
        "deadline": {"secs": 2, "nsecs": 500_000_000},
        "lifespan": "INFINITE",
        "unknown": 1,
    }
    op = only(decode({"op": "advertise", "topic": "/a", "type": "x/Y", "qos": qos}), Advertise)
    assert op.qos is not None
    assert op.qos.model_dump() == {
        "history": "keep_last",
        "depth": 5,
        "reliability": "best_effort",
        "durability": "transient_local",
        "deadline": 2.5,
        "lifespan": "infinite",
    }


@pytest.mark.parametrize(
    ("policy", "value"),
    [
        ("history", "some"),
        ("depth", -1),
        ("reliability", 1),
        ("durability", "x"),
        ("deadline", -1),
        ("deadline", {"secs": 1}),
        ("deadline", {"secs": -1, "nsecs": 0}),
        ("lifespan", "best_available"),
        ("lifespan", [1]),
    ],
)
def test_a_wrong_policy_is_named(policy: str, value: object) -> None:
    refusal = only(decode({"op": "subscribe", "topic": "/a", "qos": {policy: value}}), Refusal)
    assert refusal.reason.startswith(f"subscribe.qos.{policy}")


def test_payloads_are_not_decoded_and_default_to_an_empty_object() -> None:
    data = b'{"op":"publish","topic":"/a","msg":{ "x" : 1.0 }}'
    assert list(Session().decode(data, False, 0.0)) == [Publish(topic="/a", msg=RawJson(b'{ "x" : 1.0 }'))]
    assert one({"op": "publish", "topic": "/a"}) == Publish(topic="/a", msg=EMPTY)
    null = only(decode({"op": "publish", "topic": "/a", "msg": None}), Publish)
    assert text_of(null.msg).kind == "null"
    for args in ({}, {"args": None}):
        assert one({"op": "call_service", "service": "/s"} | args) == CallService(service="/s", args=EMPTY)


def test_the_text_of_a_failure_is_decoded() -> None:
    reply = one(
        {"op": "service_response", "service": "/s", "id": "a", "values": "wh\u00fd\n", "result": False}
    )
    assert reply == ServiceResponse(service="/s", id="a", values="wh\u00fd\n", result=False)
    assert one({"op": "service_response", "service": "/s", "id": "a", "result": False, "values": None}) == (
        ServiceResponse(service="/s", id="a", values=EMPTY, result=False)
    )


@pytest.mark.parametrize(
    ("members", "status"),
    [
        ({"result": True}, 4),
        ({"result": False}, 6),
        ({"result": True, "status": 5}, 5),
        ({}, 4),
    ],
)
def test_a_result_without_status_has_the_usual_one(members: dict[str, Any], status: int) -> None:
    op = only(decode({"op": "action_result", "action": "/a", "id": "g"} | members), ActionResult)
    assert op.status == status
    assert type(op.status) is int


@pytest.mark.parametrize("t", [1400000000, 1400000000.9, {"sec": 1400000000, "nanosec": 5}])
def test_times_of_auth_are_whole_seconds(t: object) -> None:
    message = {"op": "auth", "mac": "", "client": "", "dest": "", "rand": "", "t": t, "level": "", "end": t}
    op = one(message)
    assert not isinstance(op, Refusal)
    assert op.model_dump()["t"] == 1400000000


@pytest.mark.parametrize("name", OPS)
@pytest.mark.parametrize(
    "reply_to", [ReplyTo("x", "i", "/n"), ReplyTo("x", 7, ""), ReplyTo("x", None, "/n"), ReplyTo()]
)
def test_every_op_can_be_refused(name: str, reply_to: ReplyTo) -> None:
    answer = OPS[name].refuse(reply_to, "why", "warning")
    assert answer.id == reply_to.id
    if name == "call_service" and reply_to != ReplyTo():
        assert answer == ServiceResponse(service=reply_to.name, values="why", result=False, id=reply_to.id)
    elif name == "send_action_goal" and reply_to != ReplyTo():
        assert answer == ActionResult(
            action=reply_to.name, values="why", result=False, status=0, id=reply_to.id
        )
    else:
        assert answer == Status(level="warning", msg="why", id=reply_to.id)


def test_the_table_is_closed() -> None:
    assert {spec.model for spec in OPS.values()} == set(Op.__subclasses__())
    assert inbound(Direction.TO_SERVER) | inbound(Direction.TO_CLIENT) == {
        spec.model for spec in OPS.values() if not spec.in_session
    }
    assert Status not in inbound(Direction.TO_SERVER)
    assert Subscribe not in inbound(Direction.TO_CLIENT)


_EXAMPLE_OF = {example.message["op"]: example for example in EXAMPLES.examples if example.valid}


@pytest.mark.parametrize("name", OPS)
def test_a_wrong_kind_in_any_member_is_refused_by_name(name: str) -> None:
    """Whatever the member and the value: taken, or refused in our own words with the answer addressed."""
    model = OPS[name].model
    valid = _EXAMPLE_OF[name].message
    direction = _EXAMPLE_OF[name].directions[0]
    for member in model.model_fields:
        for wrong in (None, True, 1, -1, 1.5, "x", [], {}, [[1]], {"a": {"b": None}}):
            for item in decode(valid | {member: wrong}, direction):
                if isinstance(item, Refusal):
                    assert "pydantic" not in item.reason
                    assert "Input should" not in item.reason
                    assert "something else" not in item.reason
