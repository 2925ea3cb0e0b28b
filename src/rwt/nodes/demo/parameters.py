"""The robot's ROS parameters: their limits and defaults."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from rwt.nodes.number_parameters import Number
from rwt_graph import Node

TUNABLES: Final[Mapping[Number, float]] = MappingProxyType(
    {
        Number("max_speed", None, 5.0, "m/s", "Fastest the robot drives forwards or backwards."): 0.8,
        Number("max_turn_rate", None, 10.0, "rad/s", "Fastest the robot turns."): 2.0,
        Number("max_acceleration", None, 20.0, "m/s^2", "How fast the speed changes."): 2.0,
        Number("max_turn_acceleration", None, 80.0, "rad/s^2", "How fast the turn rate changes."): 8.0,
        Number("command_timeout", None, 60.0, "s", "Time after the last /cmd_vel at which it stops."): 0.5,
        Number("scan_rate", None, 40.0, "Hz", "Laser scans in a second."): 10.0,
        Number("scan_noise", 0.0, 1.0, "m", "Standard deviation of a measured range."): 0.01,
        Number("camera_rate", None, 60.0, "Hz", "Pictures of each camera in a second."): 30.0,
        Number("fibonacci_rate", None, 1000.0, "Hz", "Numbers that /fibonacci finds in a second."): 2.0,
    }
)
"""Every parameter, and its value at the start."""


def declare_tunables(node: Node, apply: Mapping[str, Callable[[float], None]]) -> None:
    """Declare every tunable on `node`; `apply` has, by name, what puts a new value into effect."""
    for tunable, default in TUNABLES.items():
        tunable.declare(node, default, apply[tunable.name])
