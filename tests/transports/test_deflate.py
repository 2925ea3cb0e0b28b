"""permessage-deflate (RFC 7692) against another implementation, and against those who mean ill."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.extensions.permessage_deflate import PerMessageDeflate
from websockets.frames import Frame as OracleFrame
from websockets.frames import Opcode

from rwt_protocol.frames import Frame
from rwt_transports.handshake import answer_handshake
from rwt_transports.wires.deflate import Deflate, Inflater, Malformed, TooLarge, deflating
from rwt_transports.wires.websocket import SERVER_FRAMING, WebSocketWire
from tests.transports.test_websocket_wire import LIMIT, Heard, frame

ODOM = (
    b'{"op":"publish","topic":"/odom","msg":{"pose":{"x":0.25,"y":0.5,"z":0.0},"twist":{"x":0.0,"y":0.0}}}'
    * 3
)
OFFER = "permessage-deflate"
ALONE = Deflate(peer_keeps_context=False)


def hearing(agreed: Deflate | None, *, skip: bool = True) -> Heard:
    heard = Heard(skip=skip)
    heard.wire.deflate(agreed)
    return heard


def oracle(*, keeps_context: bool = True, bits: int = 15) -> PerMessageDeflate:
    """The client's half, by others."""
    return PerMessageDeflate(False, not keeps_context, 15, bits)


def packed(theirs: PerMessageDeflate, message: bytes, opcode: Opcode = Opcode.TEXT) -> bytes:
    encoded = theirs.encode(OracleFrame(opcode, message))
    return frame(0xC0 | opcode, bytes(encoded.data))


def deflated(message: bytes) -> bytes:
    compressor = zlib.compressobj(9, zlib.DEFLATED, -15)
    return (compressor.compress(message) + compressor.flush(zlib.Z_SYNC_FLUSH)).removesuffix(b"\0\0\xff\xff")


# -- what is agreed ----------------------------------------------------------------------------------------


def agreed(*offers: str, deflate: bool = True) -> tuple[Deflate | None, str]:
    headers = [
        ("Host", "robot"),
        ("Upgrade", "websocket"),
        ("Connection", "Upgrade"),
        ("Sec-WebSocket-Version", "13"),
        ("Sec-WebSocket-Key", "AAAAAAAAAAAAAAAAAAAAAA=="),
        *(("Sec-WebSocket-Extensions", offer) for offer in offers),
    ]
    answer = answer_handshake("/", headers, deflate=deflate)
    assert answer.status == 101
    lines = answer.head.decode().split("\r\n")
    said = [line.partition(": ")[2] for line in lines if line.startswith("Sec-WebSocket-Extensions")]
    return answer.deflate, "".join(said)


@pytest.mark.parametrize(
    ("offer", "expected", "said"),
    [
        (OFFER, Deflate(), "server_no_context_takeover"),
        (f"{OFFER}; client_max_window_bits", Deflate(), "server_no_context_takeover"),
        (
            f"{OFFER}; client_no_context_takeover",
            Deflate(peer_keeps_context=False),
            "server_no_context_takeover; client_no_context_takeover",
        ),
        (f"{OFFER}; server_no_context_takeover", Deflate(), "server_no_context_takeover"),
        (
            f"{OFFER}; server_max_window_bits=10",
            Deflate(window_bits=10),
            "server_no_context_takeover; server_max_window_bits=10",
        ),
        (
            f"{OFFER}; client_max_window_bits=9",
            Deflate(peer_window_bits=9),
            "server_no_context_takeover; client_max_window_bits=9",
        ),
        (f"{OFFER}; server_max_window_bits=8, {OFFER}", Deflate(), "server_no_context_takeover"),
        (f"x-unknown, {OFFER}", Deflate(), "server_no_context_takeover"),
    ],
)
def test_offers_that_are_taken(offer: str, expected: Deflate, said: str) -> None:
    assert agreed(offer) == (expected, f"{OFFER}; {said}")


@pytest.mark.parametrize(
    "offer",
    [
        f"{OFFER}; server_max_window_bits=8",
        f"{OFFER}; server_max_window_bits=16",
        f"{OFFER}; server_max_window_bits",
        f"{OFFER}; unknown=1",
        f"{OFFER}; server_no_context_takeover=1",
        f"{OFFER}; client_no_context_takeover; client_no_context_takeover",
        "x-webkit-deflate-frame",
    ],
)
def test_offers_that_are_declined(offer: str) -> None:
    assert agreed(offer) == (None, "")


