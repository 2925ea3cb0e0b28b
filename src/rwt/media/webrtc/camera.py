"""The camera of a client as `sensor_msgs/CompressedImage` (JPEG) on a topic.

An image is made a message only when the one before is: what comes meanwhile is left out.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import anyio.to_thread
import numpy as np
from aiortc.mediastreams import MediaStreamError
from av import VideoFrame

from rwt.access.errors import AccessError
from rwt.media.encoders.jpeg import encode_jpeg
from rwt.media.stream_request import MOST_AREA
from rwt_interfaces.payload import Payload
from rwt_transports.errors import log_exception

if TYPE_CHECKING:
    from aiortc import MediaStreamTrack

    from rwt.access.client_graph import ClientGraph, ClientPublisher

TYPE: Final = "sensor_msgs/CompressedImage"
QUALITY: Final = 85
"""Of the JPEG images, 1 to 100, where none is asked for."""

logger = logging.getLogger("rwt.media.webrtc")


@dataclass(frozen=True, slots=True)
class CameraRequest:
    """How a client's images are published.

    Attributes:
        topic: where.
        frame_id: the frame of reference that they name.
        quality: of the JPEG images, 1 to 100.
    """

    topic: str
    frame_id: str = ""
    quality: int = QUALITY


class Camera:
    """Publishes the images of one track.

    Args:
        client: the graph as the client may act on it.
        wanted: what was asked for.
        end: called with the reason when there will be no more images.

    Raises:
        AccessError: the client may not publish on the topic.
        RobotError: the topic has another type.
    """

    def __init__(self, client: ClientGraph, wanted: CameraRequest, end: Callable[[str], None]) -> None:
        self._client = client
        self._wanted = wanted
        self._end = end
        self._publisher: ClientPublisher = client.publisher(wanted.topic, TYPE)
        self._newest: VideoFrame | None = None
        self._woken = asyncio.Event()

    @property
    def topic(self) -> str:
        """Where it publishes, absolute."""
        return self._publisher.topic

    def renew(self) -> None:
        """Publish as the client's role allows from now on. Raises AccessError where it may not."""
        self._publisher = self._client.publisher(self._wanted.topic, TYPE)

    async def take(self, track: MediaStreamTrack) -> None:
        """Take every image as it comes; a later one replaces one that is not published yet."""
        try:
            while True:
                frame = await track.recv()
                if not isinstance(frame, VideoFrame):
                    continue
                if frame.width * frame.height > MOST_AREA:
                    self._end(f"pictures of {frame.width} x {frame.height}; the most is {MOST_AREA} pixels")
                    return
                self._newest = frame
                self._woken.set()
        except MediaStreamError:
            self._end("the camera has ended")

    async def publish(self) -> None:
        """Publish what has been taken, until cancelled."""
        clock = self._client.clock
        while True:
            await self._woken.wait()
            self._woken.clear()
            frame, self._newest = self._newest, None
            if frame is None:
                continue
            stamp = clock.time_ns()
            try:
                data, seconds = await anyio.to_thread.run_sync(_encode, frame, self._wanted.quality)
                self._client.work.add(seconds, "pictures")
                header = {
                    "stamp": self._client.distro.time(stamp),
                    "frame_id": self._wanted.frame_id,
                }
                message = {"header": header, "format": "jpeg", "data": data}
                self._publisher.publish(Payload.from_value(self._publisher.type, message))
            except AccessError as refused:
                logger.debug("a picture for %s was refused: %s", self._wanted.topic, refused)
            except Exception:
                log_exception("a camera's pictures could not be published on %s", self._wanted.topic)
                self._end("internal error")
                return


def _encode(frame: VideoFrame, quality: int) -> tuple[bytes, float]:
    """An image as JPEG, and the processor's seconds that it took."""
    began = time.thread_time()
    pixels = np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)
    data = encode_jpeg(pixels, quality)
    return data, time.thread_time() - began
