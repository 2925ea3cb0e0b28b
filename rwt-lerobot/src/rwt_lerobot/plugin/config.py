"""Configurations, which LeRobot reads from its command line: `--robot.type=rosbridge --robot.url=…`."""

# No `from __future__ import annotations`: draccus reads the types of the fields.

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig

JOINTS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
"""Joints of SO-100 and SO-101, and of the simulated arm."""


@dataclass(kw_only=True)
class ServerConfig:
    """Rosbridge server of a device.

    Attributes:
        url: URL of the server.
        token: bearer token, if the server requires one.
        max_age: seconds after which data is too old: joint states, images, or the first joint state.
    """

    url: str = "ws://127.0.0.1:9090"
    token: str = ""
    max_age: float = 0.5


@dataclass(kw_only=True)
class JointsConfig(ServerConfig):
    """Joints on a rosbridge server.

    Attributes:
        joints: names of the joints in messages; features are these names with `.pos`.
        units: units of joints by name, if they are not degrees: `range_m100_100`, `range_0_100`, `radians`.
        ranges: radians at the two ends of a joint's range, for the units with a range.
        states: topic of the joint states.
    """

    joints: list[str] = field(default_factory=lambda: list(JOINTS))
    units: dict[str, str] = field(default_factory=dict)
    ranges: dict[str, list[float]] = field(default_factory=dict)
    states: str = "/joint_states"


@RobotConfig.register_subclass("rosbridge")
@dataclass(kw_only=True)
class RosbridgeRobotConfig(JointsConfig, RobotConfig):
    """Robot on a rosbridge server.

    Attributes:
        commands: topic of the trajectories.
        seconds: time of each commanded point; 0: as fast as the robot's limits allow, which only robots of
            rwt-lerobot accept.
        fps: rate of the loop, to count late frames.
        follow_tolerance: distance between command and state, in radians, that needs progress.
        follow_seconds: seconds without progress after which the robot does not follow.
        cameras: cameras of any type of LeRobot's.
    """

    commands: str = "/arm_controller/joint_trajectory"
    seconds: float = 0.0
    fps: int = 30
    follow_tolerance: float = 0.2
    follow_seconds: float = 1.0
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


@TeleoperatorConfig.register_subclass("rosbridge")
@dataclass(kw_only=True)
class RosbridgeTeleoperatorConfig(JointsConfig, TeleoperatorConfig):
    """Commands that arrive on a topic of a rosbridge server, from a page, a phone or a program.

    The action before the first command are the positions of the joint states.

    Attributes:
        commands: topic of the trajectories; the last point of each counts.
    """

    commands: str = "/teleop/joint_trajectory"


@CameraConfig.register_subclass("rosbridge")
@dataclass(kw_only=True)
class RosbridgeCameraConfig(ServerConfig, CameraConfig):
    """Camera on a rosbridge server.

    Attributes:
        topic: topic of the images.
        kind: `sensor_msgs/CompressedImage` or `sensor_msgs/Image`.
    """

    topic: str
    kind: str = "sensor_msgs/CompressedImage"
