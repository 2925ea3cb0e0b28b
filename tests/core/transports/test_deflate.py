"""permessage-deflate (RFC 7692): against zlib itself, and against another library's client."""

from __future__ import annotations

import json
import zlib
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from typing import Protocol

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.asyncio.client import ClientConnection, connect
from websockets.extensions.permessage_deflate import ClientPerMessageDeflateFactory

from rwt_protocol.frames import Frame
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.limits import Deflate, Limits
from rwt_transports.listener import listen
from rwt_transports.websocket.deflate import LARGEST_BYTES, DeflateWire, shared_framing
from rwt_transports.websocket.extensions import DeflateTerms
from rwt_transports.websocket.handshake import answer_handshake
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from tests.core.transports.conftest import Heard
from tests.core.transports.test_websocket_wire import frame

LIMIT = 100_000
TEXT, BINARY, CONTINUATION, CLOSE, PING = 0x81, 0x82, 0x80, 0x88, 0x89
RSV1 = 0x40
TAIL = b"\0\0\xff\xff"


class Peer(Heard[DeflateWire]):
    """Events reported by a wire with compression."""

    def __init__(
        self,
        *,
        keeps: bool = False,
        peer_keeps: bool = True,
        strict: bool = False,
        limit: int = LIMIT,
        buffers: ReceiveBufferPool | None = None,
    ) -> None:
        terms = DeflateTerms(keeps_context=keeps, peer_keeps_context=peer_keeps, window_bits=12)
        limits, pool = Limits(message_bytes=limit, strict_utf8=strict), buffers or ReceiveBufferPool()
        super().__init__(lambda events: DeflateWire(terms, events, limits, pool), skip=True)


class Packer:
    """A client's side, made of zlib alone."""

    def __init__(self) -> None:
        self._packer = zlib.compressobj(9, zlib.DEFLATED, -15)

    def __call__(self, data: bytes) -> bytes:
        packed = self._packer.compress(data) + self._packer.flush(zlib.Z_SYNC_FLUSH)
        assert packed.endswith(TAIL)
        return packed[:-4]


def test_a_large_message_is_inflated_in_steps_and_what_follows_waits_for_it() -> None:
    peer = Peer(limit=10_000_000)
    taken: list[Iterator[None]] = []
    peer.wire.take_steps = lambda steps, _: taken.append(steps)
    text = bytes(range(256)) * 30_000
    packer = Packer()
    peer.wire.feed(
        frame(RSV1 | BINARY, packer(text)) + frame(TEXT, b"after") + frame(RSV1 | TEXT, packer(b"x"))
    )
    (steps,) = taken
    assert peer.messages == []
    assert len([*steps]) > len(text) // 100_000
    assert peer.messages == [(text, True)]
    peer.wire.go_on()
    assert peer.messages == [(text, True), (b"after", False), (b"x", False)]


def test_one_large_message_is_inflated_after_the_other_where_there_is_no_room_for_both() -> None:
    pool = ReceiveBufferPool(30_000_000)  # A quarter of which may be whole and unread.
    taken: list[tuple[Iterator[None], Callable[[], bool]]] = []
    peers = [Peer(limit=10_000_000, buffers=pool) for _ in range(3)]
    text = bytes(range(256)) * 30_000
    for peer in peers:
        peer.wire.take_steps = lambda *steps: taken.append(steps)
        peer.wire.feed(frame(RSV1 | BINARY, Packer()(text)))
    first, second, third = taken
    assert first[1]()
    assert not second[1]() and not third[1]()
    assert first[1]()
    list(first[0])
    assert peers[0].messages == [(text, True)]
    assert not second[1](), "it is whole, and nobody has read it"
    pool.is_read(peers[0].wire)  # As a connection says when it goes on, and when it is lost.
    assert second[1]() and not third[1]()
    pool.is_read(peers[1].wire)
    assert third[1]()


def test_a_bomb_ends_the_connection_in_steps() -> None:
    peer = Peer(limit=10_000_000)
    taken: list[Iterator[None]] = []
    peer.wire.take_steps = lambda steps, _: taken.append(steps)
    peer.wire.feed(frame(RSV1 | TEXT, Packer()(bytes(20_000_000))))
    (steps,) = taken
    assert peer.codes == []
    assert len([*steps]) < 200
    assert peer.codes == [1009] and peer.messages == []


