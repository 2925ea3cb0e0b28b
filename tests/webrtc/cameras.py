"""Cameras of clients, and the images that become of them."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from aiortc import VideoStreamTrack
from av import VideoFrame
from PIL import Image

from rwt import Server
from rwt_webrtc.settings import WebRtcSettings

WIDTH, HEIGHT = 64, 48


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


def media_server(**settings: Any) -> Server:
    return Server("ws://127.0.0.1:0", webrtc=WebRtcSettings(enabled=True), **settings)


def whip_url(server: Server, query: str) -> str:
    return f"{server.urls[0].replace('ws', 'http', 1)}/whip?{query}"


def jpeg_colour(message: Any) -> tuple[int, int, int]:
    with Image.open(io.BytesIO(bytes(message.data))) as image:
        assert image.size == (WIDTH, HEIGHT)
        red, green, blue = np.median(np.asarray(image.convert("RGB")), axis=(0, 1))
    return int(red), int(green), int(blue)
