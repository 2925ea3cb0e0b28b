"""Values of the simulation as ROS messages, for every distribution.

Messages are mappings: missing fields are filled in, and `sec`/`nanosec` fit either spelling of time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Literal, Protocol

from rwt.nodes.demo.drive import Velocity
from rwt.nodes.demo.world.pose import Pose
from rwt_interfaces.times import NANOSECONDS
from rwt_tf2 import quaternion_from_yaw, yaw_from_quaternion

Message = Mapping[str, object]


class VectorLike(Protocol):
    """`geometry_msgs/Vector3` and `Point`."""

    x: float
    y: float
    z: float


class PoseLike(Protocol):
    """`geometry_msgs/Pose`."""

    position: VectorLike
    orientation: Any


def time(nanoseconds: int) -> Message:
    """A time or a duration."""
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    return {"sec": seconds, "nanosec": rest}


def header(stamp_ns: int, frame: str) -> Message:
    """`std_msgs/Header`."""
    return {"stamp": time(stamp_ns), "frame_id": frame}


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Message:
    """`geometry_msgs/Vector3` and `Point`."""
    return {"x": x, "y": y, "z": z}


def turn_about_y(angle: float) -> Message:
    """`geometry_msgs/Quaternion` of a wheel on its axle."""
    return {"x": 0.0, "y": math.sin(angle / 2), "z": 0.0, "w": math.cos(angle / 2)}


def turns_about(axis: Literal["y", "z"]) -> Callable[[float], Message]:
    """Return a factory of `geometry_msgs/Quaternion` from an angle about an axis."""
    return turn_about_y if axis == "y" else quaternion_from_yaw


def pose(value: Pose) -> Message:
    """`geometry_msgs/Pose`."""
    return {"position": vector(value.x, value.y), "orientation": quaternion_from_yaw(value.heading)}


def twist(velocity: Velocity) -> Message:
    """`geometry_msgs/Twist`."""
    return {"linear": vector(x=velocity.linear), "angular": vector(z=velocity.angular)}


def transform(stamp_ns: int, parent: str, child: str, translation: Message, rotation: Message) -> Message:
    """`geometry_msgs/TransformStamped`."""
    return {
        "header": header(stamp_ns, parent),
        "child_frame_id": child,
        "transform": {"translation": translation, "rotation": rotation},
    }


def planar_transform(stamp_ns: int, parent: str, child: str, value: Pose) -> Message:
    """`geometry_msgs/TransformStamped` of a pose on the floor."""
    return transform(stamp_ns, parent, child, vector(value.x, value.y), quaternion_from_yaw(value.heading))


def read_pose(message: PoseLike) -> Pose:
    """Position and heading of a `geometry_msgs/Pose`; a quaternion of zeros is a heading of 0."""
    position = message.position
    return Pose(position.x, position.y, yaw_from_quaternion(message.orientation))
