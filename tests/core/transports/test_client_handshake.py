"""The client's half of the opening handshake, byte by byte and with more behind it."""

from __future__ import annotations

import base64
import hashlib
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.uri import parse_uri

from rwt_transports.errors import ConnectError
from rwt_transports.websocket.client_handshake import ClientHandshake

GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"


def handshake() -> ClientHandshake:
    return ClientHandshake(parse_uri("ws://robot:9090/path?x=1"), {"X-Robot": "seven"})


def acceptance(request: bytes) -> bytes:
    key = re.search(rb"Sec-WebSocket-Key: (\S+)", request)
    assert key is not None
    accept = base64.b64encode(hashlib.sha1(key[1] + GUID).digest())
    return (
        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Accept: " + accept + b"\r\n\r\n"
    )


@pytest.mark.parametrize("behind", [b"", b"\x81\x02{}"])
def test_an_acceptance_whole_and_with_more_behind_it(behind: bytes) -> None:
    it = handshake()
    assert it.feed(acceptance(it.request) + behind) == behind


def test_an_acceptance_byte_by_byte() -> None:
    it = handshake()
    answers = [it.feed(bytes((byte,))) for byte in acceptance(it.request)]
    assert answers == [None] * (len(answers) - 1) + [b""]


def test_a_refusal_without_a_length_ends_with_the_connection() -> None:
    it = handshake()
    assert it.feed(b"HTTP/1.1 403 Forbidden\r\n\r\ngo ") is None
    assert it.feed(b"away") is None
    with pytest.raises(ConnectError, match=r"^robot:9090 answers 403: go away$"):
        it.eof()


@given(st.lists(st.binary(max_size=40), max_size=5))
def test_any_bytes_are_no_acceptance(pieces: list[bytes]) -> None:
    it = handshake()
    try:
        for piece in pieces:
            assert it.feed(piece) is None
        it.eof()
    except ConnectError as error:
        assert str(error).startswith("robot:9090 ")
    else:
        pytest.fail("bytes that mean nothing were taken for an answer")
