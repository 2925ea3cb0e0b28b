"""The usual small `publish` is known by its ends, and is what a parse of the whole frame finds."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rwt_protocol.codecs import JSON
from rwt_protocol.codecs.bson import BsonCodec
from rwt_protocol.codecs.quick_frames import QUICK, split_publish
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Direction
from rwt_protocol.profiles import PROFILES
from rwt_protocol.session import Session

USUAL = b'{"op":"publish","topic":"/t","msg":{"data":1}}'


@pytest.mark.parametrize(
    "text",
    [
        USUAL,
        b'{"op":"publish","id":"publish:/t:1","topic":"/t","msg":{"data":1},"latch":false}',
        b'{"op": "publish", "id": "publish:/t:1", "topic": "/t", "msg": {"data":1}, "latch": false}',
        b'{"op": "publish", "topic": "/t", "type": "std_msgs/Int32", "msg": {"data":1}}',
    ],
    ids=["nothing more", "roslibjs", "roslibpy", "with its type"],
)
def test_the_spellings_of_the_libraries_are_known(text: bytes) -> None:
    assert split_publish(text) == (b"/t", b'{"data":1}')


@pytest.mark.parametrize(
    "text",
    [
        b'{"op":"publish","topic":"/t","msg":{"data":1},"latch":true}',
        b'{"op":"publish","topic":"/t","msg":{"data":1} }',
        b'{"op":"publish","topic":"/t","msg":[1]}',
        b'{"op":"publish","topic":"/\\u0074","msg":{"data":1}}',
        b'{"op":"publish","topic":"/t","qos":{"depth":1},"msg":{"data":1}}',
        b'{"op":"publish","id":5,"topic":"/t","msg":{"data":1}}',
        b'{"topic":"/t","op":"publish","msg":{"data":1}}',
        b'{"op":"call_service","topic":"/t","msg":{"data":1}}',
        '{"op":"publish","topic":"/t","msg":{"data":"é"}}'.encode(),
        b'{"op":"publish","topic":"/t","msg":{"data":"' + b"x" * QUICK + b'"}}',
        b'{"op":"publish","topic":"/t","msg":{"data":[' + b"1e300," * 1_001 + b"0]}}",
        USUAL + b"\n",
        USUAL[:-1],
        b"",
    ],
)
def test_others_are_left_to_the_parse(text: bytes) -> None:
    assert split_publish(text) is None


def _frames() -> st.SearchStrategy[bytes]:
    """Frames that begin and end as the usual ones do, and hold anything that has to do with them."""
    pieces = st.sampled_from(
        [
            '{"data":1}', '"msg":', '"topic":"/u"', '"m\\u0073g":', "{", "}", ",", '"', '\\"', "\\", ":",
            '"latch":false', ',"latch":false}', '"op":"subscribe"', "NaN", "[", "]", "1", " ", "{}", '"x"',
            '{"op":"publish","topic":"/v"',
        ]
    )  # fmt: skip
    heads = st.sampled_from(
        [
            '{"op":"publish","topic":"/t","msg":{',
            '{"op":"publish","id":"a","topic":"/t","msg":{',
            '{"op": "publish", "topic": "/t", "type": "x", "msg": {',
        ]
    )
    tails = st.sampled_from(["}}", '},"latch":false}', '}, "latch": false}'])
    inside = st.lists(pieces, max_size=8).map("".join)
    return st.builds(lambda head, between, tail: (head + between + tail).encode(), heads, inside, tails)


@given(_frames())
@example(b'{"op":"publish","topic":"/t","msg":{},"topic":"/u","msg":{}}')
@example(b'{"op":"publish","topic":"/t","msg":{}}{"op":"publish","topic":"/u","msg":{}}')
@example(b'{"op":"publish","topic":"/t","msg":{"a":"},\\"latch\\":false}"}}')
def test_a_payload_that_is_json_makes_the_frame_that_message(frame: bytes) -> None:
    found = split_publish(frame)
    assert found is not None
    topic, payload = found
    try:
        value = msgspec.json.decode(payload)
    except msgspec.DecodeError:
        return
    (members,) = JSON.split(frame, WireLimits())
    assert isinstance(members, dict)
    assert set(members) - {"id", "type", "latch"} == {"op", "topic", "msg"}
    assert members["topic"] == topic.decode()
    assert members.get("latch", False) is False
    undecoded: Any = members["msg"]
    assert json.loads(bytes(undecoded)) == value


def test_a_session_takes_no_frame_apart_so_where_it_may_not() -> None:
    assert Session().is_quick
    assert not Session(limits=WireLimits(max_message_size=100)).is_quick
    assert not Session(limits=WireLimits(max_depth=4)).is_quick
    assert not Session(direction=Direction.TO_CLIENT).is_quick
    assert not Session(codec=BsonCodec()).is_quick


@pytest.mark.parametrize("name", [name for name, each in PROFILES.items() if "set_level" in each.ops])
def test_who_is_told_of_defaults_and_successes_is_read_in_full(name: str) -> None:
    session = Session(PROFILES[name])
    for level, usual in (("info", False), ("error", True), ("warning", False), ("none", True)):
        session.decode(b'{"op":"set_level","level":"%b"}' % level.encode(), False, 0.0)
        assert session.is_quick is usual
