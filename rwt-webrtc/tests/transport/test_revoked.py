"""Ends of connections that reloaded settings no longer allow: viewers by WebRTC, peers
with data channels, and streams over HTTP beside them. What they still allow goes on."""

from __future__ import annotations

import asyncio

import httpx
import pytest
from aiortc import RTCPeerConnection

from rwt import Settings
from rwt.access.access import Access
from rwt_graph import MemoryGraph
from rwt_transports.endpoint import PeerInfo
from rwt_transports.errors import Refused
from tests.waiting import until
from tests.webrtc.peers import other_side
from tests.webrtc.watching import TOPIC, camera, post, watchers

pytestmark = pytest.mark.anyio

TOKEN = "0123456789abcdef"


def settings(token: str = TOKEN, *subscribe: str) -> Settings:
    """Two may come in: one always as it is, and one whose token and role are given."""
    return Settings.model_validate(
        {
            "auth": {
                "tokens": {
                    "one": {"token": token, "role": "viewer"},
                    "other": {"token": "the-other-one-there", "role": "admin"},
                }
            },
            "roles": {"viewer": {"subscribe": subscribe or ["/camera/*"]}},
            "webrtc": {"enabled": True},
        }
    )


REVOKED = [
    pytest.param(settings("fedcba9876543210"), id="token"),
    pytest.param(settings(TOKEN, "/camera/depth/*"), id="role"),
]


def _gone(connection: RTCPeerConnection) -> bool:
    return connection.connectionState in ("closed", "failed")


@pytest.mark.parametrize("then", REVOKED)
async def test_a_viewer_ends_and_no_other(then: Settings) -> None:
    async with camera(settings=settings()) as (source, url), watchers(2) as (one, other):
        await one.connect(f"{url}/whep?topic={TOPIC}&token={TOKEN}")
        await other.connect(f"{url}/whep?topic={TOPIC}&token=the-other-one-there")
        await until(lambda: one.frames and other.frames)
        source.server.settings = then
        source.server.reload()
        await until(lambda: _gone(one.connection))
        seen = len(other.frames)
        await until(lambda: len(other.frames) > seen + 5)


async def test_what_is_still_allowed_goes_on() -> None:
    async with camera(settings=settings()) as (source, url), watchers() as (watcher,):
        await watcher.connect(f"{url}/whep?topic={TOPIC}&token={TOKEN}")
        await until(lambda: watcher.frames)
        source.server.settings = settings(TOKEN, TOPIC)
        source.server.reload()
        seen = len(watcher.frames)
        await until(lambda: len(watcher.frames) > seen + 5)


async def test_a_peer_whose_token_is_gone_ends_with_all_its_channels() -> None:
    async with camera(settings=settings()) as (source, url), other_side() as other:
        channel = other.connection.createDataChannel("robot")
        target = f"{url}/webrtc?token={TOKEN}"
        status, answer = await post(target, (await other.offer()).decode())
        assert status == 201, answer
        await other.take_answer(answer)
        await until(lambda: channel.readyState == "open")
        source.server.settings = settings("fedcba9876543210")
        source.server.reload()
        await until(lambda: channel.readyState == "closed")
        await until(lambda: _gone(other.connection))


@pytest.mark.parametrize("then", REVOKED)
@pytest.mark.parametrize("type", ["mjpeg", "vp8"])
async def test_a_stream_ends(type: str, then: Settings) -> None:
    async with (
        camera(settings=settings()) as (source, url),
        httpx.AsyncClient(timeout=60) as client,
        client.stream("GET", f"{url}/stream?topic={TOPIC}&type={type}&token={TOKEN}") as stream,
    ):
        parts = stream.aiter_raw()
        assert await anext(parts)
        source.server.settings = then
        source.server.reload()
        async with asyncio.timeout(20):
            async for _ in parts:
                pass


def test_an_answer_that_is_refused_before_it_begins_does_not_begin() -> None:
    """The settings may be read between a request and its answer."""
    access = Access(MemoryGraph(), settings())
    reader = access.reader(PeerInfo("http", "10.0.0.1", 0, f"/whep?token={TOKEN}", {}))
    ended: list[str] = []
    reader.while_allowed([TOPIC], ended.append)
    access.reload(settings(TOKEN, "/odom"))
    assert len(ended) == 1 and f"may not subscribe to {TOPIC}" in ended[0]
    with pytest.raises(Refused, match="may not subscribe"):
        reader.while_allowed([TOPIC], ended.append)
    access.reload(settings("fedcba9876543210"))
    with pytest.raises(Refused, match="not known"):
        reader.while_allowed([], ended.append)
    assert len(ended) == 1
