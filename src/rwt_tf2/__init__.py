"""Transforms over time, like ROS's tf2: a tree of frames, and lookups between them.

Does no I/O. Of messages, it only knows the fields of `geometry_msgs/TransformStamped` and `Quaternion`.
Times are integers in nanoseconds; lengths are metres, angles radians, quaternions (x, y, z, w).

>>> buffer = Buffer()
>>> buffer.set_transform(StampedTransform("map", "base_link", 1_000_000_000, Transform((1.0, 2.0, 0.0))))
>>> buffer.lookup_transform("map", "base_link").transform.apply((0.5, 0.0, 0.0))
(1.5, 2.0, 0.0)
"""

from rwt_tf2.buffer import Buffer, Verdict
from rwt_tf2.errors import (
    ConnectivityError,
    ExtrapolationError,
    InvalidDescription,
    InvalidTransform,
    LookupFailed,
    LoopRefused,
    StaleTransform,
    TransformError,
    UnknownFrame,
)
from rwt_tf2.feed import Feed
from rwt_tf2.messages import (
    euler_from_quaternion,
    quaternion_from_euler,
    quaternion_from_yaw,
    read_transform,
    stamp_ns,
    write_transform,
    yaw_from_quaternion,
)
from rwt_tf2.transform import IDENTITY, StampedTransform, Transform

__all__ = [
    "Buffer",
    "Verdict",
    "Transform",
    "StampedTransform",
    "IDENTITY",
    "Feed",
    "read_transform",
    "write_transform",
    "stamp_ns",
    "quaternion_from_yaw",
    "yaw_from_quaternion",
    "quaternion_from_euler",
    "euler_from_quaternion",
    "TransformError",
    "LookupFailed",
    "UnknownFrame",
    "ConnectivityError",
    "ExtrapolationError",
    "InvalidTransform",
    "InvalidDescription",
    "LoopRefused",
    "StaleTransform",
]
