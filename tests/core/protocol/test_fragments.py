"""Messages in pieces: joined by number, bounded, and cut so that every client can join them."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.codecs import JSON
from rwt_protocol.frames import Frame
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Direction, Op, Publish, Status, Subscribe
from rwt_protocol.payloads import RawJson
from rwt_protocol.session import Refusal, Session
from tests.core.protocol.wire_examples import only

TEXT = '{"op":"subscribe","topic":"/a"}'
OP = Subscribe(topic="/a")


def send(
    session: Session, data: str, num: int, total: float, name: object = "f", now: float = 0.0
) -> list[Op | Refusal]:
    frame = json.dumps({"op": "fragment", "id": name, "data": data, "num": num, "total": total}).encode()
    return list(session.decode(frame, False, now))


def reason(found: list[Op | Refusal]) -> str:
    (refusal,) = found
    assert isinstance(refusal, Refusal)
    assert refusal.op == "fragment"
    return refusal.reason


@given(st.permutations(range(len(TEXT))))
def test_pieces_are_joined_by_number_whatever_order_they_arrive_in(order: list[int]) -> None:
    session = Session()
    found = [item for num in order for item in send(session, TEXT[num], num, len(TEXT))]
    assert found == [OP]


def test_one_piece_completes_at_once_and_its_id_is_free_again() -> None:
    session = Session()
    assert send(session, TEXT, 0, 1) == [OP]
    assert send(session, TEXT, 0, 1) == [OP]


def test_a_fractional_total_is_floored() -> None:
    session = Session()
    assert send(session, TEXT[:9], 0, 2.75) == []
    assert send(session, TEXT[9:], 1, 2.75) == [OP]
    assert reason(send(session, TEXT, 0, 0.7)).startswith("fragment.total: expected a whole number, one or")


def test_lists_are_kept_apart_by_id_and_by_connection() -> None:
    one, other = Session(), Session()
    assert send(one, TEXT[:9], 0, 2, "1") == []
    assert send(one, TEXT[:5], 0, 2, 1) == []
    assert send(other, TEXT[9:], 1, 2, "1") == []
    assert send(one, TEXT[5:], 1, 2, 1) == [OP]
    assert send(one, TEXT[9:], 1, 2, "1") == [OP]


def test_a_piece_that_does_not_fit_is_refused_and_the_others_stay() -> None:
    session = Session()
    assert send(session, TEXT[:9], 0, 2) == []
    assert reason(send(session, "x", 0, 2)) == "fragment.num: piece 0 has already arrived"
    assert reason(send(session, "x", 2, 2)) == "fragment.num: expected less than the total, 2, got 2"
    assert reason(send(session, "x", 1, 3)) == "fragment.total: expected 2 as before, got 3"
    assert send(session, TEXT[9:], 1, 2) == [OP]


def test_late_pieces_are_forgotten_when_another_message_begins() -> None:
    session = Session()
    assert send(session, TEXT[:9], 0, 2, "late", 0.0) == []
    assert send(session, TEXT[:9], 0, 2, "kept", 1.0) == []
    assert send(session, TEXT, 0, 1, "new", 600.5) == [OP]
    assert send(session, TEXT[9:], 1, 2, "late", 600.6) == []
    assert send(session, TEXT[9:], 1, 2, "kept", 9999.0) == [OP]


def test_open_lists_are_bounded() -> None:
    session = Session(limits=WireLimits(fragmented_messages=2))
    for name in "ab":
        assert send(session, TEXT[:9], 0, 2, name) == []
    assert reason(send(session, TEXT, 0, 1, "c")) == (
        "fragment: 2 messages are in pieces already; complete one first (limits.fragmented_messages)"
    )
    assert send(session, TEXT[9:], 1, 2, "a") == [OP]
    assert send(session, TEXT, 0, 1, "c") == [OP]


@pytest.mark.parametrize(("data", "total"), [("x" * 1000, 3), ("", 6)])
def test_what_is_kept_is_bounded(data: str, total: int) -> None:
    session = Session(limits=WireLimits(fragment_characters=1000))
    assert reason(send(session, data, 0, total)) == (
        "fragment: the pieces take more than 1000 characters; the message was dropped"
        " (limits.fragment_characters)"
    )
    assert send(session, TEXT, 0, 1) == [OP]


def test_a_message_inside_pieces_is_refused_as_if_it_had_come_whole() -> None:
    session = Session()
    refusal = only(send(session, '{"op":"subscribe","id":"inner"}', 0, 1), Refusal)
    assert (refusal.op, refusal.id) == ("subscribe", "inner")
    assert isinstance(refusal.answer, Status)


def test_pieces_inside_pieces() -> None:
    def nested(depth: int, name: str) -> str:
        text = TEXT
        for level in range(depth):
            fragment = {"op": "fragment", "id": name or f"level {level}", "data": text, "num": 0, "total": 1}
            text = json.dumps(fragment)
        return text

    assert list(Session().decode(nested(4, "").encode(), False, 0.0)) == [OP]
    assert reason(list(Session().decode(nested(5, "").encode(), False, 0.0))) == (
        "messages inside messages, more than 4 deep"
    )
    assert reason(list(Session().decode(nested(2, "same").encode(), False, 0.0))) == (
        "fragment.num: piece 0 has already arrived"
    )


def test_a_long_message_is_cut() -> None:
    session = Session()
    frame = JSON.encode(Publish(topic="/a", msg=RawJson(b'{"data":"0123456789"}')))
    pieces = [json.loads(piece.data) for piece in session.cut(frame, 30)]
    assert [piece["num"] for piece in pieces] == [0, 1]
    assert {(piece["op"], piece["total"]) for piece in pieces} == {("fragment", 2)}
    (id_,) = {piece["id"] for piece in pieces}
    assert id_.startswith("fragment:")
    assert [len(piece["data"]) for piece in pieces] == [30, frame.size - 30]
    assert all(type(piece["total"]) is int for piece in pieces)
    assert json.loads(session.cut(frame, 30)[0].data)["id"] not in (id_, "")
    assert json.loads(session.cut(frame, 30, 0)[0].data)["id"] == "0"
    assert json.loads(session.cut(frame, 30, "i")[0].data)["id"] == "i"


def test_what_is_short_or_binary_or_not_asked_for_is_left_whole() -> None:
    session = Session()
    frame = JSON.encode(Publish(topic="/ä"))
    assert session.cut(frame, frame.size) == (frame,)
    assert session.cut(frame, frame.size - 1) == (frame,)  # one character less than bytes
    assert len(session.cut(frame, frame.size - 2)) == 2
    assert session.cut(frame, None) == (frame,)
    assert session.cut(frame, 0) == (frame,)
    binary = Frame(b"x" * 100, binary=True)
    assert session.cut(binary, 10) == (binary,)


@given(st.text(), st.integers(1, 50))
def test_what_is_cut_is_joined_again(topic: str, size: int) -> None:
    op = Publish(topic=topic)
    there, here = Session(), Session(direction=Direction.TO_CLIENT)
    pieces = there.cut(there.encode(op), size)
    assert [item for piece in pieces for item in here.decode(piece.data, False, 0.0)] == [op]
