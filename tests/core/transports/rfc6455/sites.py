"""Where the cases are played: a pipe in memory, and real sockets under each driver and event loop.

Every stack has the same listeners: `default`; `strict`, which checks UTF-8; `untold`, whose endpoint cannot
be told of messages over the limit; and those of :mod:`tests.core.transports.rfc6455.compression`.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Literal

from anyio.from_thread import start_blocking_portal

from rwt_protocol.frames import Frame
from rwt_transports import Limits, Routes, listen
from rwt_transports.api import Driver
from rwt_transports.connection import ListenerState
from rwt_transports.drivers.anyio_stream import AnyioDriver
from rwt_transports.drivers.asyncio_protocol import AsyncioDriver
from rwt_transports.endpoint import Accept, Endpoint, PeerInfo, Sink
from rwt_transports.http.connection import HttpConnection
from rwt_transports.limits import Deflate
from rwt_transports.listener import Listener
from rwt_transports.websocket.wire import WebSocketWire
from tests.core.transports.rfc6455.case import Case
from tests.core.transports.rfc6455.closing import LIMIT
from tests.core.transports.rfc6455.compression import inflated
from tests.core.transports.rfc6455.frames import FIN, TEXT, ReadFrame, read_frames, text
from tests.core.transports.rfc6455.handshake import REQUEST
from tests.memory_pipe import MemoryPipe

PATIENCE = 60.0
"""Seconds after which a silent server fails the case."""
SENTINEL = b"<the end of the case>"

_ECHO_OF_SENTINEL = bytes((FIN | TEXT, len(SENTINEL))) + SENTINEL


class Untold:
    """Sends every message back."""

    def __init__(self, sink: Sink) -> None:
        self._sink = sink

    def receive(self, data: bytes, binary: bool) -> None:
        self._sink.send(Frame(data, binary=binary))

    def closed(self, code: int, reason: str) -> None:
        """No-op: no buffer is held."""


class Told(Untold):
    """The same, and answers messages over the limit."""

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        assert size > limit
        self._sink.send(Frame(b"skipped more than %d" % limit))


def accept_told(sink: Sink, peer: PeerInfo) -> Endpoint:
    return Told(sink)


def accept_untold(sink: Sink, peer: PeerInfo) -> Endpoint:
    return Untold(sink)


@dataclass(frozen=True, slots=True)
class Site:
    """One listener's settings, and what its clients offer: a header line."""

    accept: Accept
    limits: Limits
    offer: bytes = b""

    @property
    def request(self) -> bytes:
        """The handshake with which the cases begin."""
        return REQUEST[:-2] + self.offer + b"\r\n" if self.offer else REQUEST


_OFFER = b"Sec-WebSocket-Extensions: permessage-deflate"


