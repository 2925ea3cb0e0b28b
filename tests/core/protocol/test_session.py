"""One peer's wire state: what frames become, in which profile, and what the peer hears of it."""

from __future__ import annotations

import json

import pytest

from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import (
    ActionResult,
    Advertise,
    AdvertiseAction,
    CallService,
    Direction,
    Op,
    Publish,
    ServiceResponse,
    Status,
    Subscribe,
    Unsubscribe,
)
from rwt_protocol.profiles import COMPAT, PROFILES, ROS1, ROS2_2024, V2_0_0, Profile
from rwt_protocol.session import Refusal, Session
from tests.core.protocol.wire_examples import EXAMPLES, Malformed, only, text_of

A = b'{"op":"subscribe","topic":"/a"}'
B = b'{"op":"subscribe","topic":"/b"}'
OP_A = Subscribe(topic="/a")
OP_B = Subscribe(topic="/b")


def decode(data: bytes, session: Session | None = None, *, binary: bool = False) -> list[Op | Refusal]:
    return list((session or Session()).decode(data, binary, 0.0))


def refusals(data: bytes, session: Session | None = None, *, binary: bool = False) -> list[str]:
    found = decode(data, session, binary=binary)
    assert all(isinstance(item, Refusal) for item in found), found
    return [item.reason for item in found if isinstance(item, Refusal)]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "the message is empty"),
        (b" \r\n", "the message is empty"),
        (b"hello", "not JSON: expected an object that starts with {"),
        (b"[1,2]", "expected an object, got an array"),
        (b"[" + A + b"]", "expected an object, got an array"),
        (b"5", "expected an object, got a number"),
        (b"null", "expected an object, got null"),
        (b"true", "expected an object, got true"),
        (b'"op"', "expected an object, got a string"),
        (A[:-1], "not JSON: cut short after 30 bytes"),
        (b'{"op":}', "not JSON: an object or array is malformed"),
        (b'{"a":' + A[:-1], "not JSON: cut short after 35 bytes"),
        (b'{"op":"subscribe","topic":"\xff"}', "not UTF-8, at byte 27"),
        (b'{"op":"publish","topic":"/a","msg":{"x":"\xed\xa0\x80"}}', "not UTF-8, at byte 41"),
        (b'{"op":"subscribe","topic":"\\ud800"}', "not JSON: malformed, or text that is not Unicode"),
        (b'{"op":7}', "op: expected a string, got 7"),
        (b'{"op":{"a":1}}', "op: expected a string, got an object"),
        (b'{"op":["publish"]}', "op: expected a string, got an array"),
        (b'{"receiver":"/a","msg":{}}',
         'a message of rosbridge v1 ("receiver"): in v2 every message has an "op"'),
        (b'{"op":"status","level":"info","msg":""}', 'operation "status" only goes server to client'),
        (b'{"op":"subscribe","topic":"/a","queue_length":1e999}',
         "subscribe.queue_length: holds a number too large, or text that is not Unicode"),
        (b'{"op":"subscribe","topic":"/a","id":' + b"9" * 5000 + b"}",
         "subscribe.id: holds a number too large, or text that is not Unicode"),
        (b'{"op":"subscribe","topic":"/a","id":' + b"9" * 100 + b"}", None),
    ],
)  # fmt: skip
def test_what_is_not_a_message_is_refused(data: bytes, reason: str | None) -> None:
    for _ in range(2):
        (found,) = refusals(data)
        if reason is not None:
            assert found == reason


@pytest.mark.parametrize("malformed", EXAMPLES.malformed, ids=lambda malformed: str(malformed.name))
def test_a_malformed_frame_does_not_poison_the_next(malformed: Malformed) -> None:
    session = Session()
    first = decode(malformed.text.encode(), session)
    if malformed.name == "two-objects-one-frame":
        assert [type(item) for item in first] == [Subscribe, Subscribe]
    elif malformed.name == "png-key":
        assert first == [Unsubscribe(topic="/a")]
    else:
        assert [type(item) for item in first] == [Refusal]
    assert decode(A, session) == [OP_A]


def test_unknown_ops_name_the_nearest_and_all() -> None:
    (reason,) = refusals(b'{"op":"pubish"}')
    assert reason.startswith(
        'unknown operation "pubish" (did you mean "publish"?): expected one of action_feedback, '
    )
    assert ", unadvertise, " in reason and ", unsubscribe" in reason
    (reason,) = refusals(b'{"id":5}')
    assert reason.startswith('no "op": expected one of action_feedback, ')


