"""A robot with a camera, and viewers of plain aiortc."""

from __future__ import annotations

import asyncio
import re
import urllib.error
import urllib.request
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError
from av import VideoFrame

from rwt import Server
from rwt_graph import Node
from rwt_webrtc.settings import WebRtcSettings

WIDTH, HEIGHT = 64, 48
TOPIC = "/camera/image_raw"


class Camera:
    """A topic whose pictures are of one colour, as fast as it is asked for."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.advertise(TOPIC, "sensor_msgs/Image")
        self.colour = (200, 30, 30)

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
        found = Camera(server.node("camera"))
        running = asyncio.create_task(found.run())
        try:
            yield found, server.urls[0].replace("ws", "http", 1)
        finally:
            running.cancel()


class Watcher:
    """A viewer of plain aiortc."""

    def __init__(self) -> None:
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.connection.addTransceiver("video", "recvonly")
        self.connection.on("track", self._track)
        self.frames: list[VideoFrame] = []
        self.ended = False
        self._watching: asyncio.Task[None] | None = None

    def _track(self, track: MediaStreamTrack) -> None:
        self._watching = asyncio.create_task(self._watch(track))

    async def _watch(self, track: MediaStreamTrack) -> None:
        try:
            while True:
                frame = await track.recv()
                assert isinstance(frame, VideoFrame)
                self.frames.append(frame)
        except MediaStreamError:
            self.ended = True

    async def offer(self, url: str) -> tuple[int, str]:
        """Ask for a video; the status and the text of the answer."""
        await self.connection.setLocalDescription()
        return await asyncio.to_thread(post, url, self.connection.localDescription.sdp)

    async def watch(self, url: str) -> None:
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


def post(url: str, offer: str) -> tuple[int, str]:
    request = urllib.request.Request(url, offer.encode(), {"Content-Type": "application/sdp"})
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


@asynccontextmanager
async def watchers(count: int = 1) -> AsyncIterator[list[Watcher]]:
    made = [Watcher() for _ in range(count)]
    try:
        yield made
    finally:
        await asyncio.gather(*(each.connection.close() for each in made))


def near(one: tuple[int, int, int], other: tuple[int, int, int]) -> bool:
    return all(abs(a - b) < 20 for a, b in zip(one, other, strict=True))
