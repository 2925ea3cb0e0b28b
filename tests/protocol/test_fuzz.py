"""Whatever arrives becomes ops or refusals: no exception, and a bounded number of both."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.codecs import JSON
from rwt_protocol.codecs.full_split import MOST_MESSAGES
from rwt_protocol.ops import Direction
from rwt_protocol.profiles import PROFILES
from rwt_protocol.session import Refusal, Session
from tests.protocol.wire_examples import EXAMPLES

_SESSIONS = st.builds(
    Session,
    st.sampled_from(list(PROFILES.values())),
    st.sampled_from([Direction.TO_SERVER, Direction.TO_CLIENT]),
)
_FRAMES = [json.dumps(example.message).encode() for example in EXAMPLES.examples]
_MEMBERS = [
    "op",
    "id",
    "topic",
    "service",
    "action",
    "msg",
    "args",
    "values",
    "level",
    "qos",
    "type",
    "receiver",
    "x",
]
_VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)
_NEAR_OBJECTS = st.dictionaries(st.sampled_from(_MEMBERS), _VALUES | st.sampled_from(["publish", "/a"]))


def check(session: Session, data: bytes, binary: bool) -> None:
    found = session.decode(data, binary, 0.0)
    assert 0 <= len(found) <= MOST_MESSAGES + 1
    for item in found:
        if isinstance(item, Refusal):
            assert 0 < len(item.reason) < 1000
        answer = item.answer if isinstance(item, Refusal) else item
        if answer is not None:
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
