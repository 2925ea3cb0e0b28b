"""Frames of an uplink, byte by byte, and what is no frame."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.hub.uplink.frames import (
    MAX_FRAME_BYTES,
    MAX_QUEUE,
    MAX_REASON_BYTES,
    Accepted,
    Ack,
    BadFrame,
    Credit,
    Data,
    DropCause,
    Drops,
    End,
    FeedBegun,
    FeedHead,
    Hello,
    Join,
    Joined,
    Lane,
    Left,
    Open,
    Ping,
    Refusal,
    Refused,
    SamplePart,
    Skipped,
    decode_frame,
    encode_accept,
    encode_ack,
    encode_credit,
    encode_data,
    encode_drops,
    encode_end,
    encode_feed,
    encode_hello,
    encode_join,
    encode_leave,
    encode_open,
    encode_ping,
    encode_refuse,
    encode_sample,
    is_sequenced,
    split_first_part,
)

VECTORS = {
    "OPEN": (encode_open(1, b"{}"), "01 00 00000001 7b7d", Open(1, b"{}")),
    "DATA, the last part of a reply": (
        encode_data(258, Lane.REPLIES, memoryview(b"ab"), binary=False, is_last=True),
        "02 11 00000102 6162",
        Data(258, Lane.REPLIES, False, True, memoryview(b"ab")),
    ),
    "DATA, a part of a large sample": (
        encode_data(7, Lane.LARGE, memoryview(b"\xff"), binary=True, is_last=False),
        "02 0b 00000007 ff",
        Data(7, Lane.LARGE, True, False, memoryview(b"\xff")),
    ),
    "DATA, the emergency stop": (
        encode_data(7, Lane.STOP, memoryview(b"{}"), binary=False, is_last=True),
        "02 10 00000007 7b7d",
        Data(7, Lane.STOP, False, True, memoryview(b"{}")),
    ),
    "END": (encode_end(3, 1008, "no"), "03 00 00000003 03f0 6e6f", End(3, 1008, "no")),
    "CREDIT": (encode_credit(3, 131072), "04 00 00000003 00020000", Credit(3, 131072)),
    "ACCEPT": (encode_accept(3), "05 00 00000003", Accepted(3)),
    "REFUSE": (
        encode_refuse(3, Refusal(401, "who?")),
        "06 00 00000003" + b'{"status":401,"reason":"who?"}'.hex(),
        Refused(3, Refusal(401, "who?")),
    ),
    "FEED": (
        encode_feed(2, FeedHead("/odom", 0.5)),
        "07 00 00000002" + b'{"topic":"/odom","period":0.5}'.hex(),
        FeedBegun(2, FeedHead("/odom", 0.5)),
    ),
    "JOIN": (
        encode_join(3, Join(2, throttle=0.5, queue=1, depth=10, gap="00000001")),
        "08 00 00000003" + b'{"feed":2,"throttle":0.5,"queue":1,"depth":10,"gap":"00000001"}'.hex(),
        Joined(3, Join(2, throttle=0.5, queue=1, depth=10, gap="00000001")),
    ),
    "LEAVE": (encode_leave(3, 2), "09 00 00000003 00000002", Left(3, 2)),
    "SAMPLE, for all": (
        encode_sample(2, Lane.SMALL, memoryview(b"ab"), binary=False, is_last=True),
        "0a 12 00000002 6162",
        SamplePart(2, Lane.SMALL, False, True, 0x12, memoryview(b"ab")),
    ),
    "SAMPLE, the first part of one with a gap for a single client": (
        encode_sample(2, Lane.LARGE, memoryview(b"ab"), binary=True, is_last=False, to=3, gap=1),
        "0a 6b 00000002 00000003 0001 6162",
        SamplePart(2, Lane.LARGE, True, False, 0x6B, memoryview(b"\0\0\0\3\0\1ab")),
    ),
    "DROPS": (
        encode_drops(Drops(3, 2, DropCause.BACKLOG, 5)),
        "0b 00 00000003 00000002 02 0005",
        Drops(3, 2, DropCause.BACKLOG, 5),
    ),
    "HELLO": (
        encode_hello(Hello("a", 5, "rwt 1")),
        "40 00 00000000" + b'{"session":"a","received":5,"software":"rwt 1"}'.hex(),
        Hello("a", 5, "rwt 1"),
    ),
    "ACK": (encode_ack(2**40), "41 00 00000000 0000010000000000", Ack(2**40)),
    "PING": (encode_ping(b"1"), "42 00 00000000 31", Ping(b"1", False)),
    "PONG": (encode_ping(b"1", is_answer=True), "43 00 00000000 31", Ping(b"1", True)),
}


LARGE = st.one_of(st.integers(0, 2**63 - 1), st.integers(2**31 - 1, 2**31 + 1))
SECONDS = st.floats(0, allow_nan=False, allow_infinity=True)


@given(
    LARGE, st.none() | LARGE, SECONDS, SECONDS, st.text() | st.builds("x".__mul__, st.integers(1000, 5000))
)
def test_whatever_a_client_asks_for_is_accepted_by_the_other_side(
    queue: int, depth: int | None, throttle: float, period: float, reason: str
) -> None:
    join = decode_frame(encode_join(3, Join(2, throttle=throttle, queue=queue, depth=depth)))
    assert isinstance(join, Joined)
    assert join.join.queue == min(queue, MAX_QUEUE)
    assert isinstance(decode_frame(encode_feed(2, FeedHead("/odom", period))), FeedBegun)
    refused = decode_frame(encode_refuse(3, Refusal(403, reason)))
    assert isinstance(refused, Refused)
    assert reason.startswith(refused.refusal.reason)
    assert isinstance(decode_frame(encode_end(3, 1008, reason)), End)


@pytest.mark.parametrize("name", VECTORS)
def test_a_frame_on_the_wire(name: str) -> None:
    encoded, expected, frame = VECTORS[name]
    assert encoded == bytes.fromhex(expected)
    assert decode_frame(encoded) == frame
    assert is_sequenced(encoded) is (encoded[0] < 64)


@pytest.mark.parametrize("kind", [0, 12, 63, 68, 255])
def test_frames_of_a_later_version_are_skipped(kind: int) -> None:
    assert decode_frame(bytes((kind, 1, 0, 0, 0, 1)) + b"what") == Skipped(kind)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "0 bytes"),
        (b"\x02\x10\x00\x00\x00", "5 bytes"),
        (bytes(MAX_FRAME_BYTES + 1), "131073 bytes"),
        (b"\x02\x15\x00\x00\x00\x01", "no lane 5"),
        (b"\x0a\x11\x00\x00\x00\x01", "a sample in lane 1"),
        (b"\x07\x00\x00\x00\x00\x01{}", "FEED: "),
        (encode_join(1, Join(1))[:6] + b'{"feed":0}', "JOIN: "),
        (encode_join(1, Join(1))[:6] + b'{"feed":1,"gap":"0"}', "JOIN: "),
        (encode_leave(1, 1)[:-1], "LEAVE: expected 4 bytes, got 3"),
        (encode_drops(Drops(1, 1, DropCause.SIZE, 1))[:-1], "DROPS: expected 7 bytes, got 6"),
        (b"\x0b\x00\x00\x00\x00\x01\x00\x00\x00\x01\x09\x00\x01", "DROPS: 1 samples for reason 9"),
        (b"\x0b\x00\x00\x00\x00\x01\x00\x00\x00\x01\x01\x03\xe9", "DROPS: 1001 samples"),
        (encode_ack(1)[:-1], "ACK: expected 8 bytes, got 7"),
        (encode_credit(1, 1) + b"x", "CREDIT: expected 4 bytes, got 5"),
        (encode_end(1, 1000, "")[:-1], "END: expected 2 to"),
        (encode_end(1, 1000, "") + bytes(MAX_REASON_BYTES + 1), "END: expected 2 to"),
        (encode_end(1, 1000, "") + b"\xff", "END: the reason is not UTF-8"),
        (encode_hello(Hello()) + b"{", "HELLO: "),
        (encode_hello(Hello())[:6] + b'{"received":-1}', "HELLO: "),
        (encode_refuse(1, Refusal())[:6] + b'{"status":200}', "REFUSE: "),
    ],
)
def test_what_is_no_frame(data: bytes, says: str) -> None:
    with pytest.raises(BadFrame, match=says):
        decode_frame(data)


def test_the_first_part_of_a_sample_says_for_whom_it_is() -> None:
    data = encode_sample(2, Lane.SMALL, memoryview(b"ab"), binary=True, is_last=True, to=3, gap=1)
    part = decode_frame(data)
    assert isinstance(part, SamplePart)
    assert split_first_part(part) == (3, 1, memoryview(b"ab"))
    cut = decode_frame(data[: len(data) - len(part.payload) + 5])
    assert isinstance(cut, SamplePart)
    with pytest.raises(BadFrame, match="too short"):
        split_first_part(cut)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_frame_or_rejected(data: bytes) -> None:
    try:
        decode_frame(data)
    except BadFrame as error:
        assert 0 < len(str(error)) < 300


@given(st.text(max_size=2000), st.integers(0, 65535))
def test_a_long_reason_is_cut_between_characters(reason: str, code: int) -> None:
    frame = decode_frame(encode_end(1, code, reason.encode("utf-8", "ignore").decode()))
    assert isinstance(frame, End)
    assert frame.code == code
    assert len(frame.reason.encode()) <= MAX_REASON_BYTES


def test_the_name_of_a_feed_is_short() -> None:
    with pytest.raises(BadFrame, match="FEED"):
        decode_frame(encode_feed(2, FeedHead("/" * 1025)))