def test_several_messages_in_one_frame_are_all_handled_in_order() -> None:
    for glue in (b"", b"\n", b" \t\r\n "):
        assert decode(A + glue + B + glue + A + glue) == [OP_A, OP_B, OP_A]


def test_garbage_around_messages_is_refused_and_they_still_run() -> None:
    garbage = Refusal
    kinds = [type(item) for item in decode(b"x " + A + b' } it"s ' + B + b" tail")]
    assert kinds == [garbage, Subscribe, garbage, Subscribe, garbage]


def test_nothing_inside_a_broken_message_runs() -> None:
    inner = b'{"op":"fragment","data":' + A + b","
    assert refusals(inner) == [f"not JSON: cut short after {len(inner)} bytes"]
    assert refusals(b'{"a" ' + A + b"}" + B) == ["not JSON: an object or array is malformed"]
    assert [type(item) for item in decode(A + b'{"x":[' + B)] == [Subscribe, Refusal]
    assert refusals(b"[" + A) == [f"not JSON: cut short after {len(A) + 1} bytes"]


def test_half_a_message_is_not_kept() -> None:
    session = Session()
    for end in range(1, len(A)):
        assert len(refusals(A[:end], session)) == 1
        assert all(isinstance(item, Refusal) for item in decode(A[end:], session))


def test_the_number_of_messages_in_a_frame_is_bounded() -> None:
    found = decode(b"{}" * 5000)
    assert len(found) == 1001
    last = found[-1]
    assert isinstance(last, Refusal)
    assert last.reason == "more than 1000 messages in one frame; the rest was dropped"


def test_of_equal_keys_the_last_counts() -> None:
    data = b'{"op":"subscribe","topic":"/b","op":"unsubscribe","topic":"/a"}'
    assert decode(data) == [Unsubscribe(topic="/a")]


def test_the_constants_that_python_writes_are_null() -> None:
    data = b'{"op":"publish","topic":"NaN","msg":{"x":NaN,"y":[-Infinity,Infinity],"z":"NaN, \\"Infinity"}}'
    op = only(decode(data), Publish)
    assert op.topic == "NaN"
    assert text_of(op.msg).data == b'{"x":null,"y":[null,null],"z":"NaN, \\"Infinity"}'
    assert text_of(op.msg).is_validated


def test_sizes_and_depths_are_limited() -> None:
    session = Session(limits=WireLimits(max_message_size=100, max_depth=5))
    assert refusals(b"x" * 101, session) == ["101 bytes: the limit is 100 (max_message_size)"]
    deep = b'{"op":"publish","topic":"/a","id":"i","msg":%s}'
    assert isinstance(decode(deep % b'{"a":[[[]]]}', session)[0], Publish)
    refusal = only(decode(deep % b'{"a":[[[[]]]]}', session), Refusal)
    assert refusal.reason == "nested more than 5 levels deep (limits.max_depth)"
    assert (refusal.op, refusal.id) == ("publish", "i")


@pytest.mark.parametrize("opening", [b"[", b'{"a":'])
@pytest.mark.parametrize("prefix", [b"", b'{"op":"publish","topic":"/a","msg":', b'{"op":"publish","topic":'])
@pytest.mark.parametrize("closing", [True, False])
def test_a_nesting_bomb_is_refused(opening: bytes, prefix: bytes, closing: bool) -> None:
    tail = (
        (b"1" + (b"]" if opening == b"[" else b"}") * 200_000 + (b"}" if prefix else b"")) if closing else b""
    )
    found = decode(prefix + opening * 200_000 + tail)
    for item in found:
        if isinstance(item, Publish):
            # Its payload was cut out unseen; a reader that wants it proven is told.
            assert not text_of(item.msg).is_validated
        else:
            assert isinstance(item, Refusal)
    assert len(found) == 1


def test_binary_frames_hold_json_text() -> None:
    assert decode(A, binary=True) == [OP_A]
    assert decode(b"\n" + A, binary=True) == [OP_A]
    assert refusals(b"", binary=True) == ["the message is empty"]
    assert refusals(b"\x01\x02", binary=True) == ["not JSON: expected an object that starts with {"]
    assert refusals(b"\xff\xfe", binary=True) == ["not UTF-8, at byte 0"]