SITES: Mapping[str, Site] = {
    "default": Site(accept_told, Limits(message_bytes=LIMIT)),
    "strict": Site(accept_told, Limits(message_bytes=LIMIT, strict_utf8=True)),
    "untold": Site(accept_untold, Limits(message_bytes=LIMIT // 4)),
    "shared": Site(accept_told, Limits(message_bytes=LIMIT, deflate=Deflate.SHARED), _OFFER + b"\r\n"),
    "context": Site(accept_told, Limits(message_bytes=LIMIT, deflate=Deflate.CONTEXT), _OFFER + b"\r\n"),
    "forgetful": Site(
        accept_told,
        Limits(message_bytes=LIMIT, deflate=Deflate.CONTEXT),
        _OFFER + b"; client_no_context_takeover\r\n",
    ),
}


@dataclass(frozen=True, slots=True)
class Seen:
    """Frames that a client received, and True if the server ended the connection."""

    frames: list[ReadFrame]
    ended: bool


Done = Callable[[bytes | bytearray], bool]
"""True if the response is complete."""
Exchange = Callable[[str, bytes, Sequence[bytes], Done | None], tuple[bytes, bool]]
"""Sends a request and then pieces to a site; gives every byte that came back, and whether the server ended
the connection. Without a last argument it waits for the end."""


def play(exchange: Exchange, case: Case, cut: int) -> Seen:
    """Play one case in pieces of `cut` bytes; 0 sends it as one."""
    sent = case.sent + (text(SENTINEL) if case.lives else b"")
    pieces = [sent[at : at + cut] for at in range(0, len(sent), cut)] if cut else [sent]
    site = SITES[case.site]
    done = (_all_is_here if site.offer else ends_with_sentinel) if case.lives else None
    data, ended = exchange(case.site, site.request, pieces, done)
    head, _, rest = data.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 101 ")
    assert (b"permessage-deflate" in head) is bool(site.offer)
    frames = read_frames(rest)
    if site.offer:
        frames = inflated(frames)
    if case.lives:
        assert frames.pop() == (FIN | TEXT, SENTINEL)
    return Seen(frames, ended)


def ends_with_sentinel(data: bytes | bytearray) -> bool:
    """Return True if the sentinel has come back, as a message that is not compressed."""
    return data.endswith(_ECHO_OF_SENTINEL)


def _all_is_here(data: bytes | bytearray) -> bool:
    """The same where it may be compressed."""
    try:
        frames = inflated(read_frames(bytes(data).partition(b"\r\n\r\n")[2]))
    except (AssertionError, IndexError, struct.error):
        return False  # a frame is cut
    return frames[-1:] == [(FIN | TEXT, SENTINEL)]


def check(case: Case, seen: Seen) -> None:
    """Return True if the server did what the case wants; AssertionError when not."""
    frames = seen.frames
    if case.fails is not None:
        first, body = frames.pop()
        assert first == 0x88, "the last frame must be a close"
        assert int.from_bytes(body[:2], "big") == case.fails
        assert body[2:].decode(), "a reason must be given"
    assert tuple(frames) == case.answers
    assert seen.ended is not case.lives


# -- in memory ---------------------------------------------------------------------------------------------


def in_memory(site: str, request: bytes, pieces: Sequence[bytes], done: Done | None) -> tuple[bytes, bool]:
    """A pipe without sockets, loop or time."""
    chosen = SITES[site]
    state = ListenerState(
        chosen.accept, WebSocketWire, chosen.limits, partial(HttpConnection, Routes()), "ws"
    )
    pipe = MemoryPipe(state.attach, "memory", 0)
    pipe.send(request)
    for piece in pieces:
        pipe.send(piece)
    data = pipe.receive()
    ended = pipe.ended
    pipe.cut()
    return data, ended


# -- over sockets ------------------------------------------------------------------------------------------

Stack = tuple[Literal["asyncio", "trio"], Callable[[], Driver]]
STACKS: Mapping[str, Stack] = {
    "asyncio-sockets": ("asyncio", AsyncioDriver),
    "asyncio-streams": ("asyncio", AnyioDriver),
    "trio-streams": ("trio", AnyioDriver),
}


@contextmanager
def over_sockets(stack: str) -> Iterator[Exchange]:
    """Listeners on loopback, in a thread of their own."""
    backend, make_driver = STACKS[stack]
    with start_blocking_portal(backend) as portal, contextlib.ExitStack() as listeners:
        ports: dict[str, int] = {}
        for name, site in SITES.items():
            # The driver looks for its event loop when it opens, which is in the portal's thread.
            opening: AbstractAsyncContextManager[Listener] = listen(
                "ws://127.0.0.1:0", site.accept, limits=site.limits, driver=make_driver()
            )
            listener = listeners.enter_context(portal.wrap_async_context_manager(opening))
            ports[name] = int(listener.url.rpartition(":")[2])
        yield _SocketExchange(ports)


class _SocketExchange:
    """A client of blocking sockets."""

    def __init__(self, ports: Mapping[str, int]) -> None:
        self._ports = ports

    def __call__(
        self, site: str, request: bytes, pieces: Sequence[bytes], done: Done | None
    ) -> tuple[bytes, bool]:
        with socket.create_connection(("127.0.0.1", self._ports[site]), PATIENCE) as client:
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # A server that has closed may answer what is still sent with a reset.
            with contextlib.suppress(ConnectionError):
                client.sendall(request)
                for piece in pieces:
                    client.sendall(piece)
                if not pieces:
                    # After a refused request another could follow.
                    client.shutdown(socket.SHUT_WR)
            return _receive(client, done)


def _receive(client: socket.socket, done: Done | None) -> tuple[bytes, bool]:
    data = bytearray()
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        try:
            more = client.recv(1 << 20)
        except ConnectionResetError:
            return bytes(data), True
        if not more:
            return bytes(data), True
        data += more
        if done is not None and done(data):
            return bytes(data), False
    raise TimeoutError(f"the server sent {len(data)} bytes and then nothing that the case waits for")
