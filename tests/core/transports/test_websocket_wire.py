"""The WebSocket wire: closing, limits, outgoing bytes. What a server reads is in `rfc6455`."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.client import ClientProtocol
from websockets.frames import Frame as OracleFrame
from websockets.frames import Opcode
from websockets.protocol import State
from websockets.uri import parse_uri

from rwt_protocol.frames import Frame
from rwt_transports.api import HEAD_BYTES
from rwt_transports.limits import Limits
from rwt_transports.websocket.wire import CLIENT_FRAMING, SERVER_FRAMING, WebSocketWire
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from tests.core.transports.conftest import Heard

KEY = bytes.fromhex("37fa213d")
LIMIT = 300_000


def listening(*, server: bool = True, skip: bool = False) -> Heard[WebSocketWire]:
    limits = Limits(message_bytes=LIMIT)
    return Heard(lambda events: WebSocketWire(events, limits, ReceiveBufferPool(), server=server), skip=skip)


def mask(payload: bytes, key: bytes = KEY) -> bytes:
    return bytes(byte ^ key[at % 4] for at, byte in enumerate(payload))


def frame(first: int, payload: bytes = b"", *, masked: bool = True) -> bytes:
    """One frame with the shortest length field."""
    size, bit = len(payload), 0x80 if masked else 0
    if size < 126:
        head = bytes((first, bit | size))
    elif size < 65536:
        head = struct.pack("!BBH", first, bit | 126, size)
    else:
        head = struct.pack("!BBQ", first, bit | 127, size)
    return head + KEY + mask(payload) if masked else head + payload


@given(st.binary(max_size=200), st.booleans())
def test_any_bytes_are_messages_or_one_end(data: bytes, server: bool) -> None:
    heard = listening(server=server)
    heard.wire.feed(data)
    heard.wire.feed(data)
    assert len(heard.ends) <= 1


def test_a_server_must_not_mask() -> None:
    heard = listening(server=False)
    heard.wire.feed(frame(0x81, b"x"))
    assert heard.codes == [1002]


def test_closing_from_this_side() -> None:
    heard = listening()
    sent = heard.wire.close(1001, "off")
    assert sent == frame(0x88, struct.pack("!H", 1001) + b"off", masked=False)
    assert heard.wire.close(1000, "again") == b""
    assert heard.wire.ping() == b""
    heard.wire.feed(frame(0x81, b"late") + frame(0x89, b"late") + frame(0x88, struct.pack("!H", 1001)))
    assert heard.messages == [] and heard.answers == []
    assert heard.ends == [(1001, "", True)]


def test_a_long_reason_is_cut_at_a_character() -> None:
    sent = listening().wire.close(1000, "ü" * 100)
    assert sent[1] == len(sent) - 2 <= 125
    assert sent[4:].decode() == "ü" * 61


def test_a_code_that_may_not_travel_is_left_out() -> None:
    assert listening().wire.close(1006, "gone") == b"\x88\x00"


# -- the limit ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cut", [1, 10, 100, 2000])
def test_the_head_of_what_is_skipped_is_handed_over_once_however_it_comes(cut: int) -> None:
    text = b'{"op":"publish"}' + bytes(range(256)) * (LIMIT // 256 + 1)
    heard = listening(skip=True)
    data = frame(0x01, text[:300]) + frame(0x80, text[300:])
    for at in range(0, 3000, cut):
        heard.wire.feed(data[at : min(3000, at + cut)])
    assert heard.heads == [text[:HEAD_BYTES]]
    heard.wire.feed(data[3000:] + frame(0x81, b"after"))
    assert heard.messages == [(b"after", False)]
    assert len(heard.heads) == 1


def test_an_announced_size_reserves_nothing_before_bytes_come() -> None:
    heard = listening()
    heard.wire.feed(b"\x82\xff" + struct.pack("!Q", LIMIT) + KEY)
    space = heard.wire.get_buffer()
    assert space is not None and len(space) <= 256 * 1024 < LIMIT


# -- outgoing ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0, 1, 125, 126, 65535, 65536, 100_000])
@pytest.mark.parametrize("binary", [False, True])
def test_a_frame_sent_is_what_another_implementation_reads(size: int, binary: bool) -> None:
    payload = b"z" * size
    message = Frame(payload[: size // 3], memoryview(payload)[size // 3 :], binary=binary)
    sent = SERVER_FRAMING.whole(message)
    assert b"".join(SERVER_FRAMING.pieces(message)) == sent
    client = ClientProtocol(parse_uri("ws://x/"), state=State.OPEN, max_size=None)
    client.receive_data(sent)
    (event,) = client.events_received()
    assert isinstance(event, OracleFrame)
    assert (event.opcode, bytes(event.data)) == (Opcode.BINARY if binary else Opcode.TEXT, payload)


def test_large_parts_are_not_copied_into_pieces() -> None:
    payload = bytes(100_000)
    pieces = SERVER_FRAMING.pieces(Frame(b'{"msg":', payload, b"}"))
    assert [len(piece) for piece in pieces] == [10 + 7, 100_000, 1]
    assert pieces[1] is payload


@pytest.mark.parametrize("size", [0, 125, 126, 70_000])
def test_what_a_client_sends_its_server_reads(size: int) -> None:
    heard = listening()
    heard.wire.feed(CLIENT_FRAMING.whole(Frame(b"q" * size)))
    assert heard.messages == [(b"q" * size, False)]
    answering = listening(server=False)
    answering.wire.feed(SERVER_FRAMING.whole(Frame(b"q" * size, binary=True)))
    assert answering.messages == [(b"q" * size, True)]
