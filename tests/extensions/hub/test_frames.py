"""Frames of an uplink, byte by byte, and what is no frame."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.hub.uplink.frames import (
    MAX_FRAME_BYTES,
    MAX_REASON_BYTES,
    Accepted,
    Ack,
    BadFrame,
    Credit,
    Data,
    End,
    Hello,
    Lane,
    Open,
    Ping,
    Refusal,
    Refused,
    Skipped,
    decode_frame,
    encode_accept,
    encode_ack,
    encode_credit,
    encode_data,
    encode_end,
    encode_hello,
    encode_open,
    encode_ping,
    encode_refuse,
    is_sequenced,
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
    "HELLO": (
        encode_hello(Hello("a", 5, "rwt 1")),
        "40 00 00000000" + b'{"session":"a","received":5,"software":"rwt 1"}'.hex(),
        Hello("a", 5, "rwt 1"),
    ),
    "ACK": (encode_ack(2**40), "41 00 00000000 0000010000000000", Ack(2**40)),
    "PING": (encode_ping(b"1"), "42 00 00000000 31", Ping(b"1", False)),
    "PONG": (encode_ping(b"1", is_answer=True), "43 00 00000000 31", Ping(b"1", True)),
}


@pytest.mark.parametrize("name", VECTORS)
def test_a_frame_on_the_wire(name: str) -> None:
    encoded, expected, frame = VECTORS[name]
    assert encoded == bytes.fromhex(expected)
    assert decode_frame(encoded) == frame
    assert is_sequenced(encoded) is (encoded[0] < 64)


@pytest.mark.parametrize("kind", [0, 7, 63, 68, 255])
def test_frames_of_a_later_version_are_skipped(kind: int) -> None:
    assert decode_frame(bytes((kind, 1, 0, 0, 0, 1)) + b"what") == Skipped(kind)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "0 bytes"),
        (b"\x02\x10\x00\x00\x00", "5 bytes"),
        (bytes(MAX_FRAME_BYTES + 1), "131073 bytes"),
        (b"\x02\x15\x00\x00\x00\x01", "no lane 5"),
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
