"""Cameras of clients as topics, with plain aiortc as the camera's side."""

from __future__ import annotations

import asyncio
import io
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription, VideoStreamTrack
from av import VideoFrame
from PIL import Image

from rwt import Server
from rwt.settings.webrtc import WebRtcSettings
from rwt_access.settings import AuthSettings, RoleSettings, TokenSettings
from tests.webrtc.peers import until
from tests.webrtc.test_whep import _post

pytestmark = pytest.mark.anyio

WIDTH, HEIGHT = 64, 48
TOPIC = "/operator/camera"


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


class Picture(VideoStreamTrack):
    """A camera that sees one colour."""

    def __init__(self) -> None:
        super().__init__()
        self.colour = (200, 30, 30)

    async def recv(self) -> VideoFrame:
        pixels = np.full((HEIGHT, WIDTH, 3), self.colour, np.uint8)
        frame = VideoFrame.from_ndarray(pixels, "rgb24")
        frame.pts, frame.time_base = await self.next_timestamp()
        return frame


class Sender:
    """A camera's side of plain aiortc."""

    def __init__(self) -> None:
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.picture = Picture()
        self.connection.addTrack(self.picture)

    async def offer(self, url: str) -> tuple[int, str]:
        await self.connection.setLocalDescription()
        return await asyncio.to_thread(_post, url, self.connection.localDescription.sdp)

    async def send(self, url: str) -> None:
        status, text = await self.offer(url)
        assert status == 201, text
        await self.connection.setRemoteDescription(RTCSessionDescription(text, "answer"))


@asynccontextmanager
async def sender() -> AsyncIterator[Sender]:
    made = Sender()
    try:
        yield made
    finally:
        await made.connection.close()


def _server(**settings: Any) -> Server:
    return Server("ws://127.0.0.1:0", webrtc=WebRtcSettings(enabled=True), **settings)


def _url(server: Server, query: str) -> str:
    return f"{server.urls[0].replace('ws', 'http', 1)}/whip?{query}"


def _colour(message: Any) -> tuple[int, int, int]:
    with Image.open(io.BytesIO(bytes(message.data))) as image:
        assert image.size == (WIDTH, HEIGHT)
        red, green, blue = np.median(np.asarray(image.convert("RGB")), axis=(0, 1))
    return int(red), int(green), int(blue)


async def test_a_camera_becomes_a_topic_until_it_ends() -> None:
    async with _server() as server, sender() as camera:
        got: list[Any] = []
        server.node("robot").subscribe(TOPIC, got.append, "sensor_msgs/CompressedImage")
        await camera.send(_url(server, f"topic={TOPIC}&frame_id=head&quality=95"))
        await until(lambda: got and abs(_colour(got[-1])[0] - 200) < 20)
        camera.picture.colour = (30, 30, 200)
        await until(lambda: abs(_colour(got[-1])[2] - 200) < 20)
        assert (got[-1].format, got[-1].header.frame_id) == ("jpeg", "head")
        assert got[-1].header.stamp.sec > 0
        await camera.connection.close()
        await until(lambda: _value(server, "rwt_webrtc_peers") == 0)


def _value(server: Server, name: str) -> float:
    page = server._while_running.metrics.text().decode().splitlines()
    return sum(float(line.rpartition(" ")[2]) for line in page if line.startswith(name))


async def test_a_role_publishes_where_it_may() -> None:
    roles = {"guest": RoleSettings(publish=("/chatter",))}
    async with _server(auth=AuthSettings(default_role="guest"), roles=roles) as server, sender() as camera:
        status, text = await camera.offer(_url(server, f"topic={TOPIC}"))
        assert status == 403
        assert "roles.guest.publish" in text


@pytest.mark.parametrize(
    ("query", "status", "why"),
    [
        ("", 400, "`topic` is missing"),
        ("topic=/a&quality=0", 400, "`quality` must be a whole number from 1 to 100"),
        ("topic=/a%20b", 400, "/a b"),
        ("topic=/rosout", 409, "rcl_interfaces"),
    ],
)
async def test_refusals(query: str, status: int, why: str) -> None:
    async with _server() as server, sender() as camera:
        assert (await camera.offer(_url(server, query)))[0] == status
        assert why in (await camera.offer(_url(server, query)))[1]


async def test_a_camera_whose_role_may_not_any_more_is_ended() -> None:
    tokens = {"operator": TokenSettings(token="operator-operator", role="operator")}
    may = {"operator": RoleSettings(publish=("/operator/*",))}
    may_not = {"operator": RoleSettings(publish=("/chatter",))}
    async with (
        Server(
            "ws://127.0.0.1:0",
            webrtc=WebRtcSettings(enabled=True),
            auth=AuthSettings(tokens=tokens),
            roles=may,
        ) as server,
        sender() as camera,
    ):
        got: list[Any] = []
        server.node("robot").subscribe(TOPIC, got.append, "sensor_msgs/CompressedImage")
        await camera.send(_url(server, f"topic={TOPIC}&token=operator-operator"))
        await until(lambda: got)
        server.settings = server.settings.model_copy(update={"roles": may_not})
        server.reload()
        await until(lambda: camera.connection.connectionState in ("closed", "failed"))
