"""Attacks of a TURN server on our client, to which a robot has named it."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from struct import pack
from threading import Thread

from rwt_transports.http.addresses import AddressCount
from rwt_transports.limits import Limits
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_webrtc.packets.ice_guard import Reach
from rwt_webrtc.transport.ice_servers import IceServer
from rwt_webrtc.transport.peer import Peer, PeerTerms
from tests.faults.peers.attacks import Damage, attack, refuse
from tests.webrtc.peers import Side

REQUESTS, REQUESTS_PER_SECOND = 100, 20
"""Requests that a TURN server may cause."""
_COOKIE = 0x2112A442


def message(kind: int, transaction: bytes, *attributes: tuple[int, bytes]) -> bytes:
    """Return a STUN message."""
    body = b"".join(
        pack("!HH", each, len(value)) + value + bytes(-len(value) % 4) for each, value in attributes
    )
    return pack("!HHL", kind, len(body), _COOKIE) + transaction + body


def allocated(request: bytes, lifetime: int = 600) -> bytes:
    """Return the success response to any request."""
    address = (0, 1, *(0x2112 ^ 4000).to_bytes(2, "big"), *(0x7F000001 ^ _COOKIE).to_bytes(4, "big"))
    kind = int.from_bytes(request[:2], "big") | 0x100
    attributes = ((0x000D, pack("!L", lifetime)), (0x0016, bytes(address)), (0x0020, bytes(address)))
    return message(kind, request[8:20], *attributes)


@asynccontextmanager
async def asking(kind: int, serve: Callable[[socket.socket], None], transport: str) -> AsyncIterator[None]:
    """Our client gathers candidates from a server in a thread, which ends with its socket."""
    server = socket.socket(socket.AF_INET, kind)
    server.bind(("127.0.0.1", 0))

    def run() -> None:
        with suppress(OSError):
            serve(server)

    thread = Thread(target=run)
    thread.start()
    servers = (IceServer(f"turn:127.0.0.1:{server.getsockname()[1]}?transport={transport}", "me", "secret"),)
    terms = PeerTerms(Limits(), ReceiveBufferPool(), AddressCount())
    client = Peer(terms, servers, refuse, "127.0.0.1", reach=Reach.LOOPBACK, on_closed=lambda peer: None)
    try:
        client.connection.createDataChannel("rosbridge")
        await client.describe()
        yield
    finally:
        await asyncio.wait({asyncio.create_task(client.close())}, timeout=2)
        with suppress(OSError):
            server.shutdown(socket.SHUT_RDWR)
        server.close()
        await asyncio.to_thread(thread.join)


@attack
async def turn_small_frames(side: Side, damage: Damage) -> None:
    """The smallest messages over TCP, hundreds of thousands at once."""

    def serve(server: socket.socket) -> None:
        server.listen()
        connection, _ = server.accept()
        with connection:
            connection.sendall(allocated(connection.recv(2000)))
            for _ in range(4):
                connection.sendall(b"\x40\x00\x00\x00" * 65_536)
            connection.sendall(b"\x40\x00\xff\xff")
            connection.recv(2000)

    async with asking(socket.SOCK_STREAM, serve, "tcp"):
        await asyncio.sleep(1.5)


@attack
async def turn_malformed_messages(side: Side, damage: Damage) -> None:
    """Messages whose attributes have wrong lengths, and as many attributes as there is room for."""

    def serve(server: socket.socket) -> None:
        request, client = server.recvfrom(2000)
        for number in (0x0003, 0x000C, 0x000D, 0x0019, 0x0024, 0x8028, 0x8029, 0x802A):
            server.sendto(message(0x0103, request[8:20], (number, b"xy")), client)
        many = [(0x0020, b"\x00\x01" + bytes(6))] * 5_000
        for _ in range(10):
            server.sendto(message(0x0103, bytes(12), *many), client)
        server.sendto(allocated(request), client)
        time.sleep(0.2)

    async with asking(socket.SOCK_DGRAM, serve, "udp"):
        await asyncio.sleep(0.5)


@attack
async def turn_lifetime_of_zero(side: Side, damage: Damage) -> None:
    """Allocations that expire at once; `sent` is what exceeds the rate."""
    count, began = 0, time.monotonic()

    def serve(server: socket.socket) -> None:
        nonlocal count
        server.settimeout(3)
        while time.monotonic() - began < 5:
            request, client = server.recvfrom(2000)
            count += 1
            server.sendto(allocated(request, 0), client)

    async with asking(socket.SOCK_DGRAM, serve, "udp"):
        await asyncio.sleep(2.5)
    damage.sent = max(0, int(count - REQUESTS - REQUESTS_PER_SECOND * (time.monotonic() - began)))
    assert count > 3
