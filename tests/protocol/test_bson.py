"""BSON documents as messages: read whole, cut short, with something behind, and damaged."""

from __future__ import annotations

import json
import math
import struct

import bson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.codecs import JSON
from rwt_protocol.codecs.base import SplitLimits
from rwt_protocol.codecs.bson import BsonCodec
from rwt_protocol.ops import Direction, Op, Publish
from rwt_protocol.payloads import Decoded
from rwt_protocol.session import Refusal, Session, WireLimits
from tests.protocol.wire_examples import EXAMPLES, Example

CODEC = BsonCodec()


def one(data: bytes, limits: WireLimits | None = None) -> object:
    (found,) = Session(codec=CODEC, limits=limits or WireLimits()).decode(data, True, 0.0)
    return found


def reason(data: bytes, limits: WireLimits | None = None) -> str:
    found = one(data, limits)
    assert isinstance(found, Refusal)
    return found.reason


def test_a_document_to_the_byte() -> None:
    # bsonspec.org's own grammar, written out by hand.
    topic = b"\x02topic\0" + struct.pack("<i", 3) + b"/a\0"
    octets = b"\x05data\0" + struct.pack("<iB", 2, 0) + b"\0\xff"
    inner = struct.pack("<i", 4 + len(octets) + 1) + octets + b"\0"
    rest = b"\x02op\0" + struct.pack("<i", 8) + b"publish\0" + topic + b"\x03msg\0" + inner + b"\0"
    whole = struct.pack("<i", 4 + len(rest)) + rest
    assert CODEC.frame({"op": "publish", "topic": "/a", "msg": {"data": b"\0\xff"}}).data == whole
    assert one(whole) == Publish(topic="/a", msg=Decoded({"data": b"\0\xff"}))
    for end in range(len(whole)):
        assert reason(whole[:end]).startswith("not BSON")
    assert reason(whole + b"\0").startswith("not BSON")
    assert reason(whole + whole).startswith("not BSON")


@pytest.mark.parametrize(
    "example", [each for each in EXAMPLES.examples if each.valid], ids=lambda example: str(example.name)
)
def test_every_op_is_read_as_its_json_is(example: Example) -> None:
    direction = example.directions[0]
    text = json.dumps(example.message).encode()
    (expected,) = Session(direction=direction).decode(text, False, 0.0) or (None,)
    data = bson.encode(example.message)
    (found,) = Session(direction=direction, codec=CODEC).decode(data, True, 0.0) or (None,)
    assert type(found) is type(expected)
    if expected is not None and not isinstance(expected, Refusal):
        frame = Session(codec=CODEC).encode(expected)
        (again,) = Session(direction=direction, codec=CODEC).decode(frame.data, True, 0.0)
        assert as_json(again) == as_json(found)


def as_json(found: object) -> object:
    """An op's members, whatever they came in."""
    assert isinstance(found, Op)
    return json.loads(JSON.encode(found).data)


def nested(levels: int) -> bytes:
    heads = (struct.pack("<i", 5 + 8 * inner) for inner in range(levels - 1, -1, -1))
    return b"\x03a\0".join(heads) + b"\0" * levels


def test_depth_is_limited() -> None:
    limits = WireLimits(split=SplitLimits(max_depth=5))
    assert reason(nested(5), limits).startswith('no "op"')
    assert reason(nested(6), limits) == "nested more than 5 levels deep (limits.max_depth)"
    assert reason(nested(300)) == "nested more than 100 levels deep (limits.max_depth)"
    # Which of the two notices it first depends on how deep the caller's own stack is.
    assert reason(nested(8_000)).startswith(("not BSON", "nested more than 100 levels deep"))
    assert "(limits.structure_bytes)" in reason(nested(100_000))


def test_integers_that_bson_has_not_become_doubles() -> None:
    message = {"a": [2**64 - 1, {"b": -1}], "c": math.inf, "d": True}
    assert bson.decode(CODEC.frame(message).data) == {"a": [2.0**64, {"b": -1}], "c": math.inf, "d": True}


@given(st.binary(max_size=80), st.integers(0, 60))
def test_any_damaged_document_is_an_op_or_a_refusal(damage: bytes, place: int) -> None:
    whole = bson.encode({"op": "subscribe", "topic": "/a", "id": "x", "throttle_rate": 5})
    damaged = whole[:place] + damage + whole[place + len(damage) :]
    for data in (damage, struct.pack("<i", len(damage) + 4) + damage, damaged):
        for found in Session(codec=CODEC).decode(data, True, 0.0):
            assert isinstance(found, Refusal | Op)


@given(st.text().filter(lambda text: "\0" not in text), st.dictionaries(
    st.text(st.characters(exclude_characters="\0", codec="utf-8")),
    st.integers(-(2**63), 2**63 - 1) | st.booleans() | st.binary() | st.floats(allow_nan=False),
))  # fmt: skip
def test_what_is_written_is_read_back(topic: str, members: dict[str, object]) -> None:
    frame = CODEC.encode(Publish(topic=topic, id="i", msg=Decoded(members)))
    (found,) = Session(direction=Direction.TO_CLIENT, codec=CODEC).decode(frame.data, True, 0.0)
    assert isinstance(found, Publish)
    assert (found.topic, found.msg) == (topic, Decoded(members))
