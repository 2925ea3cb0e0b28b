"""Frames to ops and back without a session, in every encoding and version."""

from __future__ import annotations

import doctest
import json
import pickle
from typing import Any, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

import rwt_protocol
from rwt_protocol import (
    OPS,
    PROFILES,
    AnyOp,
    Direction,
    MalformedMessage,
    MalformedPayload,
    Op,
    OpToClient,
    OpToServer,
    Png,
    Profile,
    ProtocolError,
    Publish,
    Refusal,
    Session,
    SetLevel,
    Status,
    Subscribe,
    WireLimits,
    dump,
    parse,
)
from rwt_protocol.stateless import EncodingName
from tests.core.protocol.op_strategies import members_of
from tests.core.protocol.test_library import INVALID, VALID
from tests.core.protocol.wire_examples import EXAMPLES, Example, Malformed, only

ENCODINGS: tuple[EncodingName, ...] = get_args(EncodingName)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("example", VALID, ids=lambda each: str(each.name))
def test_what_is_dumped_is_parsed(example: Example, encoding: EncodingName) -> None:
    op = TypeAdapter[Op](AnyOp).validate_python(example.message)
    message = dump(op, encoding)
    assert isinstance(message, bytes if encoding in ("cbor", "bson") else str)
    assert parse(message, encoding) == [op]
    if encoding != "bson":
        (found,) = parse(message)
        assert isinstance(found, Png) if encoding == "png" else found == op


@pytest.mark.parametrize("name", OPS)
@settings(max_examples=50)
@given(st.data(), st.sampled_from(ENCODINGS), st.sampled_from(list(PROFILES.values())))
def test_every_op_survives_every_encoding_in_every_version(
    name: str, data: st.DataObject, encoding: EncodingName, profile: Profile
) -> None:
    model = OPS[name].model
    members = data.draw(members_of(model, encoding in ("cbor", "bson")))
    op = model.model_validate(members)
    assert model.model_validate(op.model_dump()) == op
    assert pickle.loads(pickle.dumps(op)) == op
    message = dump(op, encoding)
    if name not in profile.ops or (encoding == "png" and "png" not in profile.ops):
        with pytest.raises(MalformedMessage):
            parse(message, encoding, profile=profile)
        return
    kept = {key: value for key, value in members.items() if key not in profile.without.get(name, ())}
    assert parse(message, encoding, profile=profile) == [model.model_validate(kept)]


@pytest.mark.parametrize("example", INVALID, ids=lambda each: str(each.name))
def test_what_is_raised_is_what_the_wire_says(example: Example) -> None:
    text = json.dumps(example.message)
    refusal = only(Session(direction=example.directions[0]).decode(text.encode(), False, 0.0), Refusal)
    with pytest.raises(MalformedMessage) as caught:
        parse(text, direction=example.directions[0])
    error = caught.value
    assert str(error) == refusal.reason
    assert (error.op, error.id, error.name) == (refusal.op, refusal.id, refusal.name)
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.op, again.level) == (refusal.reason, refusal.op, "error")


@pytest.mark.parametrize("malformed", EXAMPLES.malformed, ids=lambda each: str(each.name))
def test_a_frame_is_refused_when_a_session_refuses_some_of_it(malformed: Malformed) -> None:
    found = Session().decode(malformed.text.encode(), False, 0.0)
    reasons = [each.reason for each in found if isinstance(each, Refusal)]
    if not reasons:
        assert parse(malformed.text) == list(found)
        return
    with pytest.raises(MalformedMessage) as caught:
        parse(malformed.text, direction=Direction.TO_SERVER)
    assert str(caught.value) == reasons[0]


def test_the_session_of_a_caller_is_not_needed_for_what_a_session_does() -> None:
    assert parse('{"op":"set_level","level":"info"}{"op":"status_level","level":"none"}') == [
        SetLevel(level="info"),
        SetLevel(level="none"),
    ]
    for picture in EXAMPLES.png:
        text = json.dumps({"op": "png", "data": picture.png_base64})
        assert parse(text) == [Png(data=picture.png_base64)]
        assert parse(text, "png") == parse(picture.inner_json)
    with pytest.raises(MalformedMessage, match='status: expected a message "png"'):
        parse(dump(Status(level="info", msg="")), "png")
    with pytest.raises(MalformedMessage, match=r"^png\.data: expected base64"):
        parse('{"op":"png","data":"?"}', "png")


def test_a_side_and_limits_are_looked_at_when_given() -> None:
    status = dump(Status(level="info", msg=""))
    assert parse(status, direction=Direction.TO_CLIENT) == parse(status)
    with pytest.raises(MalformedMessage, match='operation "status" only goes server to client'):
        parse(status, direction=Direction.TO_SERVER)
    with pytest.raises(MalformedMessage):
        parse(status, limits=WireLimits(max_message_size=10))


def test_a_large_payload_is_looked_at_whole() -> None:
    good = '{"op":"publish","topic":"/a","msg":{"a":"' + "x" * 40_000 + '","b":NaN}}'
    (op,) = parse(good)
    assert op == Publish(topic="/a", msg={"a": "x" * 40_000, "b": None})
    with pytest.raises(MalformedPayload):
        parse(good.replace("NaN", "Nan"))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_half_of_a_character_cannot_be_written(encoding: EncodingName) -> None:
    with pytest.raises(ProtocolError, match="subscribe"):
        dump(Subscribe(topic="\ud800"), encoding)


def test_an_unknown_encoding_is_refused_by_name() -> None:
    with pytest.raises(ProtocolError, match="no encoding 'xml': expected one of json, png, cbor, bson"):
        dump(Subscribe(topic="/a"), "xml")  # type: ignore[call-overload]  # the mistake under test


@pytest.mark.parametrize(
    ("union", "direction"),
    [(AnyOp, Direction.BOTH), (OpToServer, Direction.TO_SERVER), (OpToClient, Direction.TO_CLIENT)],
)
def test_a_union_holds_the_ops_of_its_direction(union: Any, direction: Direction) -> None:
    arriving = PROFILES["compat"].arriving(direction)
    mapping = TypeAdapter(union).json_schema()["discriminator"]["mapping"]
    names = {OPS[name] for name in arriving}
    assert set(mapping) == arriving | {alias for spec in names for alias in spec.aliases}
    for name in OPS:
        error = next((each for each in VALID if each.message["op"] == name), None)
        assert error is not None
        if name in arriving:
            assert type(TypeAdapter(union).validate_python(error.message)) is OPS[name].model
        else:
            with pytest.raises(ValidationError):
                TypeAdapter(union).validate_python(error.message)


def test_the_examples_of_the_package_are_right() -> None:
    done = doctest.testmod(rwt_protocol)
    assert (done.failed, done.attempted > 0) == (0, True)


def test_every_public_name_is_there() -> None:
    for name in rwt_protocol.__all__:
        assert getattr(rwt_protocol, name) is not None
    assert len(set(rwt_protocol.__all__)) == len(rwt_protocol.__all__)
    assert {spec.model.__name__ for spec in OPS.values()} < set(rwt_protocol.__all__)
    with pytest.raises(AttributeError, match="'rwt_protocol' has no attribute 'Parse'"):
        _ = rwt_protocol.Parse
