"""Large frames are read at their ends alone, and the outcome is that of a full parse."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rwt_protocol.codecs.head_tail_split import LARGE, split_large
from rwt_protocol.errors import MalformedPayload
from rwt_protocol.limits import WireLimits, has_more_brackets
from rwt_protocol.ops import OPS, Publish
from rwt_protocol.payloads import RawJson
from rwt_protocol.session import Refusal, Session
from tests.core.protocol.wire_examples import only, text_of

FILL = "x" * (LARGE + 1)


def full(data: bytes) -> tuple[dict[str, Any], RawJson] | None:
    """Return the result of both steps: the members, and the parsed payload."""
    members = split_large(data, 100)
    if members is None:
        return None
    (payload,) = [value for value in members.values() if isinstance(value, RawJson)]
    return members, payload


def check_like_a_full_parse(data: bytes) -> None:
    found = full(data)
    if found is None:
        return
    members, payload = found
    assert not payload.is_validated
    try:
        value = json.loads(bytes(payload.data))
    except ValueError:
        value = _proven(payload)
        if value is None:
            return
    name = next(key for key, member in members.items() if member is payload)
    expected = json.loads(data)
    assert value == expected.pop(name)
    for key, member in members.items():
        if key in expected and key not in ("msg", "args", "values"):
            assert member == expected[key]


def _proven(payload: RawJson) -> Any:
    try:
        return json.loads(bytes(payload.json()))
    except MalformedPayload:
        return None


@pytest.mark.parametrize(
    "text",
    [
        '{"op":"publish","topic":"/a","msg":{"data":"FILL"}}',
        ' \n{ "op" : "publish" , "topic" : "/a" , "msg" : {"data":"FILL"} } \n',
        '{"op":"publish","id":"i","topic":"/a","msg":{"data":"FILL"},"latch":false}',
        '{"msg":{"data":"FILL"},"topic":"/a","op":"publish"}',
        '{"op":"publish","qos":{"depth":1,"deadline":{"secs":1,"nsecs":2}},"topic":"/a","msg":{"data":"FILL"}}',
        '{"op":"publish","topic":"/a","msg":{"data":"FILL"},"qos":{"depth":1,"deadline":{"secs":1,"nsecs":2}}}',
        '{"op":"publish","topic":"/\\"},{\\\\","msg":{"data":"FILL"},"id":",\\"a\\":1}"}',
        '{"op":"publish","topic":"/ä","msg":{"data":"FILL","a":[{"b":"}}"}]},"latch":true}',
        '{"op":"call_service","service":"/s","args":["FILL"],"id":7}',
        '{"op":"service_response","service":"/s","values":{"a":"FILL"},"result":true,"id":"a"}',
    ],
)
def test_usual_messages_are_cut_out_right(text: str) -> None:
    data = text.replace("FILL", FILL).encode()
    found = full(data)
    assert found is not None
    check_like_a_full_parse(data)
    members, payload = found
    assert (
        json.loads(bytes(payload.data))
        == json.loads(data)[next(k for k, v in members.items() if v is payload)]
    )
    assert bytes(payload.json()) == bytes(payload.data)
    assert payload.validated().is_validated


@pytest.mark.parametrize(
    "text",
    [
        '{"op":"publish","topic":"/a","args":{},"msg":{"data":"FILL"}}',
        '{"op":"publish","topic":"/a","msg":{"data":"FILL"},"msg":{}}',
        '{"op":"publish","topic":"/a","msg":"FILL"}',
        '{"op":"publish","topic":"/a","\\u006dsg":{"data":"FILL"}}',
        '{"op":"status","level":"info","msg":"FILL"}',
        '{"op":"service_response","service":"/s","values":"FILL","result":false}',
        '{"op":"publish","topic":"/a" "msg":{"data":"FILL"}}',
        '{"op":"publish","topic":1e999,"msg":{"data":"FILL"}}',
        '{"op":"publish","topic":nul,"msg":{"data":"FILL"}}',
        '[{"op":"publish","topic":"/a","msg":{"data":"FILL"}}]',
        '{"op":["publish"],"topic":"/a","msg":{"data":"FILL"}}',
        '{"topic":"/a","msg":{"data":"FILL"}}',
    ],
)
def test_unusual_messages_are_left_to_the_full_parse(text: str) -> None:
    assert split_large(text.replace("FILL", FILL).encode(), 100) is None


def test_two_messages_in_a_large_frame_both_run() -> None:
    text = '{"op":"publish","topic":"/a","msg":{"data":"FILL"}}{"op":"publish","topic":"/b","msg":{}}'
    found = Session().decode(text.replace("FILL", FILL).encode(), False, 0.0)
    assert [op.topic for op in found if isinstance(op, Publish)] == ["/a", "/b"]


@pytest.mark.parametrize(
    ("text", "msg"),
    [
        ('{"op":"publish","topic":"/a","msg":{"data":"FILL"},"extra":[[[1]]]}', {"data": FILL}),
        ('{"op":"publish","topic":"/a","msg":{"data":"FILL","x":NaN}}', {"data": FILL, "x": None}),
        ('{"op":"publish","topic":"/a","msg":{"data":"FILL"},"extra":{"a":[[]]},"latch":true}',
         {"data": FILL}),
    ],
)  # fmt: skip
def test_a_cut_at_the_wrong_place_is_mended_by_the_proof(text: str, msg: object) -> None:
    op = only(Session().decode(text.replace("FILL", FILL).encode(), False, 0.0), Publish)
    assert json.loads(bytes(text_of(op.msg).json())) == msg


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('{"op":"publish","topic":"/a","msg":{"data":"FILL"]}', "not JSON: an object or array is malformed"),
        ('{"op":"publish","topic":"/a","msg":{"data":"FILL"},"topic":"/b","x":[[[1]]]}',
         'in a message of more than 32768 bytes "msg" must be the last member'),
        ('{"op":"publish","topic":"/a","msg":{"data":"FILL"}', "not JSON: cut short after 32815 bytes"),
        ('{"op":"publish","topic":"/a","msg":{"data":"FILL"}}{"op":"unadvertise","topic":"/b","x":[[[1]]]}',
         "a message of more than 32768 bytes must be alone in its frame"),
        ('{"op":"publish","topic":"/a","msg":' + "[" * 200 + '"FILL"' + "]" * 200 + "}",
         "nested more than 100 levels deep (limits.max_depth)"),
    ],
)  # fmt: skip
def test_what_the_proof_refuses(text: str, reason: str) -> None:
    op = only(Session().decode(text.replace("FILL", FILL).encode(), False, 0.0), Publish)
    with pytest.raises(MalformedPayload) as caught:
        text_of(op.msg).validated()
    assert caught.value.reason == reason


def test_utf8_is_checked_at_the_ends_at_once_and_in_the_payload_by_the_proof() -> None:
    data = b'{"op":"publish","topic":"/\xff","msg":{"data":"' + FILL.encode() + b'"}}'
    refusal = only(Session().decode(data, False, 0.0), Refusal)
    assert refusal.reason == "not UTF-8, at byte 26"
    data = b'{"op":"publish","topic":"/a","msg":{"data":"\xff' + FILL.encode() + b'"}}'
    op = only(Session().decode(data, False, 0.0), Publish)
    with pytest.raises(MalformedPayload, match="not UTF-8, at byte 44"):
        text_of(op.msg).validated()


def test_only_large_frames_are_left_unproven() -> None:
    data = b'{"op":"publish","topic":"/a","msg":{"data":"%s"}}'
    for size, is_validated in ((LARGE - 60, True), (LARGE + 60, False)):
        op = only(Session().decode(data % (b"x" * size), False, 0.0), Publish)
        assert text_of(op.msg).is_validated is is_validated
        assert isinstance(text_of(op.msg).data, bytes) is is_validated


_TEXT = st.text(alphabet='"\\{}[],:ab \n\u00e4', max_size=12)
_SCALAR = st.one_of(st.none(), st.booleans(), st.integers(-9, 9), st.floats(-9, 9), _TEXT)
_VALUE = st.recursive(
    _SCALAR,
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(_TEXT, inner, max_size=3)),
    max_leaves=8,
)
_NAMES = st.one_of(
    _TEXT, st.sampled_from(["topic", "id", "type", "latch", "msg", "args", "values", "qos", "service"])
)
_MEMBERS = st.lists(st.tuples(_NAMES, _VALUE), max_size=6)
_SPACES = st.sampled_from([(",", ":"), (", ", ": "), (" ,\n", " :\t")])


@given(
    _MEMBERS,
    st.integers(0, 6),
    st.sampled_from([*OPS, "teleport"]),
    st.sampled_from(["msg", "args", "values"]),
    st.dictionaries(_TEXT, _VALUE, max_size=3) | st.lists(_VALUE, max_size=3),
    _SPACES,
    st.booleans(),
)
@example([("x", '",":"')], 0, "publish", "msg", {}, (",", ":"), True)
def test_any_message_is_cut_like_a_full_parse(
    members: list[tuple[str, Any]],
    place: int,
    op: str,
    name: str,
    payload: Any,
    spaces: tuple[str, str],
    escaped: bool,
) -> None:
    members = [*members[:place], (name, payload), *members[place:], ("op", op)]
    comma, colon = spaces
    text = comma.join(
        json.dumps(key, ensure_ascii=escaped)
        + colon
        + json.dumps(value, separators=spaces, ensure_ascii=escaped)
        for key, value in members
    )
    check_like_a_full_parse(f"{{{text}}}".encode())


@given(
    _MEMBERS,
    st.dictionaries(_TEXT, _VALUE, max_size=3),
    st.lists(st.tuples(st.integers(0, 400), st.sampled_from(list('"\\{}[],:0 a'))), min_size=1, max_size=3),
)
def test_any_damaged_message_is_never_taken_for_another(
    members: list[tuple[str, Any]], payload: Any, damage: list[tuple[int, str]]
) -> None:
    pairs = [("op", "publish"), ("topic", "/a"), *members, ("msg", payload)]
    text = "{" + ",".join(json.dumps(key) + ":" + json.dumps(value) for key, value in pairs) + "}"
    for position, character in damage:
        cut = position % len(text)
        text = text[:cut] + character + text[cut + 1 :]
    data = text.encode()
    found = full(data)
    if found is None:
        return
    _, unproven = found
    try:
        json.loads(bytes(unproven.data))
    except ValueError:
        return
    check_like_a_full_parse(data)  # json.loads(data) within must succeed: slice valid, so the frame is valid


@pytest.mark.parametrize("value", ["[" + "[]," * 30_000 + "[]]", '"' + "a" * 70_000 + '"', "1" * 70_000])
@pytest.mark.parametrize("payload", ["", ',"msg":{"data":"FILL"}'], ids=["alone", "with a payload"])
def test_a_large_member_beside_the_payload_is_refused_by_name(value: str, payload: str) -> None:
    text = f'{{"op":"publish","id":"i","topic":{value}{payload.replace("FILL", FILL)}}}'
    found = only(Session().decode(text.encode(), False, 0.0), Refusal)
    assert (found.op, found.id) == ("publish", "i")
    assert found.reason == f"publish.topic: {len(value)} bytes; a member beside the payload may have 65536"


def test_the_brackets_of_a_frame_are_bounded() -> None:
    limits = WireLimits(structure_bytes=100_000)
    reason = "more than 100000 brackets (limits.structure_bytes)"
    for count, allowed in ((49_997, True), (50_001, False)):
        arrays = "[]," * (count - 3) + "[]"
        text = f'{{"op":"publish","topic":"/a","msg":{{"data":[{arrays}]}}}}'
        found = only(Session(limits=limits).decode(text.encode(), False, 0.0), Publish)
        assert text_of(found.msg).dense == ("" if allowed else reason)
        if not allowed:
            for look in (text_of(found.msg).validated, found.msg.json, found.msg.plain):
                with pytest.raises(MalformedPayload, match="structure_bytes"):
                    look()
    refusal = only(Session(limits=limits).decode(text.replace("msg", "no").encode(), False, 0.0), Refusal)
    assert refusal.reason == reason


def test_a_piece_of_a_message_may_be_large() -> None:
    inner = json.dumps({"op": "publish", "topic": "/a", "msg": {"data": FILL * 3}})
    pieces = [{"op": "fragment", "id": "f", "data": part, "num": num, "total": 2}
              for num, part in enumerate((inner[:-2], inner[-2:]))]  # fmt: skip
    session = Session()
    (found,) = (op for piece in pieces for op in session.decode(json.dumps(piece).encode(), False, 0.0))
    assert isinstance(found, Publish)


@given(st.text(alphabet='{[}]"a', max_size=300), st.integers(0, 200))
def test_few_brackets_are_found_as_many_are_counted(text: str, most: int) -> None:
    counted = text.count("{") + text.count("[")

    assert has_more_brackets(text.encode(), most) is (counted > most)


class _Uncounted(bytes):
    """Bytes that nobody goes through one by one."""

    def count(self, *args: object) -> int:
        raise AssertionError(f"counts {args}")


def test_the_brackets_around_one_long_string_are_not_counted() -> None:
    text = _Uncounted(b'{"a": [{"data": "' + b"A" * 1_000_000 + b'"}]}')

    assert not has_more_brackets(text, 64)
    assert has_more_brackets(text, 2)
