"""Limits of joints, and their source in a URDF."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree as ET

USUAL_SPEED: Final = 2.0
"""Maximum speed of a joint whose description states none, radians per second."""

USUAL_STEP: Final = 1.0
"""Maximum distance of a command without a time, radians."""


@dataclass(frozen=True, slots=True)
class JointLimit:
    """Limits of one joint, in radians (metres for a sliding joint) and seconds.

    Attributes:
        lower: smallest position.
        upper: largest position.
        speed: maximum speed.
        step: maximum distance from the current setpoint to a position that is commanded without a time.
    """

    name: str
    lower: float = -math.pi
    upper: float = math.pi
    speed: float = USUAL_SPEED
    step: float = USUAL_STEP


class DescriptionError(ValueError):
    """A robot description cannot be read; the text gives the reason."""


def urdf_limits(text: str) -> Mapping[str, JointLimit]:
    """Return the limits of the movable joints of a URDF, by name.

    Raises:
        DescriptionError: the text is not a URDF, or a limit is not a number.
    """
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise DescriptionError(f"the URDF is not XML: {error}") from error
    found: dict[str, JointLimit] = {}
    for joint in root.iter("joint"):
        name, limit = joint.get("name", ""), joint.find("limit")
        if joint.get("type") not in ("revolute", "continuous", "prismatic"):
            continue
        given = {} if limit is None else limit.attrib
        try:
            found[name] = JointLimit(
                name,
                float(given.get("lower", -math.pi)),
                float(given.get("upper", math.pi)),
                float(given.get("velocity", USUAL_SPEED)) or USUAL_SPEED,
            )
        except ValueError as error:
            raise DescriptionError(f"joint {name!r} of the URDF: {error}") from error
    return found
