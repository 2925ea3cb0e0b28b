"""Values of the simulation as ROS messages, for every distribution.

Messages are mappings: missing fields are filled in, and `sec`/`nanosec` fit either spelling of time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rwt.extensions.demo.drive import Velocity
from rwt.extensions.demo.world.map import Pose
from rwt_graph import Node
from rwt_interfaces.times import NANOSECONDS
from rwt_tf2 import quaternion_from_yaw, yaw_from_quaternion

Message = Mapping[str, object]

#: Names of the robot's coordinate frames.
MAP = "map"
ODOM = "odom"


def frame(node: Node, name: str) -> str:
    """Return the robot's frame `name` with the node's namespace: `odom` of `/anna` is `anna/odom`."""
    return node.resolve(name).removeprefix("/")


def time(nanoseconds: int) -> Message:
    """Return a time or a duration."""
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    return {"sec": seconds, "nanosec": rest}


def header(stamp_ns: int, frame: str) -> Message:
    """Return a `std_msgs/Header`."""
    return {"stamp": time(stamp_ns), "frame_id": frame}


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Message:
    """Return a `geometry_msgs/Vector3` or `Point`."""
    return {"x": x, "y": y, "z": z}


def turn_about_y(angle: float) -> Message:
    """Return a `geometry_msgs/Quaternion` of a wheel on its axle."""
    return {"x": 0.0, "y": math.sin(angle / 2), "z": 0.0, "w": math.cos(angle / 2)}


def pose(value: Pose) -> Message:
    """Return a `geometry_msgs/Pose`."""
    return {"position": vector(value.x, value.y), "orientation": quaternion_from_yaw(value.heading)}


def twist(velocity: Velocity) -> Message:
    """Return a `geometry_msgs/Twist`."""
    return {"linear": vector(x=velocity.linear), "angular": vector(z=velocity.angular)}


def transform(stamp_ns: int, parent: str, child: str, translation: Message, rotation: Message) -> Message:
    """Return a `geometry_msgs/TransformStamped`."""
    return {
        "header": header(stamp_ns, parent),
        "child_frame_id": child,
        "transform": {"translation": translation, "rotation": rotation},
    }


def planar_transform(stamp_ns: int, parent: str, child: str, value: Pose) -> Message:
    """Return a `geometry_msgs/TransformStamped` of a pose on the floor."""
    return transform(stamp_ns, parent, child, vector(value.x, value.y), quaternion_from_yaw(value.heading))


def read_pose(message: Any) -> Pose:
    """Return position and heading of a `geometry_msgs/Pose`; a quaternion of zeros is a heading of 0."""
    position = message.position
    return Pose(position.x, position.y, yaw_from_quaternion(message.orientation))
