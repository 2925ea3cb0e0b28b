"""The ops as models of pydantic: whoever imports them builds, reads, writes, copies and compares them."""

from __future__ import annotations

import copy
import json
import math
import pickle
import warnings
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from rwt_protocol import AnyOp
from rwt_protocol.ops import OPS, CallService, Op, Publish, ServiceResponse
from rwt_protocol.payloads import EMPTY, Decoded, RawJson
from tests.core.protocol.wire_examples import EXAMPLES, Example

#: Refused by the type of the payload, or by the protocol text alone.
NOT_OURS = {"publish-unknown-field", "publish-wrong-type", "result-without-status-from-roslibjs-2024"}

VALID = [each for each in EXAMPLES.examples if each.valid or each.name in NOT_OURS]
INVALID = [each for each in EXAMPLES.examples if each not in VALID]


def model_of(example: Example) -> type[Op]:
    return OPS[example.message["op"]].model


@pytest.mark.parametrize("example", VALID, ids=lambda each: str(each.name))
def test_an_op_is_made_in_any_way_and_is_the_same(example: Example) -> None:
    model = model_of(example)
    op = model.model_validate(example.message)
    assert model.model_validate_json(json.dumps(example.message)) == op
    assert model(**{name: value for name, value in example.message.items() if name != "op"}) == op
    assert hash(model.model_validate_json(json.dumps(example.message))) == hash(op)
    for same in (
        model.model_validate(op),
        model.model_validate(op.model_dump()),
        model.model_validate(op.model_dump(mode="json")),
        model.model_validate_json(op.model_dump_json()),
        pickle.loads(pickle.dumps(op)),
        copy.copy(op),
        copy.deepcopy(op),
        op.model_copy(),
        op.model_copy(deep=True),
    ):
        assert same == op
        assert type(same) is model
    assert model.__name__ in repr(op)


@pytest.mark.parametrize("example", VALID, ids=lambda each: str(each.name))
def test_a_dump_holds_what_was_given_as_plain_values(example: Example) -> None:
    op = model_of(example).model_validate(example.message)
    for dumped in (
        op.model_dump(exclude_unset=True),
        op.model_dump(mode="json", exclude_unset=True),
        json.loads(op.model_dump_json(exclude_unset=True)),
    ):
        given = {name: value for name, value in example.message.items() if name in type(op).model_fields}
        if example.name == "fragment-total-float-as-sent-by-suites":
            given["total"] = 5
        if example.name == "advertise-qos":
            given["qos"] = given["qos"] | {"deadline": 2.0}
        assert json.loads(json.dumps(dumped)) == given


@pytest.mark.parametrize("example", INVALID, ids=lambda each: str(each.name))
def test_what_the_wire_refuses_is_refused(example: Example) -> None:
    with pytest.raises(ValidationError):
        model_of(example).model_validate(example.message)
    with pytest.raises(ValidationError):
        model_of(example).model_validate_json(json.dumps(example.message))


