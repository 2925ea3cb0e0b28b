"""Plan of a demonstration, shared by the server and the demonstrators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

LEG: Final = 1.0
"""Seconds that a demonstrator drives before a waypoint and a turn."""
COMMAND_PERIOD: Final = 0.05
TF_RATE: Final = 10.0
JOINT_RATE: Final = 20.0
"""Of the demo robot's state, Hz: what of joint states and odometry can come at most."""
PATIENCE: Final = 60.0
"""Seconds for a process to start, on a machine with other work."""


@dataclass(frozen=True, slots=True)
class Velocity:
    """Metres and radians per second."""

    linear: float
    angular: float


@dataclass(frozen=True, slots=True)
class Camera:
    """Of every robot.

    Attributes:
        width: of a picture, pixels.
        height: of a picture, pixels.
        rate: pictures a second.
    """

    width: int
    height: int
    rate: float


LEGS: Final = (Velocity(0.3, 0.8), Velocity(-0.3, -0.8), Velocity(0.3, -0.8), Velocity(-0.3, 0.8))
"""To one side and back, to the other side and back, over and over. Each leg reverses, so each has a command
whose effect can be seen."""


def name_of(number: int) -> str:
    """The namespace of the robot with this number, without slashes."""
    return f"robot{number}"
