"""Units of LeRobot's motors: degrees, -100 to 100, 0 to 100, and radians."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

Unit = Literal["degrees", "range_m100_100", "range_0_100", "radians"]
"""Unit of a motor: the values of LeRobot's `MotorNormMode`, or radians."""

UNITS: Final[tuple[Unit, ...]] = ("degrees", "range_m100_100", "range_0_100", "radians")

_ENDS: Final[Mapping[Unit, tuple[float, float]]] = {
    "range_m100_100": (-100.0, 100.0),
    "range_0_100": (0.0, 100.0),
}


@dataclass(frozen=True, slots=True)
class Scale:
    """Conversion between the unit of a motor and radians.

    Attributes:
        unit: unit of the motor.
        lower: radians at the lower end of the range; not used for degrees and radians.
        upper: radians at the upper end.
    """

    unit: Unit
    lower: float = -math.pi
    upper: float = math.pi

    def to_radians(self, value: float) -> float:
        """Return radians for a value of the motor."""
        if self.unit == "radians":
            return value
        if self.unit == "degrees":
            return math.radians(value)
        low, high = _ENDS[self.unit]
        return self.lower + (value - low) / (high - low) * (self.upper - self.lower)

    def from_radians(self, radians: float) -> float:
        """Return the value of the motor for radians."""
        if self.unit == "radians":
            return radians
        if self.unit == "degrees":
            return math.degrees(radians)
        low, high = _ENDS[self.unit]
        return low + (radians - self.lower) / (self.upper - self.lower) * (high - low)


def unit_named(name: object) -> Unit | None:
    """Return the unit of a name; None if there is none."""
    return next((each for each in UNITS if each == name), None)


def calibrated_range(calibration: Any, resolution: int, unit: Unit) -> tuple[float, float]:
    """Return the range of a motor in radians, from LeRobot's calibration.

    The middle of the range is 0, as for LeRobot's degrees; for 0 to 100, the lower end is 0.

    Args:
        calibration: LeRobot's `MotorCalibration`.
        resolution: ticks of one turn.
        unit: unit of the motor.
    """
    span = (calibration.range_max - calibration.range_min) * 2 * math.pi / (resolution - 1)
    return (0.0, span) if unit == "range_0_100" else (-span / 2, span / 2)
