"""Whatever arrives becomes ops or refusals: no exception, and a bounded number of both."""

from __future__ import annotations

import contextlib
import json
import math
from typing import Any

import bson
import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.codecs import JSON, bson_codec
from rwt_protocol.codecs.full_split import MOST_MESSAGES
from rwt_protocol.ops import OPS, Direction
from rwt_protocol.profiles import PROFILES, Profile
from rwt_protocol.session import Refusal, Session
from tests.core.protocol.wire_examples import EXAMPLES, only

_SESSIONS = st.builds(
    Session,
    st.sampled_from(list(PROFILES.values())),
    st.sampled_from([Direction.TO_SERVER, Direction.TO_CLIENT]),
)
_FRAMES = [json.dumps(example.message).encode() for example in EXAMPLES.examples]
_MEMBERS = [
    "op", "id", "topic", "service", "action", "msg", "args", "values", "level", "qos", "type", "receiver",
    "x",
]  # fmt: skip
_VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)
_NEAR_OBJECTS = st.dictionaries(st.sampled_from(_MEMBERS), _VALUES | st.sampled_from(["publish", "/a"]))


def check(session: Session, data: bytes, binary: bool, *, with_ops: bool = True) -> None:
    """Check what a frame becomes; `with_ops` only if its payloads are JSON."""
    found = session.decode(data, binary, 0.0)
    assert 0 <= len(found) <= MOST_MESSAGES + 1
    for item in found:
        if isinstance(item, Refusal):
            assert 0 < len(item.reason) < 1000
        answer = item.answer if isinstance(item, Refusal) else item
        if answer is not None and (with_ops or isinstance(item, Refusal)):
            frame = JSON.encode(answer)
            assert isinstance(json.loads(frame.data), dict)


@given(_SESSIONS, st.binary(max_size=200), st.booleans())
def test_any_bytes(session: Session, data: bytes, binary: bool) -> None:
    check(session, data, binary)


@given(_SESSIONS, st.lists(_NEAR_OBJECTS | _VALUES, max_size=3), st.booleans())
def test_any_json(session: Session, values: list[Any], binary: bool) -> None:
    check(session, b" ".join(json.dumps(value).encode() for value in values), binary)


@given(
    _SESSIONS,
    st.sampled_from(_FRAMES),
    st.lists(st.tuples(st.integers(0, 500), st.integers(0, 3), st.binary(max_size=3)), max_size=4),
)
def test_any_damaged_message(session: Session, data: bytes, damage: list[tuple[int, int, bytes]]) -> None:
    for place, removed, added in damage:
        cut = place % (len(data) + 1)
        data = data[:cut] + added + data[cut + removed :]
    check(session, data, False)


@given(
    st.lists(st.sampled_from(_FRAMES), max_size=4),
    st.lists(st.sampled_from([b"", b" ", b"junk", b"\n", b"]"])),
)
def test_any_sequence_of_messages_and_garbage(frames: list[bytes], garbage: list[bytes]) -> None:
    pieces = [part for pair in zip(frames, garbage, strict=False) for part in pair]
    check(Session(), b"".join(pieces), False)


_EXTREMES = ("1e30", "-1e30", "1e308", "-1e308", "1e999", "9" * 400, "-" + "9" * 5000, "NaN", "-Infinity")
_NUMBERS = (1e30, 1e308, -1e308, 10**400, -(10**400), 2**63, math.nan, math.inf)


def _nested(member: str, number: object) -> list[object]:
    """A number in each place where a member may hold one."""
    inside = [{"depth": number}, {"deadline": number}, {"lifespan": {"secs": number, "nsecs": number}}]
    return [number, {"sec": number}, *(inside if member == "qos" else [])]


_ONE_OF_EACH = {example.message["op"]: example for example in EXAMPLES.examples if example.valid}


@pytest.mark.parametrize("op", OPS)
@pytest.mark.parametrize("profile", PROFILES.values(), ids=lambda profile: str(profile.name))
def test_no_number_is_too_large_to_be_refused(op: str, profile: Profile) -> None:
    valid = _ONE_OF_EACH[op].message
    for direction in Direction:
        for member in (*OPS[op].model.model_fields, "unknown"):
            for text in _EXTREMES:
                for place in _nested(member, "HERE"):
                    written = json.dumps(valid | {member: place}).replace('"HERE"', text)
                    check(Session(profile, direction), written.encode(), False, with_ops=False)
            for number in _NUMBERS:
                for place in _nested(member, number):
                    message = valid | {member: place}
                    check(Session(profile, direction), cbor2.dumps(message), True, with_ops=False)
                    with contextlib.suppress(OverflowError):  # BSON has no such number
                        session = Session(profile, direction, codec=bson_codec())
                        check(session, bson.encode(message), True, with_ops=False)


@pytest.mark.parametrize(
    ("message", "where"),
    [
        ({"op": "subscribe", "topic": "/a", "queue_length": 0}, "queue_length"),
        ({"op": "subscribe", "topic": "/a", "throttle_rate": 0}, "throttle_rate"),
        ({"op": "subscribe", "topic": "/a", "fragment_size": 0}, "fragment_size"),
        ({"op": "subscribe", "topic": "/a", "qos": {"depth": 0}}, "qos.depth"),
        ({"op": "subscribe", "topic": "/a", "qos": {"deadline": 0}}, "qos.deadline"),
        ({"op": "subscribe", "topic": "/a", "qos": {"lifespan": 0}}, "qos.lifespan"),
        ({"op": "advertise", "topic": "/a", "type": "a/A", "queue_size": 0}, "queue_size"),
        ({"op": "publish", "topic": "/a", "queue_size": 0}, "queue_size"),
        ({"op": "call_service", "service": "/a", "timeout": 0}, "timeout"),
        ({"op": "call_service", "service": "/a", "id": 0}, "id"),
        ({"op": "action_result", "action": "/a", "status": 0}, "status"),
        ({"op": "fragment", "id": "", "data": "", "num": 0, "total": 1}, "num"),
        ({"op": "fragment", "id": "", "data": "", "num": 0, "total": 1}, "total"),
        ({"op": "auth", "mac": "", "client": "", "dest": "", "rand": "", "level": "", "end": 0, "t": 0}, "t"),
    ],
)
@pytest.mark.parametrize("number", [1e30, 1e308, -1e308, 10**40, -(10**400), 10**400])
def test_a_number_out_of_range_is_refused_by_its_name(
    message: dict[str, Any], where: str, number: float
) -> None:
    outer, _, inner = where.partition(".")
    changed = message | {outer: {inner: number} if inner else number}
    op, answers = message["op"], []
    for data in (json.dumps(changed).encode(), cbor2.dumps(changed)):
        refusal = only(Session().decode(data, data[:1] != b"{", 0.0), Refusal)
        answers.append(refusal.reason)
    assert answers[1].startswith(f"{op}.{where}: expected ")
    assert answers[0].startswith((f"{op}.{where}: expected ", f"{op}.{outer}: holds a number too large"))
