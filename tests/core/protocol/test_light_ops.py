"""Common small messages become light ops, which have the members that the general path finds."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rwt_protocol.codecs.bson import BsonCodec
from rwt_protocol.codecs.quick_frames import PARSED_BYTES, QUICK_BYTES
from rwt_protocol.errors import Misread
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Direction, Op
from rwt_protocol.ops.light import LIGHT
from rwt_protocol.payloads import RawJson
from rwt_protocol.profiles import PROFILES, ROS1, Profile
from rwt_protocol.session import Refusal, Session

LightSession = partial(Session, light=True)
USUAL = b'{"op":"publish","topic":"/t","msg":{"data":1}}'
LONG_ID = b'"id":"' + b"x" * PARSED_BYTES + b'"'


def _long(frame: bytes) -> bytes:
    """Return a frame whose `publish` is only matched at its ends, because of its long id."""
    for id_ in (b'"id":"publish:/t:1"', b'"id": "publish:/t:1"'):
        frame = frame.replace(id_, LONG_ID)
    return frame if LONG_ID in frame else frame.replace(b'"topic":"/t"', LONG_ID + b',"topic":"/t"', 1)


def _is_light(op: object) -> bool:
    return isinstance(op, tuple(LIGHT.values()))


def _decoded(session: Session, text: bytes) -> Sequence[Op | Refusal]:
    """Return the messages of a frame; a light op whose message cannot be validated is read again."""
    found = session.decode(text, False, 0.0)
    message = getattr(found[0], "msg", None) if len(found) == 1 and _is_light(found[0]) else None
    try:
        if isinstance(message, RawJson):
            assert message.json() == message.data
    except Misread as misread:
        return session.decode_again(misread, 0.0)
    return found


def _read(session: Session, text: bytes) -> Op | Refusal:
    (found,) = _decoded(session, text)
    return found


def _assert_same(light: object, full: object) -> None:
    """Check all members of an op."""
    assert isinstance(full, Op)
    assert _is_light(light)
    assert LIGHT[type(full)] is type(light)
    for name in type(full).model_fields:
        assert getattr(light, name) == getattr(full, name), name


@pytest.mark.parametrize(
    "text",
    [
        USUAL,
        b'{"op":"publish","id":"publish:/t:1","topic":"/t","msg":{"data":1},"latch":false}',
        b'{"op": "publish", "id": "publish:/t:1", "topic": "/t", "msg": {"data":1}, "latch": false}',
        b'{"op": "publish", "topic": "/t", "type": "std_msgs/Int32", "msg": {"data":1}}',
        b'{"op":"publish","topic":"/t","msg":{"data":1},"latch":true}',
        b'{"op":"publish","topic":"/\\u0074","msg":{"data":1} }',
        b'{"topic":"/t","msg":[1],"op":"publish"}',
        b'{"op":"publish","topic":"/t","id":null,"msg":{"data":1}}',
        b'{"op":"publish","topic":"/t","msg":{"data":1},"topic":"/u"}',
        b'{"op":"publish","topic":"/t","msg":{"data":"' + b"x" * 10_000 + b'"}}',
        b'{"op":"call_service","id":"7","service":"/add","args":{"a":1}}',
        b'{"op":"call_service","id":"7","service":"/add","type":"std_srvs/Empty","args":{}}',
        b'{"op":"service_response","id":"7","service":"/add","values":{"sum":1},"result":true}',
        b'{"op":"service_response","id":"7","service":"/add","values":{}}',
        b'{"op":"service_response","service":"/add","values":{},"result":false}',
    ],
)
@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_a_light_op_has_the_members_of_its_op(text: bytes, profile: Profile) -> None:
    _assert_same(_read(LightSession(profile), _long(text)), _read(Session(profile), _long(text)))
    _assert_same(_read(LightSession(profile), text), _read(Session(profile), text))


@pytest.mark.parametrize(
    "text",
    [
        b'{"op":"publish","topic":"/t","qos":{"depth":1},"msg":{"data":1}}',
        b'{"op":"publish","id":5,"topic":"/t","msg":{"data":1}}',
        b'{"op":"publish","topic":"/t"}',
        b'{"op":"publish","topic":5,"msg":{"data":1}}',
        b'{"op":"publish","id":"' + b"x" * 4097 + b'","topic":"/t","msg":{"data":1}}',
        '{"op":"publish","topic":"/t","msg":{"data":"\u00e9"}}'.encode(),
        b'{"op":"publish","topic":"/t","msg":{"data":"' + b"x" * QUICK_BYTES + b'"}}',
        b'{"op":"publish","topic":"/t","msg":{"data":[' + b"1e300," * 1_001 + b"0]}}",
        b'{"op":"publish","topic":"/t","msg":' + b"[" * 100 + b"]" * 100 + b"}",
        b'{"op":"publish","topic":"/t","msg":' + b'{"a":' * 100 + b"1" + b"}" * 101,
        USUAL[:-1] + b',"x":{"y":1}}',
        USUAL.replace(b"1", b"NaN"),
        b'{"op":"call_service","service":"/add","args":[1,2]}',
        b'{"op":"call_service","service":"/add"}',
        b'{"op":"call_service","service":"/add","args":{},"timeout":1.0}',
        b'{"op":"service_response","id":"7","service":"/add","values":"no","result":false}',
        b'{"op":"subscribe","topic":"/t"}',
        USUAL + USUAL,
        USUAL[:-1],
        b"",
    ],
)
@pytest.mark.parametrize("is_long", [False, True], ids=["short", "long"])
def test_others_are_left_to_the_general_path(text: bytes, is_long: bool) -> None:
    frame = _long(text) if is_long else text
    found = _decoded(LightSession(), frame)
    assert not any(map(_is_light, found))
    assert found == Session().decode(frame, False, 0.0)


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
            '{"op":"publish",' + LONG_ID.decode() + ',"topic":"/t","msg":{',
            '{"op": "publish", "topic": "/t", "type": "x", "msg": {',
        ]
    )
    tails = st.sampled_from(["}}", '},"latch":false}', '}, "latch": false}'])
    inside = st.lists(pieces, max_size=8).map("".join)
    return st.builds(lambda head, between, tail: (head + between + tail).encode(), heads, inside, tails)


@given(_frames())
@example(_long(b'{"op":"publish","topic":"/t","msg":{},"topic":"/u","msg":{}}'))
@example(_long(b'{"op":"publish","topic":"/t","msg":{}}{"op":"publish","topic":"/u","msg":{}}'))
@example(_long(b'{"op":"publish","topic":"/t","msg":{"a":"},\\"latch\\":false}"}}'))
def test_both_paths_find_the_same_messages(frame: bytes) -> None:
    light, full = (_decoded(session, frame) for session in (LightSession(), Session()))
    assert len(light) == len(full)
    for one, other in zip(light, full, strict=True):
        if _is_light(one):
            _assert_same(one, other)
        else:
            assert one == other


def test_only_sessions_that_can_return_light_ops() -> None:
    def makes(session: Session) -> bool:
        return any(map(_is_light, _decoded(session, USUAL)))

    assert makes(LightSession())
    assert not makes(Session())
    assert not makes(LightSession(limits=WireLimits(max_message_size=100)))
    assert not makes(LightSession(limits=WireLimits(max_depth=1)))
    assert makes(LightSession(direction=Direction.TO_CLIENT))
    assert not makes(LightSession(codec=BsonCodec()))
    assert not any(map(_is_light, LightSession().decode(USUAL, True, 0.0)))


def test_a_client_that_wants_warnings() -> None:
    session = LightSession(ROS1)
    for level, wants in (("info", True), ("error", False), ("warning", True), ("none", False)):
        session.decode(b'{"op":"set_level","level":"%b"}' % level.encode(), False, 0.0)
        assert session.wants_warnings is wants


@pytest.mark.parametrize("frame", [USUAL, _long(USUAL)], ids=["short", "long"])
def test_payloads_do_not_keep_the_frame_alive(frame: bytes) -> None:
    op = _read(LightSession(), frame)
    message: object = getattr(op, "msg", None)
    assert isinstance(message, RawJson)
    assert type(message.data) is bytes
    assert json.loads(message.data) == {"data": 1}


def test_a_long_message_is_not_parsed_before_its_type_reads_it() -> None:
    op = _read(LightSession(), _long(USUAL))
    message: object = getattr(op, "msg", None)
    assert isinstance(message, RawJson)
    assert not message.is_validated