def test_the_limit_itself_is_taken() -> None:
    peer = Peer()
    pack = Packer()
    peer.wire.feed(frame(RSV1 | TEXT, pack(bytes(LIMIT))))
    assert peer.messages == [(bytes(LIMIT), False)]
    peer.wire.feed(frame(RSV1 | TEXT, pack(bytes(LIMIT + 1))))
    assert peer.codes == [1009]


@pytest.mark.parametrize("pieces", [1, 2])
def test_too_much_before_it_is_inflated_ends_the_connection(pieces: int) -> None:
    peer = Peer()
    part = bytes(LIMIT // pieces + 1)
    peer.wire.feed(frame(RSV1 | (TEXT if pieces == 1 else 0x01), part))
    if pieces == 2:
        peer.wire.feed(frame(CONTINUATION, part))
    assert peer.codes == [1009]


def test_a_plain_message_that_is_too_large_is_skipped_as_ever() -> None:
    peer = Peer()
    pack = Packer()
    peer.wire.feed(frame(RSV1 | TEXT, pack(b"one")))
    peer.wire.feed(frame(TEXT, bytes(LIMIT + 1)))
    peer.wire.feed(frame(RSV1 | TEXT, pack(b"one")))
    assert peer.sizes == [LIMIT + 1]
    assert peer.messages == [(b"one", False)] * 2


def test_text_is_checked_after_it_is_inflated() -> None:
    peer = Peer(strict=True)
    peer.wire.feed(frame(RSV1 | TEXT, Packer()("grüße".encode())))
    assert len(peer.messages) == 1
    peer.wire.feed(frame(RSV1 | TEXT, Packer()(b"\xff")))
    assert peer.codes == [1007]


@given(st.lists(st.binary(max_size=40), max_size=4), st.booleans())
def test_any_bytes_are_a_message_or_an_end(payloads: list[bytes], keeps: bool) -> None:
    peer = Peer(peer_keeps=keeps)
    for payload in payloads:
        peer.wire.feed(frame(RSV1 | TEXT, payload))
    assert set(peer.codes) <= {1007, 1009}
    assert all(len(data) <= LIMIT for data, _ in peer.messages)


class Unpacker(Protocol):
    """Decompressor of :mod:`zlib`."""

    def decompress(self, data: bytes, /) -> bytes:
        """Return the bytes that end with these."""
        ...


def unpacked(data: bytes, unpacker: Unpacker) -> bytes:
    """The one message in what a server wrote."""
    assert data[0] & RSV1
    start = {126: 4, 127: 10}.get(data[1], 2)
    return unpacker.decompress(data[start:] + TAIL)


def test_without_context_all_peers_share_the_bytes() -> None:
    first, second = Peer().wire.framing, Peer().wire.framing
    assert first is second and first.shared
    message = Frame(b'{"a":', b'"' + b"0123456789" * 50 + b'"}')
    for _ in range(2):
        data = message.framed(first.whole)
        assert len(data) < 60
        assert unpacked(data, zlib.decompressobj(-12)) == message.data
    assert message.framed(first.whole) is data


def test_with_context_the_second_message_is_smaller() -> None:
    framing = Peer(keeps=True).wire.framing
    assert not framing.shared
    message = Frame(json.dumps({"x": 0.123456, "y": 1.5, "z": "some text that comes again"}).encode())
    unpacker = zlib.decompressobj(-12)
    sizes = []
    for _ in range(3):
        data = framing.whole(message)
        sizes.append(len(data))
        assert unpacked(data, unpacker) == message.data
    assert sizes[1] < sizes[0] / 3


@pytest.mark.parametrize("keeps", [True, False])
def test_what_does_not_pay_goes_out_as_it_is(keeps: bool) -> None:
    framing = Peer(keeps=keeps).wire.framing
    large = Frame(bytes(LARGEST_BYTES + 1))
    assert framing.whole(large)[0] == TEXT
    assert b"".join(framing.pieces(large)) == framing.whole(large)
    if not keeps:
        assert framing.whole(Frame(b"short"))[0] == TEXT
        assert framing.whole(Frame(bytes(range(256))))[0] == TEXT


HEADERS = [
    ("Host", "x"),
    ("Upgrade", "websocket"),
    ("Connection", "Upgrade"),
    ("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ=="),
    ("Sec-WebSocket-Version", "13"),
]


@pytest.mark.parametrize(
    ("deflate", "offer", "terms"),
    [
        (Deflate.OFF, "permessage-deflate", None),
        (Deflate.SHARED, "", None),
        (Deflate.SHARED, "permessage-foo", None),
        (Deflate.SHARED, "permessage-deflate; bogus=1", None),
        (Deflate.SHARED, "permessage-deflate", DeflateTerms(False, True, 15)),
        (Deflate.SHARED, "permessage-deflate; server_max_window_bits=10", DeflateTerms(False, True, 10)),
        (Deflate.SHARED, "permessage-deflate; client_no_context_takeover", DeflateTerms(False, False, 15)),
        (Deflate.CONTEXT, "permessage-deflate; client_max_window_bits", DeflateTerms(True, True, 12)),
        (Deflate.CONTEXT, "permessage-deflate; server_no_context_takeover", DeflateTerms(False, True, 12)),
    ],
)
def test_what_a_handshake_agrees_on(deflate: Deflate, offer: str, terms: DeflateTerms | None) -> None:
    headers = [*HEADERS, ("Sec-WebSocket-Extensions", offer)] if offer else HEADERS
    answer = answer_handshake("/", headers, deflate)
    assert answer.status == 101
    assert answer.deflate == terms
    assert (b"permessage-deflate" in answer.head) is (terms is not None)


def test_a_smaller_window_is_kept_to() -> None:
    text = bytes(range(256)) * 2 + b"x" * 2000 + bytes(range(256)) * 2
    data = shared_framing(9).whole(Frame(text))
    assert unpacked(data, zlib.decompressobj(-9)) == text


class Echo:
    """Sends everything back twice."""

    def __init__(self, sink: Sink, _: PeerInfo) -> None:
        self._sink = sink

    def receive(self, data: bytes, binary: bool) -> None:
        message = Frame(data, binary=binary)
        self._sink.send(message)
        self._sink.flow("/echo").send(message)

    def closed(self, code: int, reason: str) -> None:
        pass


@asynccontextmanager
async def echo(deflate: Deflate, offer: ClientPerMessageDeflateFactory) -> AsyncIterator[ClientConnection]:
    def accept(sink: Sink, info: PeerInfo) -> Endpoint:
        return Echo(sink, info)

    limits = Limits(deflate=deflate, close_seconds=1)
    async with (
        listen("ws://127.0.0.1:0", accept, limits=limits) as listener,
        connect(listener.url, compression=None, extensions=[offer], max_size=None) as client,
    ):
        yield client


@pytest.mark.anyio
@pytest.mark.parametrize("deflate", [Deflate.SHARED, Deflate.CONTEXT])
@pytest.mark.parametrize(
    "offer",
    [
        ClientPerMessageDeflateFactory(),
        ClientPerMessageDeflateFactory(client_no_context_takeover=True),
        ClientPerMessageDeflateFactory(server_no_context_takeover=True, server_max_window_bits=10),
        ClientPerMessageDeflateFactory(client_max_window_bits=9),
    ],
    ids=["plain", "client forgets", "server forgets", "small window"],
)
async def test_another_library_reads_and_is_read(
    deflate: Deflate, offer: ClientPerMessageDeflateFactory
) -> None:
    async with echo(deflate, offer) as client:
        assert client.protocol.extensions
        for text in ("hello", "hello", "x" * 30_000, "x" * 70_000, "grüße " * 300_000, "", "hello"):
            await client.send(text)
            assert [await client.recv(), await client.recv()] == [text, text]
        octets = bytes(range(256)) * 1000
        await client.send(octets)
        assert [await client.recv(), await client.recv()] == [octets, octets]
