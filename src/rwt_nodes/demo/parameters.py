"""The robot's ROS parameters: their limits, and the reason for refusing other values."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rwt_graph import Node
from rwt_program.errors import ParameterRejected


@dataclass(frozen=True, slots=True)
class Tunable:
    """One numeric parameter with its limits.

    Attributes:
        name: of the parameter.
        default: its value at the start.
        maximum: the highest value it takes.
        unit: of the value.
        description: what it changes.
        zero_allowed: whether 0 is a value too; anything below never is.
    """

    name: str
    default: float
    maximum: float
    unit: str
    description: str
    zero_allowed: bool = False

    def check(self, value: object) -> float:
        """The value as a number.

        Raises:
            ParameterRejected: it is not a number or out of range.
        """
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            enough = value >= 0 if self.zero_allowed else value > 0
            if enough and value <= self.maximum:
                return float(value)
        least = "at least 0" if self.zero_allowed else "above 0"
        msg = f"{self.name} must be a number {least} and at most {self.maximum:g} {self.unit}, got {value!r}"
        raise ParameterRejected(msg)


TUNABLES = (
    Tunable("max_speed", 0.8, 5.0, "m/s", "Fastest the robot drives forwards or backwards."),
    Tunable("max_turn_rate", 2.0, 10.0, "rad/s", "Fastest the robot turns."),
    Tunable("max_acceleration", 2.0, 20.0, "m/s^2", "How fast the speed changes."),
    Tunable("max_turn_acceleration", 8.0, 80.0, "rad/s^2", "How fast the turn rate changes."),
    Tunable("command_timeout", 0.5, 60.0, "s", "Time after the last /cmd_vel at which the robot stops."),
    Tunable("scan_rate", 10.0, 40.0, "Hz", "Laser scans in a second."),
    Tunable("scan_noise", 0.01, 1.0, "m", "Standard deviation of a measured range.", zero_allowed=True),
    Tunable("camera_rate", 30.0, 60.0, "Hz", "Pictures of each camera in a second."),
    Tunable("fibonacci_rate", 2.0, 1000.0, "Hz", "Numbers that /fibonacci finds in a second."),
)


def declare_tunables(node: Node, apply: Mapping[str, Callable[[float], None]]) -> None:
    """Declare every tunable on `node`; `apply` has, by name, what puts a new value into effect."""
    for tunable in TUNABLES:
        apply[tunable.name](tunable.default)
        node.parameters.declare(
            tunable.name,
            tunable.default,
            description=f"{tunable.description} [{tunable.unit}]",
            on_change=_checked(tunable, apply[tunable.name]),
        )


def _checked(tunable: Tunable, apply: Callable[[float], None]) -> Callable[[object], None]:
    def on_change(value: object) -> None:
        apply(tunable.check(value))

    return on_change
