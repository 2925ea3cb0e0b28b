"""Attacks by SCTP, RTP and RTCP packets, which only a connected peer can send."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Iterator
from contextlib import suppress
from struct import pack

import pylibsrtp
from aiortc import RTCDtlsTransport

from tests.faults.peers.attacks import Damage, attack, attacker, attacking_server, chunk, send
from tests.webrtc.peers import Side


@attack
async def heartbeat_without_length(side: Side, damage: Damage) -> None:
    """A HEARTBEAT whose parameter has length 0."""
    async with attacker(side) as (_, sctp):
        await send(sctp, chunk(4, bytes(4)), tag=1)
        await send(sctp, chunk(4, bytes(4)))
        await asyncio.sleep(0.2)


@attack
async def parameters_without_length(side: Side, damage: Damage) -> None:
    """The same in each other chunk with parameters."""
    for kind, body in ((5, b""), (6, b""), (9, b""), (130, b""), (1, bytes(16)), (2, bytes(16))):
        async with attacker(side) as (_, sctp):
            await send(sctp, chunk(kind, body + bytes(4)), tag=0 if kind == 1 else None)
            await asyncio.sleep(0.05)


@attack
async def gap_blocks(side: Side, damage: Damage) -> None:
    """SACKs with hundreds of gap blocks from 0 to 65535."""
    async with attacker(side) as (_, sctp):
        for _ in range(4):
            body = pack("!LLHH", (sctp._last_received_tsn or 0), 1 << 20, 280, 0)
            await send(sctp, chunk(3, body + pack("!HH", 0, 65535) * 280))
            await asyncio.sleep(0.05)


@attack
async def misordered_fragments(side: Side, damage: Damage) -> None:
    """Packets of the smallest fragments, each after a gap."""
    async with attacker(side) as (_, sctp):
        tsn = sctp._local_tsn
        for turn in range(60):
            made = [
                chunk(0, pack("!LHHL", (tsn + 2 + 2 * (40 * turn + each)) % 2**32, 1, 0, 53) + b"x")
                for each in range(40)
            ]
            await send(sctp, *made)
            await asyncio.sleep(0.002)
        for _ in range(20):
            made = [chunk(0, pack("!LHHL", tsn - 1, 1, 0, 53) + b"x")] * 55
            await send(sctp, *made)
            await asyncio.sleep(0.002)


@attack
async def messages_without_end(side: Side, damage: Damage) -> None:
    """First fragments only, then FORWARD TSN chunks; as many as may be, and more."""
    for turns in (80, 600):
        async with attacker(side) as (_, sctp):
            with suppress(ConnectionError):  # More end the peer.
                tsn = sctp._local_tsn
                for turn in range(turns):
                    made = [
                        chunk(0, pack("!LHHL", (tsn + 50 * turn + each) % 2**32, each, 0, 53) + b"x", flags=2)
                        for each in range(50)
                    ]
                    await send(sctp, *made)
                    if not turn % 8:
                        await asyncio.sleep(0.002)
                for turn in range(20):
                    await send(sctp, chunk(192, pack("!LHH", (tsn + 50 * turns - 1 + turn) % 2**32, 1, 0)))
                    await asyncio.sleep(0.002)


@attack
async def random_chunks(side: Side, damage: Damage) -> None:
    """Chunks of random bytes and lengths of every type."""
    generator = random.Random(1)
    for _ in range(6):
        async with attacker(side) as (other, sctp):
            for _ in range(150):
                kind = generator.choice((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 14, 64, 130, 192, 255))
                body = generator.randbytes(generator.choice((0, 1, 3, 4, 8, 12, 16, 20, 40)))
                length = generator.choice((None, None, None, 0, 3, 4, 5, 12, 65535))
                if other.connection.connectionState != "connected":
                    break
                try:
                    await send(sctp, chunk(kind, body, generator.randrange(8), length))
                except ConnectionError:
                    break
                await asyncio.sleep(0)
            await asyncio.sleep(0.02)


def media_packets(generator: random.Random) -> Iterator[bytes]:
    """Yield RTP and RTCP packets with arbitrary lengths, counts and padding, of changing sources."""
    for number in range(600):
        first = generator.choice((0x80, 0x81, 0x8F, 0x90, 0x9F, 0xA0, 0xBF))
        kind = generator.choice((96, 200, 201, 202, 203, 204, 205, 206, 207))
        source = (number % 40).to_bytes(4, "big")
        body = generator.randbytes(generator.choice((0, 4, 16, 20, 24, 100, 1000)))
        words = generator.choice((1 + len(body) // 4, generator.randrange(65536)))
        if kind == 96:
            yield bytes([first, kind]) + generator.randbytes(6) + source + body
        else:
            yield bytes([first, kind]) + words.to_bytes(2, "big") + source + body
    # Reports that request the same packets thousands of times, and a REMB message of 255 sources.
    yield b"\x81\xcd" + (2 + 250).to_bytes(2, "big") + bytes(8) + b"\0\1\xff\xff" * 250
    yield b"\x8f\xce\0\x05" + bytes(8) + b"REMB\xff\0\0\0" + bytes(4)


async def send_media(handshake: RTCDtlsTransport) -> None:
    """Send what `media_packets` yields."""
    for number, packet in enumerate(media_packets(random.Random(1))):
        with suppress(pylibsrtp.Error):  # It does not encrypt all of them.
            await handshake._send_rtp(packet)
        if not number % 20:
            await asyncio.sleep(0.002)
    await asyncio.sleep(0.1)


@attack
async def media_of_arbitrary_lengths(side: Side, damage: Damage) -> None:
    """RTP and RTCP packets of a peer that has no media."""
    async with attacker(side) as (other, sctp):
        await send_media(sctp.transport)
        assert other.connection.connectionState == "connected" and len(side.peers) == 1


@attack
async def client_media_of_arbitrary_lengths(side: Side, damage: Damage) -> None:
    """The same by a server."""
    async with attacking_server() as (client, server, _):
        assert server.sctp is not None
        await send_media(server.sctp.transport)
        assert not client.closed


@attack
async def client_random_chunks(side: Side, damage: Damage) -> None:
    """A server's chunks of random bytes and lengths."""
    generator = random.Random(2)
    for _ in range(4):
        async with attacking_server() as (_, server, _):
            assert server.sctp is not None
            for _ in range(150):
                kind = generator.choice((0, 2, 3, 4, 5, 6, 9, 10, 64, 130, 192, 255))
                body = generator.randbytes(generator.choice((0, 4, 8, 12, 16, 20, 40)))
                length = generator.choice((None, None, 0, 4, 12, 65535))
                with suppress(ConnectionError):
                    await send(server.sctp, chunk(kind, body, generator.randrange(8), length))
                await asyncio.sleep(0)
            await asyncio.sleep(0.02)


@attack
async def client_heartbeat_without_length(side: Side, damage: Damage) -> None:
    """A server's HEARTBEAT whose parameter has length 0."""
    async with attacking_server() as (_, server, _):
        assert server.sctp is not None
        await send(server.sctp, chunk(4, bytes(4)))
        await asyncio.sleep(0.2)


@attack
async def client_gap_blocks(side: Side, damage: Damage) -> None:
    """A server's SACKs with hundreds of gap blocks from 0 to 65535."""
    async with attacking_server() as (_, server, _):
        assert server.sctp is not None
        for _ in range(4):
            body = pack("!LLHH", (server.sctp._last_received_tsn or 0), 1 << 20, 280, 0)
            await send(server.sctp, chunk(3, body + pack("!HH", 0, 65535) * 280))
            await asyncio.sleep(0.05)
