"""Camera of a client, published as `sensor_msgs/CompressedImage` (JPEG).

Frames that arrive while another is encoded are dropped, except for the newest.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import anyio.to_thread
import numpy as np
from aiortc import MediaStreamTrack
from aiortc.mediastreams import MediaStreamError
from av import VideoFrame

from rwt.access.client_graph import ClientGraph, ClientPublisher
from rwt.access.errors import AccessError
from rwt.media.encoders.jpeg import encode_jpeg
from rwt.media.stream_request import MOST_AREA
from rwt_interfaces.payload import Payload
from rwt_transports.errors import log_exception

TYPE: Final = "sensor_msgs/CompressedImage"
#: Default JPEG quality, 1 to 100.
QUALITY: Final = 85

logger = logging.getLogger("rwt_webrtc.media")


@dataclass(frozen=True, slots=True)
class CameraRequest:
    """Request to publish a client's camera.

    Attributes:
        frame_id: frame of reference of the images.
        quality: JPEG quality, 1 to 100.
    """

    topic: str
    frame_id: str = ""
    quality: int = QUALITY


class Camera:
    """Publisher of the images of one track.

    Args:
        end: called with the reason when the camera has ended.

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
        """Absolute name of the topic."""
        return self._publisher.topic

    def renew(self) -> None:
        """Request the publisher again, after a change of role. Raises AccessError if it may not publish."""
        self._publisher = self._client.publisher(self._wanted.topic, TYPE)

    async def take(self, track: MediaStreamTrack) -> None:
        """Receive the frames of a track; a frame replaces one that is not encoded yet."""
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
        """Publish received frames until cancelled."""
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
    began = time.thread_time()
    pixels = np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)
    data = encode_jpeg(pixels, quality)
    return data, time.thread_time() - began
