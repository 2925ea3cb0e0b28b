"""Attacks of peers, by name, and what they have in common."""

from __future__ import annotations

import resource
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from struct import pack
from typing import Never

from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.rtcsctptransport import Chunk, RTCSctpTransport, serialize_packet

from rwt_transports.endpoint import PeerInfo, Sink
from rwt_transports.http.addresses import AddressCount
from rwt_transports.limits import Limits
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_webrtc.packets.ice_guard import Reach
from rwt_webrtc.transport.peer import Peer, PeerTerms
from rwt_webrtc.transport.sdp import read_description
from tests.waiting import until
from tests.webrtc.peers import OtherSide, Side, other_side

MIB = 1 << 20


def memory() -> float:
    """Resident memory in MiB."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / MIB


@dataclass
class Damage:
    """Damage of an attack.

    Attributes:
        held_ms: CPU time of the longest turn of the event loop, in milliseconds.
        grown_mib: growth of the process in MiB.
        log_bytes: size of the log.
        log: end of the log.
        sent: datagrams that the attacked side sent to addresses that never answered.
        status: status of the response to an offer.
        began_mib: memory at the beginning of the measurement.
    """

    held_ms: float = 0.0
    grown_mib: float = 0.0
    log_bytes: int = 0
    log: str = ""
    sent: int = 0
    status: int = 0
    began_mib: float = 0.0

    def begin(self) -> None:
        """Measure from now on."""
        self.held_ms = self.grown_mib = 0.0
        self.began_mib = memory()


Attack = Callable[[Side, Damage], Awaitable[None]]

ATTACKS: dict[str, Attack] = {}


def attack(function: Attack) -> Attack:
    """Register an attack under its name."""
    ATTACKS[function.__name__] = function
    return function


class Raw(Chunk):
    """Chunk of arbitrary bytes."""

    def __init__(self, data: bytes) -> None:
        super().__init__()
        self._data = data

    def __bytes__(self) -> bytes:
        return self._data


def chunk(kind: int, body: bytes, flags: int = 0, length: int | None = None) -> bytes:
    """Return a chunk; `length` overrides its length field."""
    data = pack("!BBH", kind, flags, len(body) + 4 if length is None else length) + body
    return data + bytes(-len(data) % 4)


async def send(sctp: RTCSctpTransport, *chunks: bytes, tag: int | None = None) -> None:
    """Send a packet of chunks by an association."""
    data = serialize_packet(
        sctp._local_port,
        sctp._remote_port or 5000,
        sctp._remote_verification_tag if tag is None else tag,
        Raw(b"".join(chunks)),
    )
    await sctp.transport._send_data(data)


@asynccontextmanager
async def attacker(side: Side) -> AsyncIterator[tuple[OtherSide, RTCSctpTransport]]:
    """A connected peer within the block."""
    async with other_side() as other:
        await other.connect(side, other.connection.createDataChannel("open"))
        sctp = other.connection.sctp
        assert sctp is not None
        yield other, sctp


def refuse(sink: Sink, info: PeerInfo) -> Never:
    """Accept no channel: the client opens them."""
    raise AssertionError("the server opens no channel")


@asynccontextmanager
async def attacking_server(*, connected: bool = True) -> AsyncIterator[tuple[Peer, RTCPeerConnection, str]]:
    """Our client's peer with a server of plain aiortc, which attacks, and the offer of the client."""
    server = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    terms = PeerTerms(Limits(), ReceiveBufferPool(), AddressCount())
    client = Peer(terms, (), refuse, "127.0.0.1", reach=Reach.LOOPBACK, on_closed=lambda peer: None)
    try:
        channel = client.connection.createDataChannel("rosbridge")
        offer = await client.describe()
        if connected:
            await server.setRemoteDescription(RTCSessionDescription(offer, "offer"))
            await server.setLocalDescription()
            answer = server.localDescription.sdp.encode()
            await client.take_description(read_description(answer), "answer")
            await until(lambda: channel.readyState == "open")
        yield client, server, offer
    finally:
        await client.close()
        await server.close()