def test_nothing_is_agreed_unless_it_is_set() -> None:
    assert agreed(OFFER, deflate=False) == (None, "")


# -- out ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bits", range(9, 16))
@pytest.mark.parametrize("size", [1, 2, 300, 70_000, 400_000])
def test_others_read_what_is_sent(bits: int, size: int) -> None:
    framing = deflating(bits)
    theirs = PerMessageDeflate(True, True, bits, 15)
    for binary in (False, True):
        sent = Frame(b'{"msg":', ODOM * size if size < 3 else ODOM[:100] * (size // 100), b"}", binary=binary)
        data = framing.whole(sent)
        assert b"".join(framing.pieces(sent)) == data
        assert data[0] == 0xC0 | (2 if binary else 1)
        assert len(data) < sent.size / 2
        start = {126: 4, 127: 10}.get(data[1], 2)
        decoded = theirs.decode(
            OracleFrame(Opcode.BINARY if binary else Opcode.TEXT, data[start:], rsv1=True)
        )
        assert bytes(decoded.data) == sent.data


def test_what_would_not_become_smaller_is_sent_as_it_is() -> None:
    noise = zlib.compress(bytes(range(256)) * 40, 9) * 2
    for sent in (Frame(b'{"op":"x"}'), Frame(bytes((at * 197 + 31) % 251 for at in range(200))), Frame(b"")):
        assert deflating(15).whole(sent) == SERVER_FRAMING.whole(sent)
    assert len(deflating(15).whole(Frame(noise))) <= len(noise) + 4


def test_a_frame_is_compressed_once_for_all_who_hear_it(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    compressobj = zlib.compressobj

    def counting(level: int, method: int, bits: int) -> object:
        made.append(bits)
        return compressobj(level, method, bits)

    monkeypatch.setattr(zlib, "compressobj", counting)
    for payload in (ODOM, ODOM * 2000):
        sent = Frame(payload)
        wires = [
            hearing(Deflate()).wire,
            hearing(None).wire,
            hearing(ALONE).wire,
            hearing(Deflate(12)).wire,
        ] * 3
        for wire in wires:
            sent.framed(wire.framing.whole)
            wire.framing.pieces(sent)
        assert sorted(made) == [-15, -12]
        made.clear()


# -- in ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("keeps_context", [True, False])
@pytest.mark.parametrize("bits", [9, 12, 15])
def test_messages_of_others_with_and_without_context(keeps_context: bool, bits: int) -> None:
    theirs = oracle(keeps_context=keeps_context, bits=bits)
    heard = hearing(Deflate(peer_window_bits=bits, peer_keeps_context=keeps_context))
    messages = [ODOM, b"", ODOM, b"[]", ODOM * 400]
    stream = b"".join(packed(theirs, message) for message in messages) + frame(0x81, b"plain")
    for chunk in (len(stream), 1):
        if chunk == 1:
            theirs = oracle(keeps_context=keeps_context, bits=bits)
            heard = hearing(Deflate(peer_window_bits=bits, peer_keeps_context=keeps_context))
            stream = b"".join(packed(theirs, message) for message in messages) + frame(0x81, b"plain")
        for at in range(0, len(stream), chunk):
            heard.wire.feed(stream[at : at + chunk])
        assert heard.messages == [(message, False) for message in [*messages, b"plain"]]


def test_a_compressed_message_in_fragments_with_a_ping_between() -> None:
    heard = hearing(Deflate())
    data = deflated(ODOM)
    heard.wire.feed(
        frame(0x42, data[:5]) + frame(0x89, b"?") + frame(0x00, data[5:9]) + frame(0x80, data[9:])
    )
    assert heard.messages == [(ODOM, True)]
    assert len(heard.answers) == 1


def test_the_example_of_the_rfc() -> None:
    """RFC 7692 section 7.2.3.1 and 7.2.3.2: Hello, twice, the second time by reference to the first."""
    heard = hearing(Deflate())
    heard.wire.feed(frame(0xC1, bytes.fromhex("f248cdc9c90700")) + frame(0xC1, bytes.fromhex("f200110000")))
    # Section 7.2.3.3, a block without compression; 7.2.3.4, a last block; 7.2.3.5, two blocks.
    for text in (
        "000500faff48656c6c6f00",
        "f348cdc9c9070000",
        "f248050000 00ffffcac9c90700".replace(" ", ""),
    ):
        heard.wire.feed(frame(0xC1, bytes.fromhex(text)))
    assert heard.messages == [(b"Hello", False)] * 5


@pytest.mark.parametrize(
    "data",
    [
        frame(0xC1, b"\xff\xff\xff"),
        frame(0xC1, deflated(ODOM)[1:]),
        frame(0xC1, bytes.fromhex("f348cdc9c90700") + b"more"),
    ],
)
def test_what_is_no_deflate_ends_with_1007(data: bytes) -> None:
    heard = hearing(Deflate())
    heard.wire.feed(data)
    assert heard.codes == [1007]
    assert heard.messages == []


@pytest.mark.parametrize(
    "data",
    [
        frame(0x41, b"a") + frame(0xC0, b"b"),  # on a continuation
        frame(0xC9, b""),  # on a control frame
        frame(0xA1, b""),  # RSV2
        frame(0xD1, b""),  # RSV3 as well
    ],
)
def test_the_bit_anywhere_else_ends_with_1002(data: bytes) -> None:
    heard = hearing(Deflate())
    heard.wire.feed(data)
    assert heard.codes == [1002]


def test_the_bit_without_an_agreement_ends_with_1002() -> None:
    heard = hearing(None)
    heard.wire.feed(frame(0xC1, deflated(ODOM)))
    assert heard.codes == [1002]


# -- bombs -------------------------------------------------------------------------------------------------


def bomb(size: int) -> bytes:
    return frame(0xC1, deflated(b"[" + b" " * size))


def test_a_bomb_is_refused_like_any_message_that_is_too_large() -> None:
    heard = hearing(ALONE)
    heard.wire.feed(bomb(LIMIT * 40) + frame(0xC1, deflated(ODOM)))
    assert heard.sizes == [LIMIT + 1]
    assert heard.messages == [(ODOM, False)]
    assert heard.ends == []


def test_a_bomb_that_later_messages_may_refer_to_ends_the_connection() -> None:
    heard = hearing(Deflate())
    heard.wire.feed(bomb(LIMIT * 40))
    assert heard.codes == [1009]
    assert heard.sizes == []


def test_a_message_too_large_before_it_is_inflated() -> None:
    huge = frame(0xC1, b"x" * (LIMIT + 1))
    alone, keeping = hearing(ALONE), hearing(Deflate())
    alone.wire.feed(huge + frame(0xC1, deflated(ODOM)))
    assert (alone.sizes, alone.messages) == ([LIMIT + 1], [(ODOM, False)])
    keeping.wire.feed(huge)
    assert keeping.codes == [1009]


def test_inflating_makes_no_more_than_the_limit() -> None:
    payload = deflated(b" " * 50_000_000)
    inflater = Inflater(ALONE)
    with pytest.raises(TooLarge):
        inflater.inflate(payload, 1000)
    assert inflater.inflate(deflated(b"x" * 1000), 1000) == b"x" * 1000
    with pytest.raises(TooLarge):
        inflater.inflate(deflated(b"x" * 1001), 1000)


@given(st.binary(max_size=200), st.booleans())
def test_any_bytes_inflate_or_are_refused(data: bytes, keeps_context: bool) -> None:
    inflater = Inflater(Deflate(peer_keeps_context=keeps_context))
    try:
        assert len(inflater.inflate(data, 500)) <= 500
    except (TooLarge, Malformed):
        return


@given(st.lists(st.binary(max_size=300), max_size=5), st.booleans())
def test_what_others_deflate_comes_back(messages: Sequence[bytes], keeps_context: bool) -> None:
    theirs = oracle(keeps_context=keeps_context)
    heard = hearing(Deflate(peer_keeps_context=keeps_context))
    for message in messages:
        heard.wire.feed(packed(theirs, message, Opcode.BINARY))
    assert heard.messages == [(message, True) for message in messages]


def test_a_wire_is_plain_again_after_a_refused_upgrade() -> None:
    wire: WebSocketWire = hearing(Deflate()).wire
    wire.deflate(None)
    assert wire.framing is SERVER_FRAMING
