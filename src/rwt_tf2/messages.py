"""Conversion of `geometry_msgs/TransformStamped` and `Quaternion`, by their field names.

Messages are any objects with these attributes, with times in either spelling.
"""

from __future__ import annotations

import logging
import math
from typing import Any, Final, TypeAlias

from rwt_tf2 import quaternion
from rwt_tf2.buffer import Buffer
from rwt_tf2.errors import InvalidTransform, StaleTransform
from rwt_tf2.times import NANOSECONDS
from rwt_tf2.transform import StampedTransform, Transform

Message: TypeAlias = Any
"""Message of ROS, of any class with the fields of its type."""


def stamp_ns(stamp: Message) -> int:
    """Return a message's time in nanoseconds, from `sec` and `nanosec` or `secs` and `nsecs`."""
    if hasattr(stamp, "sec"):
        return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
    return int(stamp.secs) * NANOSECONDS + int(stamp.nsecs)


def read_transform(message: Message) -> StampedTransform:
    """Read a transform from a message, without validation."""
    moved, turned = message.transform.translation, message.transform.rotation
    return StampedTransform(
        message.header.frame_id,
        message.child_frame_id,
        stamp_ns(message.header.stamp),
        Transform((moved.x, moved.y, moved.z), (turned.x, turned.y, turned.z, turned.w)),
    )


def write_transform(stamped: StampedTransform) -> dict[str, object]:
    """Return a transform as a mapping for the message, with `sec` and `nanosec`."""
    sec, nanosec = divmod(stamped.stamp_ns, NANOSECONDS)
    (x, y, z), (qx, qy, qz, qw) = stamped.transform.translation, stamped.transform.rotation
    return {
        "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": stamped.parent},
        "child_frame_id": stamped.child,
        "transform": {
            "translation": {"x": x, "y": y, "z": z},
            "rotation": {"x": qx, "y": qy, "z": qz, "w": qw},
        },
    }


def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> dict[str, float]:
    """Return a `geometry_msgs/Quaternion` for turns around the fixed axes x, y, z in this order, radians."""
    x, y, z, w = quaternion.from_rpy(roll, pitch, yaw)
    return {"x": x, "y": y, "z": z, "w": w}


def euler_from_quaternion(message: Message) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a `geometry_msgs/Quaternion` in radians; roll is 0 where pitch is ±π/2.

    A quaternion is normalised first; all zeros, as in an unset message, is no rotation.
    """
    rotation = (message.x, message.y, message.z, message.w)
    if not any(rotation):
        return 0.0, 0.0, 0.0
    return quaternion.to_rpy(quaternion.normalised(rotation))


def quaternion_from_yaw(yaw: float) -> dict[str, float]:
    """Return a `geometry_msgs/Quaternion` for a heading, in radians to the left of the x axis."""
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}


def yaw_from_quaternion(message: Message) -> float:
    """Return the heading of a `geometry_msgs/Quaternion`, radians in [-π, π]."""
    return euler_from_quaternion(message)[2]


logger = logging.getLogger(__name__)

STALE_IN_A_ROW: Final = 3
"""Number of consecutive messages with only outdated transforms that indicates a jump back in time."""

_MOST_REMEMBERED = 1000


class Feed:
    """Adds the transforms of messages to a buffer, and logs the first problem of each frame.

    When a recording or simulation restarts, time jumps back; the feed then clears moving transforms, like
    tf2. A single late publisher does not have that effect.

    Attributes:
        taken: number of transforms added.
        refused: number of rejected transforms.
    """

    def __init__(self, buffer: Buffer) -> None:
        self.buffer = buffer
        self.taken = 0
        self.refused = 0
        self._logged: set[str] = set()
        self._stale = 0

    def take(self, message: Message, *, static: bool = False) -> None:
        """Add the transforms of a `tf2_msgs/TFMessage` of `/tf` or `/tf_static`."""
        stale = [each for each in message.transforms if not self._put(each, static)]
        if not stale or len(stale) < len(message.transforms):
            self._stale = 0
            return
        self._stale += 1
        if self._stale >= STALE_IN_A_ROW:
            logger.warning("time jumped back: clearing the transform buffer; static transforms are kept")
            self._stale = 0
            self.buffer.clear()
            for each in stale:
                self._put(each, static)

    def _put(self, message: Message, static: bool) -> bool:
        """Add a transform. Returns False if it is only too old."""
        try:
            self.buffer.set_transform(read_transform(message), static=static)
        except InvalidTransform as error:
            self.refused += 1
            frame = message.child_frame_id
            if frame not in self._logged and len(self._logged) < _MOST_REMEMBERED:
                self._logged.add(frame)
                logger.warning("transform rejected: %s", error)
            return not isinstance(error, StaleTransform)
        self.taken += 1
        return True
