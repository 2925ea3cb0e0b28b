"""Attacks by datagrams to the ports of a peer, most of them from an unrelated socket."""

from __future__ import annotations

import asyncio
import re
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from struct import pack

from aioice import stun

from rwt_webrtc.packets.ice_guard import CHECKS, CHECKS_PER_SECOND
from tests.faults.peers.attacks import Damage, attack, attacker, attacking_server
from tests.webrtc.peers import Side, other_side, text_of

BUSY_SECONDS = 60
"""Seconds in which a busy machine sends the first checks."""


@attack
async def client_datagrams_before_ice(side: Side, damage: Damage) -> None:
    """Datagrams to our client's port before its server has answered."""
    async with attacking_server(connected=False) as (_, _, offer):
        await flood(ports_of(offer)[0])


def ports_of(description: str) -> list[int]:
    """Return the ports of the loopback candidates of a description."""
    words = [line.split() for line in description.splitlines() if line.startswith("a=candidate:")]
    return [int(each[5]) for each in words if each[4] == "127.0.0.1"]


def host_of(description: str) -> tuple[int, str]:
    """Return port and address of the first IPv4 candidate of a description."""
    words = [line.split() for line in description.splitlines() if line.startswith("a=candidate:")]
    return next((int(each[5]), each[4]) for each in words if ":" not in each[4])


async def offered(side: Side, change: Callable[[bytes], bytes] = bytes) -> tuple[int, str]:
    """Offer a data channel and never answer; returns the status and the text."""
    async with other_side() as other:
        other.connection.createDataChannel("never")
        answer = await side.ask("POST", "/webrtc", change(await other.offer()))
        return answer.status, text_of(answer)


@attack
async def datagrams_before_ice(side: Side, damage: Damage) -> None:
    """Datagrams from an unrelated socket to a peer's port before ICE completes."""
    _, answer = await offered(side)
    await flood(ports_of(answer)[0])


async def flood(port: int, host: str = "127.0.0.1") -> None:
    """Send 180 MB of datagrams that look like DTLS to a port of this machine."""
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stranger.setblocking(False)
    for number in range(6_000):
        data = bytes([22]) + bytes(60_000 if number % 2 else 1_200)
        try:
            stranger.sendto(data, (host, port))
        except BlockingIOError:
            await asyncio.sleep(0.001)
        if not number % 2:
            await asyncio.sleep(0)
    stranger.close()


@attack
async def empty_datagrams(side: Side, damage: Damage) -> None:
    """Empty datagrams from an unrelated socket to a connected peer, which stays connected."""
    async with attacker(side) as (other, _):
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for port in ports_of(other.connection.remoteDescription.sdp):
            stranger.sendto(b"", ("127.0.0.1", port))
            stranger.sendto(b"\x80", ("127.0.0.1", port))
        stranger.close()
        await asyncio.sleep(0.2)
        assert len(side.peers) == 1 and not side.ends[-1].closed_with


@attack
async def malformed_stun(side: Side, damage: Damage) -> None:
    """STUN messages with attributes of wrong lengths, and requests without credentials."""
    _, answer = await offered(side)
    (port, *_) = ports_of(answer)
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stranger.bind(("127.0.0.1", 0))
    stranger.setblocking(False)
    header = pack("!HHL", 1, 8, 0x2112A442) + bytes(12)
    for kind in (0x0003, 0x000C, 0x000D, 0x0019, 0x0024, 0x8028, 0x8029, 0x802A):
        for _ in range(50):
            stranger.sendto(header + pack("!HH", kind, 2) + bytes(4), ("127.0.0.1", port))
            stranger.sendto(header[:2] + bytes(2) + header[4:], ("127.0.0.1", port))
            await asyncio.sleep(0)
    await asyncio.sleep(0.1)
    while True:
        try:
            stranger.recv(2000)
        except BlockingIOError:
            break
        damage.sent += 1
    stranger.close()


SENT_PER_RECEIVED = 3
"""Maximum amplification before an address has answered."""


