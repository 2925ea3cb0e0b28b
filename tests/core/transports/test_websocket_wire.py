"""The WebSocket wire against RFC 6455, at the level of bytes: whole, byte by byte, and with trailing data."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator

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

KEY = bytes.fromhex("37fa213d")
LIMIT = 300_000


class Heard:
    """Events reported by a wire."""

    def __init__(self, *, server: bool = True, strict: bool = False, skip: bool = False) -> None:
        self.messages: list[tuple[bytes, bool]] = []
        self.answers: list[bytes] = []
        self.ends: list[tuple[int, str, bool]] = []
        self.sizes: list[int] = []
        self.heads: list[bytes] = []
        self.skip = skip
        self.wire = WebSocketWire(
            self, Limits(message_bytes=LIMIT, strict_utf8=strict), ReceiveBufferPool(), server=server
        )
        self.wire.message = lambda data, binary: self.messages.append((data, binary))

    def oversized_head(self, size: int, head: bytes) -> None:
        self.heads.append(head)

    def oversized(self, size: int) -> bool:
        self.sizes.append(size)
        return self.skip

    def pong(self, data: bytes) -> None:
        self.answer(data)

    def answer(self, data: bytes) -> None:
        self.answers.append(data)

    def ended(self, code: int, reason: str, *, agreed: bool) -> None:
        self.ends.append((code, reason, agreed))

    @property
    def codes(self) -> list[int]:
        return [code for code, _, _ in self.ends]


def mask(payload: bytes, key: bytes = KEY) -> bytes:
    return bytes(byte ^ key[at % 4] for at, byte in enumerate(payload))


def frame(first: int, payload: bytes = b"", *, masked: bool = True, form: int | None = None) -> bytes:
    """One frame; `form` forces the length field: 7, 16 or 64 bits."""
    size = len(payload)
    form = form or (7 if size < 126 else 16 if size < 65536 else 64)
    bit = 0x80 if masked else 0
    head = bytes([first])
    head += {7: lambda: bytes([bit | size]), 16: lambda: struct.pack("!BH", bit | 126, size)}.get(
        form, lambda: struct.pack("!BQ", bit | 127, size)
    )()
    return head + KEY + mask(payload) if masked else head + payload


def whole(wire: WebSocketWire, data: bytes) -> None:
    wire.feed(data)


def byte_by_byte(wire: WebSocketWire, data: bytes) -> None:
    for at in range(len(data)):
        wire.feed(data[at : at + 1])


def into_space(wire: WebSocketWire, data: bytes) -> None:
    """As the asyncio driver does: large payloads are received where they belong, 50,000 bytes at most at
    once."""
    at = 0
    while at < len(data):
        space = wire.get_buffer()
        count = min(50_000, len(data) - at)
        if space is None:
            wire.feed(data[at : at + count])
        else:
            count = min(count, len(space))
            space[:count] = data[at : at + count]
            space.release()
            wire.buffer_updated(count)
        at += count


Feed = Callable[[WebSocketWire, bytes], None]


@pytest.fixture(params=[whole, byte_by_byte, into_space])
def feed(request: pytest.FixtureRequest) -> Iterator[Feed]:
    yield request.param


# -- 5.2, 5.6: data frames ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        # The masked example of section 5.7.
        (bytes.fromhex("818537fa213d7f9f4d5158"), (b"Hello", False)),
        (frame(0x82, b"\x00\xff"), (b"\x00\xff", True)),
        (frame(0x81), (b"", False)),
        (frame(0x81, b"x" * 125), (b"x" * 125, False)),
        (frame(0x81, b"x" * 126), (b"x" * 126, False)),
        (frame(0x82, b"y" * 65535), (b"y" * 65535, True)),
        (frame(0x82, b"y" * 65536), (b"y" * 65536, True)),
    ],
    ids=["rfc example", "binary", "empty", "125", "126", "65535", "65536"],
)
def test_a_message_in_one_frame(feed: Feed, data: bytes, expected: tuple[bytes, bool]) -> None:
    heard = Heard()
    feed(heard.wire, data)
    assert heard.messages == [expected]
    feed(heard.wire, frame(0x81, b"next") + frame(0x82, b"one")[:3])
    assert heard.messages == [expected, (b"next", False)]
    assert not heard.ends and not heard.answers


@pytest.mark.parametrize("size", [100_000, 260_000, 262_144, 262_145, LIMIT])
def test_a_large_message_arrives_unharmed(size: int) -> None:
    heard = Heard()
    payload = bytes(at * 7 & 0xFF for at in range(size))
    into_space(heard.wire, frame(0x82, payload) * 2 + frame(0x81, b"after"))
    assert heard.messages == [(payload, True), (payload, True), (b"after", False)]


def test_many_messages_in_one_read() -> None:
    heard = Heard()
    heard.wire.feed(b"".join(frame(0x81, b"%d" % at) for at in range(500)))
    assert heard.messages == [(b"%d" % at, False) for at in range(500)]


@given(st.lists(st.tuples(st.binary(max_size=300), st.booleans()), max_size=6), st.lists(st.integers(1, 40)))
def test_cuts_do_not_matter(messages: list[tuple[bytes, bool]], cuts: list[int]) -> None:
    data = b"".join(frame(0x82 if binary else 0x81, payload) for payload, binary in messages)
    heard = Heard()
    for cut in cuts:
        heard.wire.feed(data[:cut])
        data = data[cut:]
    heard.wire.feed(data)
    assert heard.messages == messages


@given(st.binary(max_size=200), st.booleans())
def test_any_bytes_are_messages_or_one_end(data: bytes, server: bool) -> None:
    heard = Heard(server=server)
    heard.wire.feed(data)
    heard.wire.feed(data)
    assert len(heard.ends) <= 1


# -- 5.4: fragmentation ------------------------------------------------------------------------------------


def test_fragments_are_joined(feed: Feed) -> None:
    heard = Heard()
    feed(heard.wire, frame(0x01, b"Hel") + frame(0x00, b"") + frame(0x80, b"lo") + frame(0x81, b"!"))
    assert heard.messages == [(b"Hello", False), (b"!", False)]


def test_control_frames_may_come_between_fragments(feed: Feed) -> None:
    heard = Heard()
    feed(heard.wire, frame(0x02, b"a") + frame(0x89, b"?") + frame(0x8A, b"") + frame(0x80, b"b"))
    assert heard.messages == [(b"ab", True)]
    assert heard.answers == [b"\x8a\x01?"]


# -- 5.1 to 5.5: what is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "data",
    [
        frame(0xC1, b"x"),
        frame(0xA1, b"x"),
        frame(0x91, b"x"),
        *(frame(0x80 | opcode, b"x") for opcode in (3, 4, 5, 6, 7, 11, 12, 13, 14, 15)),
        frame(0x81, b"x", masked=False),
        frame(0x89, b"x" * 126),
        frame(0x09, b"x"),
        frame(0x08, b""),
        frame(0x80, b"x"),
        frame(0x00, b"x"),
        frame(0x01, b"x") + frame(0x81, b"y"),
        frame(0x01, b"x") + frame(0x02, b"y"),
        frame(0x81, b"x" * 125, form=16),
        frame(0x81, b"x", form=64),
        frame(0x81, b"x" * 65535, form=64),
        b"\x82\xff" + b"\x80" + bytes(7) + KEY,
        frame(0x88, b"\x03"),
        *(
            frame(0x88, struct.pack("!H", code))
            for code in (0, 999, 1004, 1005, 1006, 1015, 1016, 2999, 5000)
        ),
    ],
)
def test_a_broken_frame_ends_the_connection_with_1002(feed: Feed, data: bytes) -> None:
    heard = Heard()
    feed(heard.wire, frame(0x81, b"before") + data + frame(0x81, b"after"))
    assert heard.codes == [1002]
    assert heard.messages[0] == (b"before", False)
    assert (b"after", False) not in heard.messages
    (answer,) = heard.answers
    assert answer[0] == 0x88 and answer[2:4] == struct.pack("!H", 1002)
    assert answer[4:].decode() == heard.ends[0][1] != ""
    assert not heard.ends[0][2]


def test_a_server_must_not_mask() -> None:
    heard = Heard(server=False)
    heard.wire.feed(frame(0x81, b"x"))
    assert heard.codes == [1002]


# -- 5.5: control frames -----------------------------------------------------------------------------------


@pytest.mark.parametrize("payload", [b"", b"ping", b"x" * 125])
def test_a_ping_is_answered_with_its_own_content(feed: Feed, payload: bytes) -> None:
    heard = Heard()
    feed(heard.wire, frame(0x89, payload) + frame(0x81, b"after"))
    assert heard.answers == [frame(0x8A, payload, masked=False)]
    assert heard.messages == [(b"after", False)]


@pytest.mark.parametrize("code", [1000, 1001, 1002, 1003, 1007, 1011, 1014, 3000, 3999, 4000, 4999])
def test_a_close_is_answered_with_its_own_code(feed: Feed, code: int) -> None:
    heard = Heard()
    body = struct.pack("!H", code) + "gründe".encode()
    feed(heard.wire, frame(0x88, body) + frame(0x81, b"after"))
    assert heard.answers == [frame(0x88, body, masked=False)]
    assert heard.ends == [(code, "gründe", True)]
    assert heard.messages == []


def test_a_close_without_code_is_answered_without_code() -> None:
    heard = Heard()
    heard.wire.feed(frame(0x88))
    assert heard.answers == [b"\x88\x00"]
    assert heard.ends == [(1005, "", True)]


def test_the_reason_of_a_close_must_be_utf8() -> None:
    heard = Heard()
    heard.wire.feed(frame(0x88, struct.pack("!H", 1000) + b"\xff"))
    assert heard.codes == [1007]


def test_closing_from_this_side() -> None:
    heard = Heard()
    sent = heard.wire.close(1001, "off")
    assert sent == frame(0x88, struct.pack("!H", 1001) + b"off", masked=False)
    assert heard.wire.close(1000, "again") == b""
    assert heard.wire.ping() == b""
    heard.wire.feed(frame(0x81, b"late") + frame(0x89, b"late") + frame(0x88, struct.pack("!H", 1001)))
    assert heard.messages == [] and heard.answers == []
    assert heard.ends == [(1001, "", True)]


def test_a_long_reason_is_cut_at_a_character() -> None:
    sent = Heard().wire.close(1000, "ü" * 100)
    assert sent[1] == len(sent) - 2 <= 125
    assert sent[4:].decode() == "ü" * 61


def test_a_code_that_may_not_travel_is_left_out() -> None:
    assert Heard().wire.close(1006, "gone") == b"\x88\x00"


# -- 8.1: text ---------------------------------------------------------------------------------------------


def test_bad_utf8_is_the_endpoints_affair() -> None:
    heard = Heard()
    heard.wire.feed(frame(0x81, b"\xff\xfe") + frame(0x81, b"ok"))
    assert heard.messages == [(b"\xff\xfe", False), (b"ok", False)]


def test_strict_utf8_closes_with_1007(feed: Feed) -> None:
    heard = Heard(strict=True)
    feed(heard.wire, frame(0x81, "grün".encode()) + frame(0x82, b"\xff") + frame(0x01, b"a\xc3"))
    feed(heard.wire, frame(0x80, b"\xbc") + frame(0x81, b"\xc3\x28"))
    assert [data for data, _ in heard.messages] == ["grün".encode(), b"\xff", "aü".encode()]
    assert heard.codes == [1007]


# -- the limit ---------------------------------------------------------------------------------------------

TOO_LARGE = [
    frame(0x81, b"x" * (LIMIT + 1)),
    frame(0x01, b"x" * LIMIT) + frame(0x80, b"x"),
    frame(0x01, b"x" * 10)
    + frame(0x00, b"x" * LIMIT)
    + frame(0x89, b"")
    + frame(0x00, b"y")
    + frame(0x80, b""),
]


@pytest.mark.parametrize("data", TOO_LARGE, ids=["one frame", "last fragment", "middle fragment"])
def test_too_large_a_message_is_skipped(data: bytes) -> None:
    for feed in (whole, into_space):
        heard = Heard(skip=True)
        feed(heard.wire, data + frame(0x81, b"after") + frame(0x01, b"a") + frame(0x80, b"b"))
        assert heard.messages == [(b"after", False), (b"ab", False)]
        assert len(heard.sizes) == 1 and heard.sizes[0] > LIMIT
        assert heard.heads == [b"x" * HEAD_BYTES]
        assert not heard.ends


@pytest.mark.parametrize("cut", [1, 10, 100, 2000])
def test_the_head_of_what_is_skipped_is_handed_over_once_however_it_comes(cut: int) -> None:
    text = b'{"op":"publish"}' + bytes(range(256)) * (LIMIT // 256 + 1)
    heard = Heard(skip=True)
    data = frame(0x01, text[:300]) + frame(0x80, text[300:])
    for at in range(0, 3000, cut):
        heard.wire.feed(data[at : min(3000, at + cut)])
    assert heard.heads == [text[:HEAD_BYTES]]
    heard.wire.feed(data[3000:] + frame(0x81, b"after"))
    assert heard.messages == [(b"after", False)]
    assert len(heard.heads) == 1


@pytest.mark.parametrize("data", TOO_LARGE, ids=["one frame", "last fragment", "middle fragment"])
def test_too_large_a_message_ends_the_connection_when_nobody_wants_to_know(data: bytes) -> None:
    heard = Heard()
    heard.wire.feed(data + frame(0x81, b"after"))
    assert heard.codes == [1009] and "max_message_size" in heard.ends[0][1]
    assert heard.messages == []


def test_too_large_is_known_from_the_header_alone() -> None:
    heard = Heard()
    heard.wire.feed(b"\x82\xff" + struct.pack("!Q", 1 << 40) + KEY)
    assert heard.sizes == [1 << 40] and heard.codes == [1009]


def test_an_announced_size_reserves_nothing_before_bytes_come() -> None:
    heard = Heard()
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
    heard = Heard()
    heard.wire.feed(CLIENT_FRAMING.whole(Frame(b"q" * size)))
    assert heard.messages == [(b"q" * size, False)]
    answering = Heard(server=False)
    answering.wire.feed(SERVER_FRAMING.whole(Frame(b"q" * size, binary=True)))
    assert answering.messages == [(b"q" * size, True)]
