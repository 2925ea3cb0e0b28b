"""Conversion of `geometry_msgs/TransformStamped` and `Quaternion`, by their field names.

Messages are any objects with these attributes, with times in either spelling.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

from rwt_tf2 import quaternion
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
