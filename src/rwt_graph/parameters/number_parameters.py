"""Numeric ROS parameters with limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

from rwt_graph import Node
from rwt_participant.errors import ParameterRejected


@dataclass(frozen=True, slots=True)
class Number:
    """Numeric parameter with limits, which can be changed at any time.

    Attributes:
        least: minimum; None for any number above 0.
        whole: True if it is an integer.
    """

    name: str
    least: float | None
    most: float
    unit: str
    description: str
    whole: bool = False

    def check(self, value: object) -> float:
        """Return a valid value.

        Raises:
            ParameterRejected: it is not a number, out of range, or not an integer.
        """
        if isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value):
            enough = value > 0 if self.least is None else value >= self.least
            if enough and value <= self.most and not (self.whole and value != int(value)):
                return int(value) if self.whole else float(value)
        kind = "a whole number" if self.whole else "a number"
        least = "above 0 and at most" if self.least is None else f"from {self.least:g} to"
        limits = f"{least} {self.most:g} {self.unit}".rstrip()
        raise ParameterRejected(f"{self.name} must be {kind} {limits}, got {value!r:.100}")

    def declare(self, node: Node, default: float, apply: Callable[[float], None]) -> None:
        """Declare the parameter on `node`, and apply its value now and after each change.

        Raises:
            ParameterRejected: `default` is not valid.
        """

        def on_change(value: object) -> None:
            apply(self.check(value))

        value = self.check(default)
        apply(value)
        unit = f" [{self.unit}]" if self.unit else ""
        node.parameters.declare(
            self.name,
            value,
            description=f"{self.description}{unit}",
            on_change=on_change,
        )
