"""The simulation's values as ROS messages, the same for every distribution.

Messages are mappings: the interfaces fill in what is missing, and take `sec`/`nanosec` for either spelling of
time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Literal, Protocol

from rwt_interfaces.times import NANOSECONDS
from rwt_nodes.demo.drive import Velocity
from rwt_nodes.demo.world.pose import Pose

Message = Mapping[str, object]


class VectorLike(Protocol):
    """`geometry_msgs/Vector3` and `Point`."""

    x: float
    y: float
    z: float


class QuaternionLike(Protocol):
    """`geometry_msgs/Quaternion`."""

    x: float
    y: float
    z: float
    w: float


class PoseLike(Protocol):
    """`geometry_msgs/Pose`."""

    position: VectorLike
    orientation: QuaternionLike


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


def turn_about_z(angle: float) -> Message:
    """`geometry_msgs/Quaternion` of a heading."""
    return {"x": 0.0, "y": 0.0, "z": math.sin(angle / 2), "w": math.cos(angle / 2)}


def turn_about_y(angle: float) -> Message:
    """`geometry_msgs/Quaternion` of a wheel on its axle."""
    return {"x": 0.0, "y": math.sin(angle / 2), "z": 0.0, "w": math.cos(angle / 2)}


def turns_about(axis: Literal["y", "z"]) -> Callable[[float], Message]:
    """What makes a `geometry_msgs/Quaternion` of an angle about an axis."""
    return turn_about_y if axis == "y" else turn_about_z


def roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> Message:
    """`geometry_msgs/Quaternion` of turns about the fixed x, y and z axes, in this order."""
    cx, sx = math.cos(roll / 2), math.sin(roll / 2)
    cy, sy = math.cos(pitch / 2), math.sin(pitch / 2)
    cz, sz = math.cos(yaw / 2), math.sin(yaw / 2)
    return {
        "x": sx * cy * cz - cx * sy * sz,
        "y": cx * sy * cz + sx * cy * sz,
        "z": cx * cy * sz - sx * sy * cz,
        "w": cx * cy * cz + sx * sy * sz,
    }


def pose(value: Pose) -> Message:
    """`geometry_msgs/Pose`."""
    return {"position": vector(value.x, value.y), "orientation": turn_about_z(value.heading)}


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
    return transform(stamp_ns, parent, child, vector(value.x, value.y), turn_about_z(value.heading))


def read_pose(message: PoseLike) -> Pose:
    """Position and heading of a `geometry_msgs/Pose`; a quaternion of zeros is a heading of 0."""
    q = message.orientation
    heading = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    return Pose(message.position.x, message.position.y, heading)
