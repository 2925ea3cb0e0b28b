"""BSON documents as messages: read whole, cut short, with something behind, and damaged."""

from __future__ import annotations

import math
import struct

import bson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.codecs.base import DecodeFailure
from rwt_protocol.codecs.bson import BsonCodec, encode_in_steps
from rwt_protocol.codecs.bson_decoder import check_structure
from rwt_protocol.errors import MalformedPayload
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Op, Publish
from rwt_protocol.payloads import Decoded
from rwt_protocol.session import Refusal, Session
from tests.conftest import counted

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


def nested(levels: int) -> bytes:
    heads = (struct.pack("<i", 5 + 8 * inner) for inner in range(levels - 1, -1, -1))
    return b"\x03a\0".join(heads) + b"\0" * levels


def test_depth_is_limited() -> None:
    limits = WireLimits(max_depth=5)
    assert reason(nested(5), limits).startswith('no "op"')
    assert reason(nested(6), limits) == "nested more than 5 levels deep (limits.max_depth)"
    assert reason(nested(300)) == "nested more than 100 levels deep (limits.max_depth)"
    # Which of the two notices it first depends on how deep the caller's own stack is.
    for levels in (8_000, 15_000):
        assert reason(nested(levels)).startswith(("not BSON", "nested more than 100 levels deep"))
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


NAMES = st.text(st.characters(exclude_characters="\0$", codec="utf-8"), max_size=6)
SCALARS = (
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False)
    | st.text(max_size=40) | st.binary(max_size=40)
)  # fmt: skip
VALUES = st.recursive(
    SCALARS | st.lists(SCALARS, max_size=3).map(lambda items: items * 20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(NAMES, inner, max_size=4),
    max_leaves=8,
)
DOCUMENTS = st.dictionaries(NAMES, VALUES, max_size=4)


@given(DOCUMENTS)
def test_a_checked_document_holds_what_the_library_finds_in_it(message: dict[str, object]) -> None:
    data = bson.encode({"op": "publish", "msg": message})
    with pytest.MonkeyPatch().context() as patched:
        patched.setattr("rwt_protocol.codecs.bson.FEW_BYTES", 0)
        (found,) = CODEC.split(data, WireLimits())
    assert found == {"op": "publish", "msg": Decoded(message)}


@given(DOCUMENTS, st.integers(0, 400), st.integers(0, 3), st.binary(max_size=3))
def test_a_damaged_document_is_refused_or_read_as_the_library_reads_it(
    message: dict[str, object], place: int, removed: int, added: bytes
) -> None:
    data = bson.encode(message)
    data = data[:place] + added + data[place + removed :]
    with pytest.MonkeyPatch().context() as patched:
        patched.setattr("rwt_protocol.codecs.bson.FEW_BYTES", 0)
        (found,) = CODEC.split(data, WireLimits())
    if not isinstance(found, DecodeFailure):
        assert found.keys() == bson.decode(data).keys()


@pytest.mark.parametrize("levels", [1, 5, 6, 40, 15_000])
def test_depth_is_counted_before_a_document_is_decoded(levels: int) -> None:
    assert counted(check_structure(nested(levels), WireLimits(max_depth=5)))[0] == (levels > 5)


def test_a_large_document_is_checked_in_steps() -> None:
    pose = {"position": {"x": 0.5, "y": 1.5}, "frame": "map"}
    message = {"data": [0.5] * 90_000, "poses": [pose] * 900, "text": "é" * 400_000, "octets": bytes(900_000)}
    data = bson.encode({"op": "publish", "topic": "/a", "msg": message})
    (found,), pauses = counted(CODEC.split_in_steps(data, WireLimits()))
    assert found == {"op": "publish", "topic": "/a", "msg": Decoded(message)}
    assert pauses >= 900 * 5 // 256


@given(DOCUMENTS)
def test_a_message_that_is_encoded_in_steps_is_the_same_to_the_byte(message: dict[str, object]) -> None:
    parts, _ = counted(encode_in_steps(bson.decode(bson.encode(message))))
    assert b"".join(parts) == bson.encode(message)


def test_a_large_message_is_encoded_piece_by_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = {
        "numbers": [2**64 - 1, *range(30_000), True, 0.5],
        "poses": [{"a": {"b": [number]}, "texts": ["x"]} for number in range(3000)],
        "mixed": [0.5, "a", *([0.5] * 9000 for _ in range(3)), {"deep": [{} for _ in range(9000)]}],
        "text": "aé😀" * 300_000,
        "octets": bytes(1_000_000),
        "last": 1,
    }
    expected = CODEC.frame({"op": "publish", "msg": whole}).data
    sizes: list[int] = []

    def encode(message: dict[str, object]) -> bytes:
        data = bson.encode(message)
        sizes.append(len(data))
        return data

    with monkeypatch.context() as patched:
        patched.setattr("rwt_protocol.codecs.bson._encode", encode)
        parts, pauses = counted(encode_in_steps({"op": "publish", "msg": whole}))
    assert b"".join(parts) == expected
    assert sorted(sizes)[-2] < 200_000 < 1_000_000 < sizes[sizes.index(max(sizes))]
    assert pauses >= len(sizes) - 3


def test_a_short_message_takes_no_steps() -> None:
    parts, pauses = counted(encode_in_steps({"ranges": [0.5] * 640, "name": "x" * 1000}))
    assert (len(parts), pauses) == (1, 0)


def test_a_name_with_a_nul_is_refused_in_a_large_message_too() -> None:
    for value in ([0.5] * 20_000, 1):
        with pytest.raises(MalformedPayload, match=r"NUL|null"):
            counted(encode_in_steps({"a": {"b\0c": value}, "d": [0.5] * 20_000}))