@pytest.mark.parametrize(
    ("message", "name", "reason"),
    [
        (b'{"op":"call_service","id":"x","args":{}}', "",
         "call_service.service: expected a string, and it is missing"),
        (b'{"op":"call_service","id":7,"service":"/s","timeout":"5"}', "/s",
         'call_service.timeout: expected a number of seconds, got "5"'),
        (b'{"op":"call_service","id":7,"service":"/s","timeout":1e999}', "/s",
         "call_service.timeout: holds a number too large, or text that is not Unicode"),
        (b'{"op":"send_action_goal","id":"g","action":"/f"}', "/f",
         "send_action_goal.action_type: expected a string, and it is missing"),
    ],
)  # fmt: skip
def test_a_request_that_cannot_be_read_is_still_answered(message: bytes, name: str, reason: str) -> None:
    refusal, id = only(decode(message), Refusal), json.loads(message)["id"]
    assert (refusal.op, refusal.id, refusal.name) == (json.loads(message)["op"], id, name)
    assert refusal.reason == reason
    if refusal.op == "call_service":
        assert refusal.answer == ServiceResponse(service=name, values=reason, result=False, id=id)
    else:
        assert refusal.answer == ActionResult(action=name, values=reason, result=False, status=0, id=id)


@pytest.mark.parametrize("name", ["set_level", "set_status_level", "status_level"])
def test_the_session_keeps_the_level(name: str) -> None:
    session = Session()
    levels = [session.level]
    assert decode(json.dumps({"op": name, "level": "warning", "id": None}).encode(), session) == []
    levels.append(session.level)
    assert len(refusals(b'{"op":"set_level","level":"loud"}', session)) == 1
    levels.append(session.level)
    assert levels == [None, "warning", "warning"]


@pytest.mark.parametrize(
    ("level", "heard"),
    [("info", "info warning error"), ("warning", "warning error"), ("error", "error"), ("none", "")],
)
def test_levels_are_cumulative(level: str, heard: str) -> None:
    session = Session(ROS1)
    decode(json.dumps({"op": "set_level", "level": level}).encode(), session)
    assert [name for name in ("info", "warning", "error") if session.wants_status(name)] == heard.split()
    assert not session.wants_status("none")


def test_when_status_is_sent_depends_on_the_profile() -> None:
    status = Status(level="error", msg="no")
    wants = {profile.name: Session(profile).answer(status) is not None for profile in PROFILES.values()}
    assert wants == {"compat": False, "ros1": True, "ros2-2024": True, "2.0.0": False}
    session = Session(COMPAT)
    decode(b'{"op":"set_level","level":"error"}', session)
    frame = session.answer(status)
    assert frame is not None
    assert frame.data == b'{"op":"status","level":"error","msg":"no"}'
    assert session.answer(ServiceResponse(service="/s", values="no", result=False)) is not None


def test_set_level_is_unknown_where_there_is_no_status() -> None:
    session = Session(V2_0_0)
    (reason,) = refusals(b'{"op":"set_level","level":"info"}', session)
    assert reason.startswith('unknown operation "set_level"')
    assert session.level is None
    (reason,) = refusals(b'{"op":"status_level","level":"info"}', session)
    assert reason.startswith('unknown operation "status_level"')


def test_ops_and_members_of_other_profiles_do_not_exist() -> None:
    action = b'{"op":"advertise_action","action":"/f","type":"x/F"}'
    assert isinstance(decode(action, Session(ROS2_2024))[0], AdvertiseAction)
    assert "unknown operation" in refusals(action, Session(ROS1))[0]
    call = b'{"op":"call_service","service":"/s","timeout":"wrong","type":5}'
    assert decode(call, Session(ROS1)) == [CallService(service="/s")]
    assert len(refusals(call, Session(COMPAT))) == 1
    assert decode(b'{"op":"publish","topic":"/a","type":"x/Y"}', Session(V2_0_0)) == [
        Publish(topic="/a", type="x/Y")
    ]


@pytest.mark.parametrize("profile", PROFILES.values(), ids=lambda profile: str(profile.name))
def test_what_every_client_sends_is_in_every_profile(profile: Profile) -> None:
    advertise = b'{"op":"advertise","id":"a","type":"x/Y","topic":"/t","latch":false,"queue_size":100}'
    op = only(decode(advertise, Session(profile)), Advertise)
    assert op.queue_size == 100


def test_the_same_models_serve_a_client() -> None:
    session = Session(direction=Direction.TO_CLIENT)
    assert decode(b'{"op":"status","level":"error","msg":"no","id":"a"}', session) == [
        Status(level="error", msg="no", id="a")
    ]
    refusal = only(decode(A, session), Refusal)
    assert refusal.reason == 'operation "subscribe" only goes client to server'
    assert refusal.answer is None
    refusal = only(decode(b'{"op":"status","level":"error","msg":{"x":1}}', session), Refusal)
    assert refusal.reason == "status.msg: expected a string, got an object"
    refusal = only(decode(b'{"op":"call_service","id":"r","service":5}', session), Refusal)
    assert isinstance(refusal.answer, ServiceResponse)