@asynccontextmanager
async def strangers(count: int) -> AsyncIterator[tuple[list[socket.socket], bytes]]:
    """Sockets that never answer, and the candidates that name them."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    lines = b""
    for number, each in enumerate(sockets):
        each.setblocking(False)
        each.bind(("127.0.0.1", 0))
        port = each.getsockname()[1]
        lines += f"a=candidate:{number} 1 udp {1000 + number} 127.0.0.1 {port} typ host\r\n".encode()
    try:
        yield sockets, lines
    finally:
        for each in sockets:
            each.close()


def datagrams(sockets: list[socket.socket]) -> list[int]:
    """Return the sizes of the datagrams that have come."""
    sizes: list[int] = []
    for each in sockets:
        while True:
            try:
                sizes.append(len(each.recv(2000)))
            except BlockingIOError:
                break
    return sizes


def only(candidates: bytes) -> Callable[[bytes], bytes]:
    """Return a change of a description that replaces its candidates."""

    def change(offer: bytes) -> bytes:
        kept = [line for line in offer.splitlines(keepends=True) if not line.startswith(b"a=candidate")]
        return b"".join(kept) + candidates

    return change


@attack
async def reflection(side: Side, damage: Damage) -> None:
    """Offers whose candidates are 60 addresses of others; `sent` is what exceeds the limits."""
    async with strangers(60) as (sockets, candidates):
        began = time.monotonic()
        status, _ = await offered(side, only(candidates))
        assert status == 201
        await asyncio.sleep(4)
        first = len(datagrams(sockets))
        while first <= 30 and time.monotonic() < began + BUSY_SECONDS:
            await asyncio.sleep(0.2)
            first += len(datagrams(sockets))
        for _ in range(6):
            status, _ = await offered(side, only(candidates))
        await asyncio.sleep(4)
        passed = time.monotonic() - began
        damage.sent = max(0, first - CHECKS)
        damage.sent += max(0, int(first + len(datagrams(sockets)) - CHECKS - CHECKS_PER_SECOND * passed))
        assert first > 30, "an ordinary peer needs so many"


@attack
async def reflection_of_bytes(side: Side, damage: Damage) -> None:
    """An offer whose checks are as large as possible; `sent` is what exceeds three times its bytes."""
    async with strangers(60) as (sockets, candidates):
        sizes: list[int] = []

        def change(offer: bytes) -> bytes:
            changed = re.sub(rb"a=ice-ufrag:\w+", b"a=ice-ufrag:" + b"u" * 256, only(candidates)(offer))
            sizes.append(len(changed))
            return changed

        status, _ = await offered(side, change)
        assert status == 201
        await asyncio.sleep(6)
        received = sum(datagrams(sockets))
        damage.sent = max(0, received - SENT_PER_RECEIVED * sizes[0])
        assert received > sizes[0]


@attack
async def requests_from_elsewhere(side: Side, damage: Damage) -> None:
    """Requests with credentials from an address that never answers; `sent` is what exceeds three times their
    bytes.
    """
    async with strangers(1) as ((stranger,), _), other_side() as other:
        other.connection.createDataChannel("never")
        offer = await other.offer()
        answer = await side.ask("POST", "/webrtc", only(b"")(offer))
        theirs = text_of(answer)
        names = [re.search(r"a=ice-ufrag:(\S+)", each) for each in (theirs, offer.decode())]
        password = re.search(r"a=ice-pwd:(\S+)", theirs)
        assert names[0] is not None and names[1] is not None and password is not None
        sent = 0
        for number in range(100):
            request = stun.Message(stun.Method.BINDING, stun.Class.REQUEST)
            request.attributes = {"USERNAME": f"{names[0][1]}:{names[1][1]}", "PRIORITY": number}
            request.attributes["ICE-CONTROLLING"] = 1
            request.add_message_integrity(password[1].encode())
            sent += stranger.sendto(bytes(request), ("127.0.0.1", ports_of(theirs)[0]))
            await asyncio.sleep(0.01)
        await asyncio.sleep(3)
        received = datagrams([stranger])
        damage.sent = max(0, sum(received) - SENT_PER_RECEIVED * sent, len(received) - 3 * 100)
        assert received


@attack
async def bad_offers(side: Side, damage: Damage) -> None:
    """Offers that aiortc would accept, and fail with later."""
    changes: list[tuple[bytes, bytes]] = [
        (rb"a=fingerprint:[^\r]*\r\n", b""),
        (rb"a=fingerprint:sha-", b"a=fingerprint:md"),
        (rb"a=sctp-port:\d+", b"a=sctp-port:99999"),
        (rb"a=sctp-port:\d+", b"a=sctp-port:0"),
        (rb"a=setup:\w+\r\n", b""),
        (rb"a=ice-pwd:[^\r]*\r\n", b""),
        (rb"\d+ typ", b"99999 typ"),
        (rb"a=mid:\w+", b"a=mid:" + b"x" * 300),
    ]
    for pattern, replacement in changes:

        def change(offer: bytes, pattern: bytes = pattern, replacement: bytes = replacement) -> bytes:
            return re.sub(pattern, replacement, offer)

        status, text = await offered(side, change)
        assert status == 400, (pattern, text)
        await asyncio.sleep(0.05)
