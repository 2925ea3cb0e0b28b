"""A battery that empties, faster while the robot drives."""

from __future__ import annotations

from rwt.nodes.demo.drive import Velocity

#: Volts of three lithium cells, empty and full.
EMPTY_VOLTAGE = 9.9
FULL_VOLTAGE = 12.6
#: Ampere hours when full.
CAPACITY = 2.5
#: Amperes of the computer and the laser, and of the motors for each m/s and each rad/s.
_IDLE_CURRENT = 0.8
_DRIVING_CURRENT = 3.0
_TURNING_CURRENT = 0.6


class Battery:
    """State of charge.

    Attributes:
        level: 1.0 full, 0.0 empty.
        current: what is drawn now, amperes.
    """

    def __init__(self) -> None:
        self.level = 1.0
        self.current = _IDLE_CURRENT

    @property
    def voltage(self) -> float:
        """Volts at this level."""
        return EMPTY_VOLTAGE + (FULL_VOLTAGE - EMPTY_VOLTAGE) * self.level

    def swap(self) -> None:
        """Replace the battery by a full one."""
        self.level = 1.0

    def drain(self, velocity: Velocity, seconds: float) -> None:
        """Draw current for `seconds` at that velocity; an empty battery stays at 0."""
        self.current = (
            _IDLE_CURRENT + _DRIVING_CURRENT * abs(velocity.linear) + _TURNING_CURRENT * abs(velocity.angular)
        )
        self.level = max(0.0, self.level - self.current * seconds / 3600 / CAPACITY)
