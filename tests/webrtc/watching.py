"""A robot with a camera, and clients of plain aiortc that watch, listen and send."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import httpx
import numpy as np
from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError
from av import AudioFrame, VideoFrame
from numpy.typing import NDArray

from rwt import Server
from rwt_webrtc.settings import WebRtcSettings

WIDTH, HEIGHT = 64, 48
TOPIC = "/camera/image_raw"


class Camera:
    """A topic whose pictures are of one colour, as fast as it is asked for."""

    def __init__(self, server: Server) -> None:
        self.server = server
        self.colour = (200, 30, 30)
        self._publisher = server.node("camera").advertise(TOPIC, "sensor_msgs/Image")

    async def run(self) -> None:
        while True:
            data = bytes(self.colour) * (WIDTH * HEIGHT)
            self._publisher.publish(
                {"height": HEIGHT, "width": WIDTH, "encoding": "rgb8", "step": WIDTH * 3, "data": data}
            )
            await asyncio.sleep(0.02)


@asynccontextmanager
async def camera(**settings: Any) -> AsyncIterator[tuple[Camera, str]]:
    """A server with a camera, and where it takes requests."""
    peers = WebRtcSettings(enabled=True)
    async with Server("ws://127.0.0.1:0", webrtc=peers, **settings) as server:
        found = Camera(server)
        running = asyncio.create_task(found.run())
        try:
            yield found, server.urls[0].replace("ws", "http", 1)
        finally:
            running.cancel()


class MediaPeer:
    """A client of plain aiortc, which sends tracks and keeps what it receives.

    Attributes:
        frames: images.
        heard: samples of one of two channels, by packet.
        ended: True if a track has ended.
    """

    def __init__(self, *sends: MediaStreamTrack, receives: Sequence[str] = ()) -> None:
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        for track in sends:
            self.connection.addTrack(track)
        for kind in receives:
            self.connection.addTransceiver(kind, "recvonly")
        self.connection.on("track", self._track)
        self.frames: list[VideoFrame] = []
        self.heard: list[NDArray[np.int16]] = []
        self.ended = False
        self._receiving: list[asyncio.Task[None]] = []

    def _track(self, track: MediaStreamTrack) -> None:
        self._receiving.append(asyncio.create_task(self._receive(track)))

    async def _receive(self, track: MediaStreamTrack) -> None:
        try:
            while True:
                frame = await track.recv()
                if isinstance(frame, VideoFrame):
                    self.frames.append(frame)
                else:
                    assert isinstance(frame, AudioFrame)
                    assert (frame.sample_rate, frame.layout.name) == (48_000, "stereo")
                    self.heard.append(frame.to_ndarray()[0][::2])
        except MediaStreamError:
            self.ended = True

    async def offer(self, url: str) -> tuple[int, str]:
        """Send an offer; the status and the text of the answer."""
        await self.connection.setLocalDescription()
        return await post(url, self.connection.localDescription.sdp)

    async def connect(self, url: str) -> None:
        status, text = await self.offer(url)
        assert status == 201, text
        await self.connection.setRemoteDescription(RTCSessionDescription(text, "answer"))

    def source(self) -> int:
        """SSRC of the video, as the answer says: aiortc's statistics may be about the retransmissions."""
        found = re.search(r"^a=ssrc:(\d+)", self.connection.remoteDescription.sdp, re.MULTILINE)
        assert found is not None
        return int(found[1])

    def colour(self) -> tuple[int, int, int]:
        """Of the last picture."""
        red, green, blue = np.median(self.frames[-1].to_ndarray(format="rgb24"), axis=(0, 1))
        return int(red), int(green), int(blue)


@asynccontextmanager
async def media_peer(*sends: MediaStreamTrack, receives: Sequence[str] = ()) -> AsyncIterator[MediaPeer]:
    """A peer that sends these tracks, and receives tracks of these kinds."""
    made = MediaPeer(*sends, receives=receives)
    try:
        yield made
    finally:
        await made.connection.close()


async def post(url: str, offer: str) -> tuple[int, str]:
    async with httpx.AsyncClient(timeout=60) as client:
        answer = await client.post(url, content=offer, headers={"Content-Type": "application/sdp"})
    return answer.status_code, answer.text


@asynccontextmanager
async def watchers(count: int = 1) -> AsyncIterator[list[MediaPeer]]:
    async with AsyncExitStack() as stack:
        yield [await stack.enter_async_context(media_peer(receives=["video"])) for _ in range(count)]


def metric(server: Server, name: str) -> float:
    """The sum over all labels."""
    page = server.metrics.text().decode().splitlines()
    return sum(float(line.rpartition(" ")[2]) for line in page if line.startswith(name))


def near(one: tuple[int, int, int], other: tuple[int, int, int]) -> bool:
    return all(abs(a - b) < 20 for a, b in zip(one, other, strict=True))
