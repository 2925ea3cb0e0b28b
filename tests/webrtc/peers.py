"""WebRTC's serving side without a server: endpoints that keep what they get; and peers of plain aiortc."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from aiortc import RTCConfiguration, RTCDataChannel, RTCPeerConnection, RTCSessionDescription

from rwt_transports.api import FlowControl
from rwt_transports.endpoint import Accept, PeerInfo, Sink
from rwt_transports.http.addresses import AddressCount
from rwt_transports.http.routes import HttpRequest, HttpResponse
from rwt_transports.limits import Limits
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_webrtc.transport.ice_servers import IceServer
from rwt_webrtc.transport.peer import PeerTerms
from rwt_webrtc.transport.signalling import PeerBounds, Peers, data_routes, open_peers
from tests.page_readers import NobodyInParticular
from tests.waiting import until


@dataclass(eq=False)
class End:
    """An endpoint that keeps what it gets."""

    sink: Sink
    peer: PeerInfo
    got: list[tuple[bytes, bool]] = field(default_factory=list)
    heads: list[tuple[int, int, bytes]] = field(default_factory=list)
    closed_with: tuple[int, str] | None = None
    flow_control: FlowControl | None = None

    def receive(self, data: bytes, binary: bool) -> None:
        self.got.append((data, binary))

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        self.heads.append((size, limit, head))

    def set_flow_control(self, flow_control: FlowControl) -> None:
        self.flow_control = flow_control

    def closed(self, code: int, reason: str) -> None:
        self.closed_with = (code, reason)


class Side:
    """The side that answers offers."""

    def __init__(self, peers: Peers, accept: Accept | None = None) -> None:
        self.peers = peers
        self.ends: list[End] = []
        routes = data_routes(peers, accept or self.accept)
        self._routes = {(route.method, route.path): route for route in routes}

    def accept(self, sink: Sink, info: PeerInfo) -> End:
        self.ends.append(End(sink, info))
        return self.ends[-1]

    async def ask(
        self,
        method: str,
        path: str,
        body: bytes = b"",
        content_type: str = "application/sdp",
        headers: dict[str, str] | None = None,
    ) -> HttpResponse:
        """Answer a request as the server's port does."""
        route = self._routes[method, "/webrtc" if path == "/webrtc" else "/webrtc/*"]
        sent = {"content-type": content_type, **(headers or {})}
        answer = route.page(HttpRequest(method, path, "", sent, body, "127.0.0.1"), NobodyInParticular())
        return answer if isinstance(answer, HttpResponse) else await answer


@asynccontextmanager
async def answering(
    limits: Limits | None = None,
    bounds: PeerBounds | None = None,
    accept: Accept | None = None,
    *,
    servers: tuple[IceServer, ...] = (),
    channels: int = 16,
    connect_seconds: float = 30.0,
) -> AsyncIterator[Side]:
    """Answer offers within the block."""

    async def find_servers() -> tuple[IceServer, ...]:
        return servers

    terms = PeerTerms(
        limits or Limits(), ReceiveBufferPool(), AddressCount(), channels, connect_seconds=connect_seconds
    )
    async with open_peers(terms, bounds or PeerBounds(), find_servers) as peers:
        yield Side(peers, accept)


def text_of(answer: HttpResponse) -> str:
    assert isinstance(answer.body, bytes)
    return answer.body.decode()


class OtherSide:
    """A peer of plain aiortc."""

    def __init__(self) -> None:
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.location = ""

    async def offer(self) -> bytes:
        await self.connection.setLocalDescription()
        return self.connection.localDescription.sdp.encode()

    async def take_answer(self, answer: str) -> None:
        await self.connection.setRemoteDescription(RTCSessionDescription(answer, "answer"))

    async def connect(self, side: Side, *channels: RTCDataChannel) -> None:
        """Signal, and wait until all channels are open."""
        answer = await side.ask("POST", "/webrtc", await self.offer())
        assert answer.status == 201, text_of(answer)
        self.location = answer.headers["Location"]
        await self.take_answer(text_of(answer))
        await until(lambda: all(channel.readyState == "open" for channel in channels))
        await until(lambda: len(side.ends) >= len(channels))


@asynccontextmanager
async def other_side() -> AsyncIterator[OtherSide]:
    """A peer of plain aiortc within the block."""
    other = OtherSide()
    try:
        yield other
    finally:
        await other.connection.close()
        await asyncio.sleep(0)


def received(channel: RTCDataChannel) -> list[str | bytes]:
    """Messages on a channel from now on."""
    got: list[str | bytes] = []
    channel.on("message", got.append)
    return got
