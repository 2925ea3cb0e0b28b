"""Optics of a pinhole camera, and their description in ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from rwt.extensions.demo.messages import Message
from rwt_interfaces.distro import Distro


@dataclass(frozen=True, slots=True)
class Lens:
    """Pinhole camera without distortion.

    Attributes:
        field_of_view: horizontal field of view, radians.
    """

    width: int = 640
    height: int = 480
    field_of_view: float = math.radians(75)

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return self.width / 2 / math.tan(self.field_of_view / 2)

    @property
    def cx(self) -> float:
        """Column of the optical axis, counted from the centre of the first pixel."""
        return (self.width - 1) / 2

    @property
    def cy(self) -> float:
        """Row of the optical axis."""
        return (self.height - 1) / 2

    def camera_info(self, header: Message, distro: Distro) -> Message:
        """Return `sensor_msgs/CameraInfo` with the distribution's names of matrices."""
        f, cx, cy = self.focal, self.cx, self.cy
        matrices = (
            [0.0] * 5,
            [f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0],
            [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            [f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        )
        return {
            "header": header,
            "width": self.width,
            "height": self.height,
            "distortion_model": "plumb_bob",
            **dict(zip(MATRICES[distro.conventions], matrices, strict=True)),
        }


MATRICES: Final = {"jazzy": ("d", "k", "r", "p"), "noetic": ("D", "K", "R", "P")}
"""Matrices of `sensor_msgs/CameraInfo` by distribution: distortion, camera, rectification, projection."""

DEFAULT_LENS: Final = Lens()
"""640x480, 75 degrees wide."""
