"""`geometry_msgs/TransformStamped` in and out, by the names of its fields alone.

Whoever has messages passes them as they are: objects with attributes, in either spelling of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from rwt_tf2.times import NANOSECONDS
from rwt_tf2.transform import StampedTransform, Transform


class VectorMessage(Protocol):
    """`geometry_msgs/Vector3`."""

    x: float
    y: float
    z: float


class QuaternionMessage(Protocol):
    """`geometry_msgs/Quaternion`."""

    x: float
    y: float
    z: float
    w: float


class PoseMessage(Protocol):
    """`geometry_msgs/Transform`."""

    @property
    def translation(self) -> VectorMessage:
        """Metres."""

    @property
    def rotation(self) -> QuaternionMessage:
        """A unit quaternion."""


class HeaderMessage(Protocol):
    """`std_msgs/Header`; the fields of `stamp` differ between ROS 1 and 2."""

    stamp: Any
    frame_id: str


class TransformMessage(Protocol):
    """`geometry_msgs/TransformStamped`."""

    child_frame_id: str

    @property
    def header(self) -> HeaderMessage:
        """Time and parent."""

    @property
    def transform(self) -> PoseMessage:
        """From child to parent."""


class TransformsMessage(Protocol):
    """`tf2_msgs/TFMessage`."""

    @property
    def transforms(self) -> Sequence[TransformMessage]:
        """Of any frames and times."""


def stamp_ns(stamp: Any) -> int:
    """A message's time in nanoseconds, in either spelling: `sec` and `nanosec`, or `secs` and `nsecs`."""
    if hasattr(stamp, "sec"):
        return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
    return int(stamp.secs) * NANOSECONDS + int(stamp.nsecs)


def read_transform(message: TransformMessage) -> StampedTransform:
    """Out of a message; nothing is checked."""
    moved, turned = message.transform.translation, message.transform.rotation
    return StampedTransform(
        message.header.frame_id,
        message.child_frame_id,
        stamp_ns(message.header.stamp),
        Transform((moved.x, moved.y, moved.z), (turned.x, turned.y, turned.z, turned.w)),
    )


def write_transform(stamped: StampedTransform) -> dict[str, object]:
    """As a mapping that fits the message; the times are spelled `sec` and `nanosec`."""
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
