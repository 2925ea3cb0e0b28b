"""Plugin of LeRobot: the types `rosbridge` of robots, teleoperators and cameras.

LeRobot imports this package because of its distribution's name; the code is in :mod:`rwt_lerobot.plugin`.
"""

from __future__ import annotations

from rwt_lerobot.plugin import (
    RosbridgeCamera,
    RosbridgeCameraConfig,
    RosbridgeRobot,
    RosbridgeRobotConfig,
    RosbridgeTeleoperator,
    RosbridgeTeleoperatorConfig,
)

__all__ = [
    "RosbridgeCamera",
    "RosbridgeCameraConfig",
    "RosbridgeRobot",
    "RosbridgeRobotConfig",
    "RosbridgeTeleoperator",
    "RosbridgeTeleoperatorConfig",
]
