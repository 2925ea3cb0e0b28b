"""Peers over WebRTC that take what they can: descriptions, candidates, handshakes, channels without end."""

from __future__ import annotations

import asyncio
import urllib.error
import urllib.request
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio
import pytest

from rwt import Server
from rwt_client import connect
from rwt_webrtc.settings import WebRtcSettings
from rwt_webrtc.transport.signalling import PeerBounds
from tests.waiting import until
from tests.webrtc.peers import OtherSide, other_side

pytestmark = pytest.mark.anyio

CHANNELS, HANDSHAKES = 4, 3


@asynccontextmanager
async def attacked(connect_seconds: float = 20.0) -> AsyncIterator[tuple[Server, str]]:
    """A server, which answers an ordinary client afterwards as before; and where its offers are taken."""
    settings = WebRtcSettings(
        enabled=True, channels=CHANNELS, handshakes=HANDSHAKES, connect_seconds=connect_seconds
    )
    async with Server("ws://127.0.0.1:0", webrtc=settings) as server:
        server.node("robot").advertise_service(
            "/beep", "std_srvs/Trigger", lambda request: {"success": True, "message": "here"}
        )
        async with connect(server.urls[0]) as ordinary:
            yield server, server.urls[0].replace("ws", "http", 1) + "/webrtc"
            assert (await ordinary.call("/beep")).message == "here"


async def _ask(url: str, body: bytes, method: str = "POST", kind: str = "sdp") -> tuple[int, str, str]:
    """Status, text, and where a peer was made."""

    def ask() -> tuple[int, str, str]:
        headers = {"Content-Type": f"application/{kind}"}
        request = urllib.request.Request(url, body, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return answer.status, answer.read().decode(), answer.headers.get("Location", "")
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.read().decode(), ""

    return await asyncio.to_thread(ask)


def _clients(server: Server) -> int:
    return server.bridge.client_count


async def _offer(other: OtherSide) -> bytes:
    other.connection.createDataChannel("x")
    return await other.offer()


async def test_a_description_of_a_megabyte() -> None:
    async with attacked() as (_, url), other_side() as other:
        offer = await _offer(other)
        status, text, _ = await _ask(url, offer + b"a=x:y\r\n" * 150_000)
        assert status in (400, 413), text


@pytest.mark.parametrize(
    ("line", "count", "why"),
    [
        (b"a=candidate:1 1 udp 1 127.0.0.1 9 typ host\r\n", 1000, "webrtc.candidates"),
        (b"m=application 9 UDP/DTLS/SCTP webrtc-datachannel\r\n", 1000, "sections"),
        (b"a=ssrc:1 cname:x\r\n", 300, "300 lines of 'a=ssrc'; the limit is 256"),
        (b"a=rtcp-fb:* nack\r\n", 17, "17 lines of 'a=rtcp-fb:*'; the limit is 16"),
        (b"a=" + b"x" * 5000 + b"\r\n", 1, "a line of 5002 characters"),
    ],
    ids=["candidates", "sections", "sources", "feedback for all codecs", "a long line"],
)
async def test_a_description_with_too_much(line: bytes, count: int, why: str) -> None:
    async with attacked() as (_, url), other_side() as other:
        status, text, _ = await _ask(url, await _offer(other) + line * count)
        assert (status, why in text) == (400, True), text


async def test_candidates_without_end() -> None:
    async with attacked() as (_, url), other_side() as other:
        status, text, location = await _ask(url, await _offer(other))
        assert status == 201, text
        more = b"a=mid:0\r\n" + b"a=candidate:1 1 udp 1 127.0.0.1 9 typ host\r\n" * 60
        peer, kind = url.removesuffix("/webrtc") + location, "trickle-ice-sdpfrag"
        answers = [(await _ask(peer, more, "PATCH", kind))[0] for _ in range(4)]
        assert answers[-2:] == [400, 400]


async def test_handshakes_that_stall_take_their_places_for_a_while_only() -> None:
    seconds = PeerBounds().queue_seconds + 3  # Longer than an offer waits for a place.
    async with attacked(connect_seconds=seconds) as (server, url), other_side() as other:
        offer = await _offer(other)
        async with anyio.create_task_group() as group:
            answers: list[int] = []

            async def ask() -> None:
                answers.append((await _ask(url, offer))[0])

            for _ in range(HANDSHAKES + 2):
                group.start_soon(ask)
        assert sorted(answers) == [201] * HANDSHAKES + [503] * 2
        address = server.urls[0].replace("ws", "webrtc+http", 1)
        for _ in range(40):  # Until they are given up.
            try:
                async with connect(address, reconnect=None) as robot:
                    assert (await robot.call("/beep")).message == "here"
                    return
            except OSError:
                await asyncio.sleep(0.25)
        pytest.fail("the places are never free again")


async def test_channels_by_the_thousand() -> None:
    async with attacked() as (server, url), other_side() as other:
        first = other.connection.createDataChannel("first")
        status, answer, _ = await _ask(url, await other.offer())
        assert status == 201, answer
        await other.take_answer(answer)
        await until(lambda: first.readyState == "open")
        before = _clients(server)
        many = [other.connection.createDataChannel(f"{number}") for number in range(1000)]
        # Closing each takes a packet there and one back.
        await until(lambda: sum(each.readyState == "closed" for each in many) >= 100)
        assert _clients(server) <= before + CHANNELS - 1
        await other.connection.close()
        await until(lambda: _clients(server) == before - 1)
