"""Devices for LeRobot: a rosbridge server as a robot, a teleoperator and a camera."""

from __future__ import annotations

from rwt_lerobot.plugin.camera import RosbridgeCamera
from rwt_lerobot.plugin.config import (
    RosbridgeCameraConfig,
    RosbridgeRobotConfig,
    RosbridgeTeleoperatorConfig,
)
from rwt_lerobot.plugin.robot import RosbridgeRobot
from rwt_lerobot.plugin.teleoperator import RosbridgeTeleoperator

# LeRobot looks for the device of a configuration here: the name of its class without `Config`.
__all__ = [
    "RosbridgeCamera",
    "RosbridgeCameraConfig",
    "RosbridgeRobot",
    "RosbridgeRobotConfig",
    "RosbridgeTeleoperator",
    "RosbridgeTeleoperatorConfig",
]
