"""Camera of LeRobot that is an image topic on a rosbridge server."""

from __future__ import annotations

import time
from typing import Any

from lerobot.cameras import Camera
from numpy.typing import NDArray

from rwt_lerobot.plugin.config import RosbridgeCameraConfig
from rwt_lerobot.plugin.connection import Device, DeviceError, Latest, StaleData
from rwt_participant.images import image_to_numpy

_WARM_UP_SECONDS = 5.0


class RosbridgeCamera(Device, Camera):
    """Camera on a rosbridge server; images are RGB.

    Attributes:
        max_age_ms: milliseconds after which an image is too old.
    """

    config_class = RosbridgeCameraConfig
    noun = "camera"

    def __init__(self, config: RosbridgeCameraConfig) -> None:
        super().__init__(config)
        self.config = config
        self.max_age_ms = config.max_age * 1000
        self._images = Latest(config.topic)
        self._read_count = 0
        self._decoded: tuple[int, NDArray[Any]] | None = None

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """Return an empty list: cameras are named by their topic."""
        return []

    def connect(self, warmup: bool = True) -> None:
        """Connect to the server, and wait for the first image if `warmup` is true.

        Raises:
            DeviceError: the server cannot be reached, or no image arrives.
        """
        connection = self._connect(self.config)
        self._images = connection.latest(self.config.topic, self.config.kind)
        self._read_count = 0
        if warmup and not self._images.wait(0, _WARM_UP_SECONDS):
            connection.close()
            raise DeviceError(f"no image on {self.config.topic} of {self.config.url}")
        self._connection = connection

    def read(self) -> NDArray[Any]:
        """Wait for the next image, and return it."""
        self._check()
        return self._next(self._images.count, self.config.max_age)

    def async_read(self, timeout_ms: float = 200) -> NDArray[Any]:
        """Return the newest image that was not returned before; waits for it.

        Raises:
            TimeoutError: none has arrived in time.
        """
        self._check()
        return self._next(self._read_count, timeout_ms / 1000)

    def read_latest(self, max_age_ms: int = 500) -> NDArray[Any]:
        """Return the newest image at once.

        Raises:
            TimeoutError: it is older than `max_age_ms`.
        """
        self._check()
        try:
            return self._decode(self._images.get(max_age_ms / 1000))
        except StaleData as error:
            raise TimeoutError(str(error)) from error

    def _check(self) -> None:
        self._connected().check()

    def _next(self, count: int, seconds: float) -> NDArray[Any]:
        end = time.monotonic() + seconds
        if not self._images.wait(count, seconds):
            self._check()
            raise TimeoutError(f"no new image on {self.config.topic} within {seconds:g} s")
        return self._decode(self._images.get(max(0.0, end - time.monotonic()) + self.config.max_age))

    def _decode(self, message: Any) -> NDArray[Any]:
        count = self._images.count
        if self._decoded is None or self._decoded[0] != count:
            self._decoded = count, self._rgb(message)
        self._read_count = count
        return self._decoded[1]

    def _rgb(self, message: Any) -> NDArray[Any]:
        pixels: NDArray[Any] = image_to_numpy(message)
        if getattr(message, "encoding", "") == "bgr8":
            pixels = pixels[:, :, ::-1]
        expected = (self.height, self.width, 3)
        if self.height is None or self.width is None:
            self.height, self.width = pixels.shape[:2]
        elif pixels.shape != expected:
            raise DeviceError(f"{self.config.topic}: an image of {pixels.shape}, expected {expected}")
        return pixels