@pytest.mark.parametrize("op", OPS)
@pytest.mark.parametrize("mode", ["validation", "serialization"])
def test_an_op_has_a_schema_without_a_warning(op: str, mode: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        schema = OPS[op].model.model_json_schema(mode=mode)
    assert set(schema["properties"]) == set(OPS[op].model.model_fields)
    assert set(schema["properties"]["op"].get("enum", [schema["properties"]["op"].get("const")])) == {
        op,
        *OPS[op].aliases,
    }


def test_numbers_have_a_range_in_every_schema() -> None:
    def unbounded(schema: Any) -> list[Any]:
        if isinstance(schema, list):
            return [each for item in schema for each in unbounded(item)]
        if not isinstance(schema, dict):
            return []
        number = schema.get("type") in ("integer", "number")
        ends = [{"minimum", "exclusiveMinimum"} & set(schema), {"maximum", "exclusiveMaximum"} & set(schema)]
        own = [schema] if number and not all(ends) else []
        return own + [each for item in schema.values() for each in unbounded(item)]

    assert {op: unbounded(spec.model.model_json_schema()) for op, spec in OPS.items()} == {
        op: [] for op in OPS
    }


def test_payloads_are_equal_when_their_values_are() -> None:
    text, value = RawJson(b'{"a": [1.0, true, null], "b":"x"}'), Decoded({"b": "x", "a": [1, True, None]})
    assert text == value
    assert hash(text) == hash(value)
    assert text != Decoded({"b": "x", "a": [1, 1, None]})
    assert Decoded(math.nan) == Decoded(math.nan)
    assert RawJson(b"{") == RawJson(b"{")
    assert RawJson(b"{") != RawJson(b"[")
    assert CallService(service="/a", args={"a": 1}) == CallService(service="/a", args=RawJson(b'{"a":1}'))
    assert (
        CallService(service="/a")
        == CallService(service="/a", args={})
        == CallService(service="/a", args=EMPTY)
    )


def test_what_json_has_not_is_dumped_as_the_protocol_writes_it() -> None:
    op = Publish(topic="/a", msg={"data": b"\xfb\xff", "x": [math.nan, -math.inf, 2**64 - 1]})
    assert json.loads(op.model_dump_json())["msg"] == {"data": "+/8=", "x": [None, None, 2**64 - 1]}
    assert op.model_dump(mode="json")["msg"] == json.loads(op.model_dump_json())["msg"]
    assert op.model_dump()["msg"]["data"] == b"\xfb\xff"
    assert math.isnan(op.model_dump()["msg"]["x"][0])


def test_an_op_does_not_change_with_what_it_was_made_of() -> None:
    args = {"a": [1]}
    op = CallService(service="/a", args=args)
    args["a"].append(2)
    assert op == CallService(service="/a", args={"a": [1]})


_CIRCLE: dict[str, object] = {}
_CIRCLE["again"] = _CIRCLE


@pytest.mark.parametrize(
    "value", [5, "text", None, [], object(), {"a": object()}, {1: 2}, {"a": 2**64}, {"a": "\ud800"}, _CIRCLE]
)
def test_a_payload_of_another_kind_is_one_error_at_its_member(value: Any) -> None:
    with pytest.raises(ValidationError) as caught:
        Publish(topic="/a", msg=value)
    (error,) = caught.value.errors()
    assert (error["loc"], error["type"]) == (("msg",), "payload")
    assert "of type object" in error["msg"]


def test_null_is_an_absent_payload_and_a_text_a_failure() -> None:
    assert CallService(service="/a", args=None).args == EMPTY
    assert CallService.model_validate_json('{"service":"/a","args":null}').args == EMPTY
    assert ServiceResponse(service="/a", values="no", result=False).values == "no"
    assert ServiceResponse.model_validate_json('{"service":"/a","values":"no"}').values == "no"


@given(st.integers(0, 40_000))
def test_a_large_payload_that_was_not_looked_at_travels_between_processes(size: int) -> None:
    data = b'{"a":"' + b"x" * size + b'"}'
    op = Publish(topic="/a", msg=RawJson(memoryview(b" " + data)[1:]))
    assert pickle.loads(pickle.dumps(op)) == copy.deepcopy(op) == op


class Recorded(BaseModel):
    """A model of a program that has an op in it."""

    op: AnyOp
    others: list[AnyOp] = []


@pytest.mark.parametrize("example", VALID, ids=lambda each: str(each.name))
def test_an_op_within_another_model(example: Example) -> None:
    given = {"op": example.message, "others": [example.message]}
    recorded = Recorded.model_validate(given)
    assert recorded.others == [recorded.op]
    assert type(recorded.op) is model_of(example)
    assert Recorded.model_validate_json(json.dumps(given)) == recorded
    assert Recorded.model_validate_json(recorded.model_dump_json()) == recorded
    assert Recorded.model_validate(recorded.model_dump()) == recorded
    assert copy.deepcopy(recorded) == pickle.loads(pickle.dumps(recorded)) == recorded


def test_an_op_within_another_model_is_told_apart_by_its_name() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Recorded.model_json_schema()
    with pytest.raises(ValidationError) as caught:
        Recorded.model_validate({"op": {"op": "teleport"}})
    assert [error["type"] for error in caught.value.errors()] == ["union_tag_invalid"]


@pytest.mark.parametrize("example", VALID, ids=lambda each: str(each.name))
def test_an_op_made_without_validation_is_dumped_as_it_was_given(example: Example) -> None:
    """`model_construct` leaves the payload what it is."""
    op = model_of(example).model_construct(**example.message)
    given = {name: value for name, value in example.message.items() if name in type(op).model_fields}
    with warnings.catch_warnings():
        # Of other members pydantic may say that they are not of their type, as of every such model.
        warnings.simplefilter("ignore", UserWarning)
        assert op.model_dump(exclude_unset=True) == given
        assert json.loads(op.model_dump_json(exclude_unset=True)) == given
    assert copy.deepcopy(op).model_fields_set == op.model_fields_set
