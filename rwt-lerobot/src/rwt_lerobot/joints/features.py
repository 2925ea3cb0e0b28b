"""Joint states and trajectories as LeRobot's features, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rwt_lerobot.joints.scales import UNITS, Scale, unit_named

POSITION = ".pos"
"""End of the name of a feature."""


class FeatureMap:
    """Joints of messages as features such as `elbow_flex.pos`.

    Args:
        joints: names of the joints.
        units: units by joint; degrees by default.
        ranges: radians at the ends of a range, by joint.

    Attributes:
        features: features, as LeRobot describes them.

    Raises:
        ValueError: a name, a unit or a range does not fit.
    """

    def __init__(
        self, joints: Sequence[str], units: Mapping[str, str], ranges: Mapping[str, Sequence[float]]
    ) -> None:
        unknown = sorted((units.keys() | ranges.keys()) - {*joints})
        if unknown:
            raise ValueError(f"{unknown[0]!r} is not a joint; expected one of {', '.join(joints)}")
        self._scales: dict[str, Scale] = {}
        for name in joints:
            if "/" in name:
                raise ValueError(f"joint {name!r}: LeRobot's features have no '/' in their names")
            given = units.get(name, "degrees")
            unit = unit_named(given)
            if unit is None:
                raise ValueError(f"joint {name!r}: unit {given!r}, expected one of {', '.join(UNITS)}")
            if unit.startswith("range") and len(ranges.get(name, ())) != 2:
                raise ValueError(f"joint {name!r}: the unit {unit} needs two radians in `ranges`")
            lower, upper = ranges.get(name, (0.0, 0.0))
            self._scales[name] = Scale(unit, lower, upper)
        self.features: dict[str, type] = {f"{name}{POSITION}": float for name in joints}

    def read(self, names: Sequence[str], positions: Sequence[float]) -> dict[str, float]:
        """Return the features of positions in radians.

        Raises:
            ValueError: a joint is missing in the message.
        """
        given = dict(zip(names, positions, strict=False))
        missing = [name for name in self._scales if name not in given]
        if missing:
            raise ValueError(f"the message has no joint {missing[0]!r}; it has {', '.join(given) or 'none'}")
        return {f"{name}{POSITION}": scale.from_radians(given[name]) for name, scale in self._scales.items()}

    def radians(self, action: Mapping[str, Any]) -> dict[str, float]:
        """Return the positions of an action in radians, by joint.

        Raises:
            KeyError: a joint is missing in the action.
        """
        return {
            name: scale.to_radians(float(action[f"{name}{POSITION}"])) for name, scale in self._scales.items()
        }
