"""Bytes from the network: WebSocket frames, JSON on a stream, HTTP."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable, Iterator
from functools import partial

from rwt_transports import Limits, Routes
from rwt_transports.api import HoldableWire, Wire, WireEvents
from rwt_transports.connection import ListenerState
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.http.connection import HttpConnection
from rwt_transports.http.routes import HttpRequest, HttpResponse
from rwt_transports.shared_pool import Holder
from rwt_transports.websocket.deflate import DeflateWire
from rwt_transports.websocket.extensions import DeflateTerms
from rwt_transports.websocket.wire import WebSocketWire
from rwt_transports.wires.json_stream import JsonStreamWire
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.whole_messages import MessageWire
from rwt_webrtc.packets.reassembly import Reassembly
from rwt_webrtc.transport.sdp import BadDescription, read_description, read_fragment
from tests.core.transports.rfc6455.frames import BINARY, frame
from tests.fuzz.protocol_targets import no_internal_errors
from tests.memory_pipe import MemoryPipe
from tests.webrtc.chunks import Chunk

LARGEST = 2_000
"""Largest message, so that small inputs reach what happens beyond it."""


class Heard:
    """Events reported by a wire."""

    holder = Holder()

    def __init__(self, skip: bool) -> None:
        self._skip = skip
        self.messages: list[tuple[bytes, bool]] = []
        self.answers = bytearray()
        self.ends: list[tuple[int, str, bool]] = []
        self.oversizes = 0
        self.is_late = False
        self.heads: list[bytes] = []

    def oversized_head(self, size: int, head: bytes) -> None:
        self.heads.append(head)

    def oversized(self, size: int) -> bool:
        self.oversizes += 1
        return self._skip

    def pong(self, data: bytes) -> None:
        self.answers += data

    def answer(self, data: bytes) -> None:
        self.answers += data

    def read_on_later(self) -> None:
        self.is_late = True

    def ended(self, code: int, reason: str, *, agreed: bool) -> None:
        self.ends.append((code, reason, agreed))


MakeWire = Callable[[WireEvents], Wire]


def feed(make: MakeWire, skip: bool, chunks: Iterator[bytes]) -> Heard:
    """Feed a wire as a driver does, into its own space where it offers some."""
    heard = Heard(skip)
    wire = make(heard)
    wire.message = lambda data, binary: heard.messages.append((bytes(data), binary))
    for piece in chunks:
        view = memoryview(piece)
        while view:
            space = wire.get_buffer()
            if space is None:
                wire.feed(bytes(view))
                read_on(wire, heard)
                break
            count = min(len(space), len(view))
            space[:count] = view[:count]
            space.release()
            wire.buffer_updated(count)
            read_on(wire, heard)
            view = view[count:]
    return heard


def read_on(wire: Wire, heard: Heard) -> None:
    """Read on in as many turns as the wire needs."""
    while heard.is_late:
        heard.is_late = False
        assert isinstance(wire, HoldableWire)
        wire.go_on()


def pieces(data: bytes, size: int) -> Iterator[bytes]:
    return (data[at : at + size] for at in range(0, len(data), size))


def _compare(make: MakeWire, skip: bool, data: bytes, cut: int) -> Heard:
    """Check that the received messages do not depend on how the network splits them."""
    whole = feed(make, skip, iter((data,)))
    cut_up = feed(make, skip, pieces(data, cut))
    assert cut_up.messages == whole.messages
    assert len(whole.ends) <= 1 and len(cut_up.ends) <= 1
    assert all(len(message) <= LARGEST for message, _ in whole.messages)
    return whole


def websocket(data: bytes) -> None:
    """Frames after the handshake; the first two bytes choose the side, the options and the cut."""
    if len(data) < 2:
        return
    options, cut, rest = data[0], data[1] or 256, data[2:]

    def make(events: WireEvents) -> Wire:
        return WebSocketWire(
            events,
            Limits(message_bytes=LARGEST, strict_utf8=bool(options & 2)),
            ReceiveBufferPool(),
            server=not options & 1,
        )

    heard = _compare(make, bool(options & 4), rest, cut)
    assert sum(len(message) for message, _ in heard.messages) <= len(rest)
    assert len(heard.answers) <= 3 * len(rest) + 127, "more answers than questions"


def deflate(data: bytes) -> None:
    """The same where permessage-deflate was agreed; the first byte chooses the terms, and whether the rest is
    what the network brings, or a message to be compressed and sent twice."""
    if len(data) < 2:
        return
    options, cut, rest = data[0], data[1] or 256, data[2:]
    terms = DeflateTerms(bool(options & 1), bool(options & 2), 12)
    if options & 4:
        packer = zlib.compressobj(wbits=-15)
        for _ in range(2):
            packed = (packer.compress(rest) + packer.flush(zlib.Z_SYNC_FLUSH))[:-4]
            rest += frame(BINARY, packed, reserved=4)

    def make(events: WireEvents) -> Wire:
        return DeflateWire(
            terms,
            events,
            Limits(message_bytes=LARGEST, strict_utf8=bool(options & 8)),
            ReceiveBufferPool(),
        )

    _compare(make, bool(options & 16), rest, cut)


def json_stream(data: bytes) -> None:
    """Objects one after the other on a stream; the first two bytes choose the options and the cut."""
    if len(data) < 2:
        return
    options, cut, rest = data[0], data[1] or 256, data[2:]

    def make(events: WireEvents) -> Wire:
        return JsonStreamWire(events, Limits(message_bytes=LARGEST), ReceiveBufferPool())

    # What stands between objects, and what is over the limit, is cut where the network cuts it.
    if len(rest) <= LARGEST and rest[:1] == b"{" and rest.count(b"}{") == rest.count(b"}") - 1:
        heard = _compare(make, bool(options & 1), rest, cut)
    else:
        heard = feed(make, bool(options & 1), pieces(rest, cut))
    assert sum(len(message) for message, _ in heard.messages) <= len(rest)


class _Echo:
    """An endpoint that keeps nothing."""

    def receive(self, data: bytes, binary: bool) -> None:
        assert len(data) <= LARGEST

    def closed(self, code: int, reason: str) -> None:
        """No-op: no buffer is held."""


def _accept(sink: Sink, peer: PeerInfo) -> Endpoint:
    return _Echo()


def _page(request: HttpRequest) -> HttpResponse:
    return HttpResponse(request.body)


def http(data: bytes) -> None:
    """A whole connection, from its first byte: HTTP, the handshake, then WebSocket; the first byte is the
    cut."""
    no_internal_errors(logging.getLogger("rwt_transports"))
    routes = Routes()
    routes.get("/", _page)
    routes.add("/", _page, "POST")
    limits = Limits(message_bytes=LARGEST, http_header_bytes=500, http_body_bytes=500)
    state = ListenerState(_accept, WebSocketWire, limits, partial(HttpConnection, routes), "ws")
    pipe = MemoryPipe(state.attach, "memory", 0)
    received = 0
    for piece in pieces(data[1:], data[0] or 256):
        pipe.send(piece)
        received += len(pipe.receive())
    assert received <= 40 * len(data) + 2_000, "more answers than questions"
    pipe.cut()
    assert not state.connections


def description(data: bytes) -> None:
    """Session description of a WebRTC peer, and its further candidates."""
    for read in (read_description, read_fragment):
        try:
            read(data)
        except BadDescription as error:
            assert str(error).isprintable()


def whole_messages(data: bytes) -> None:
    """Messages between a data channel and its connection, cut anywhere."""
    if data:
        for skip in (False, True):
            heard = _compare(_message_wire, skip, data[1:], data[0] or 256)
            assert skip or not heard.heads


def _message_wire(events: WireEvents) -> Wire:
    return MessageWire(events, Limits(message_bytes=LARGEST), ReceiveBufferPool())


def fragments(data: bytes) -> None:
    """Fragments of SCTP in any order, with what their sender gives up: all that is held is given back."""
    held = incomplete = 0

    def hold(change: int, count: int) -> None:
        nonlocal held, incomplete
        held += change
        incomplete += count
        assert 0 <= held <= 300 * len(data) + 300 and 0 <= incomplete <= len(data)

    stream = Reassembly(0, 100, hold)
    seen = set()
    for at in range(0, len(data) - 3, 4):
        tsn, flags, sequence, size = data[at : at + 4]
        if flags & 0x80:
            stream.prune_chunks(tsn)
        elif tsn not in seen:
            seen.add(tsn)
            stream.add_chunk(Chunk(tsn, flags & 7, sequence, bytes(size)))
        for _, _, message in stream.pop_messages():
            assert len(message) <= 1024
    stream.clear()
    assert held == incomplete == 0
