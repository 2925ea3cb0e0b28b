"""Failsafe of the autopilot when its ground station is lost, from its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from rwt_mavlink.link.frames import dialect

#: Values of Copter's FS_GCS_ENABLE (https://ardupilot.org/copter/docs/parameters.html).
_COPTER: Final[Mapping[int, str]] = {
    0: "nothing", 1: "returns to launch", 2: "returns to launch, or continues its mission",
    3: "returns by SmartRTL, or to launch", 4: "returns by SmartRTL, or lands", 5: "lands",
    6: "lands by DO_LAND_START of its mission, or returns to launch", 7: "brakes, or lands",
}  # fmt: skip
#: Values of Plane's FS_LONG_ACTN.
_PLANE: Final[Mapping[int, str]] = {
    0: "continues its mission, or returns to launch in other modes", 1: "returns to launch", 2: "glides",
    3: "deploys its parachute", 4: "continues its mission", 5: "continues its mission, or returns to launch",
}  # fmt: skip
#: Values of Rover's FS_ACTION.
_ROVER: Final[Mapping[int, str]] = {
    0: "nothing", 1: "returns to launch", 2: "holds", 3: "returns by SmartRTL, or to launch",
    4: "returns by SmartRTL, or holds", 5: "ends its program",
}  # fmt: skip
#: Values of PX4's NAV_DLL_ACT (https://docs.px4.io/main/en/advanced_config/parameter_reference.html).
_PX4: Final[Mapping[int, str]] = {
    0: "nothing", 1: "holds", 2: "returns to launch", 3: "lands", 5: "ends the flight",
    6: "locks its motors",
}  # fmt: skip

#: Parameters of these kinds of vehicles; those after the first two may be absent.
_PARAMETERS: Final[Mapping[str, tuple[str, ...]]] = {
    "copter": ("FS_GCS_ENABLE", "FS_GCS_TIMEOUT"),
    "plane": ("FS_GCS_ENABL", "FS_LONG_ACTN", "FS_LONG_TIMEOUT"),
    "rover": ("FS_GCS_ENABLE", "FS_ACTION", "FS_TIMEOUT"),
    "px4": ("NAV_DLL_ACT", "COM_DL_LOSS_T"),
}

_PLANES: Final = {dialect.MAV_TYPE_FIXED_WING, *range(19, 26)}
_ROVERS: Final = {dialect.MAV_TYPE_GROUND_ROVER, dialect.MAV_TYPE_SURFACE_BOAT}


def failsafe_parameters(autopilot: int, type: int) -> tuple[str, ...]:
    """Return the names of the parameters that state the failsafe of a vehicle; empty if none are known."""
    return _PARAMETERS.get(_kind(autopilot, type), ())


def describe_failsafe(autopilot: int, type: int, values: Mapping[str, float]) -> str:
    """Return what the autopilot does without its ground station, in words.

    Args:
        autopilot: number of MAV_AUTOPILOT.
        type: number of MAV_TYPE.
        values: parameters of the vehicle that are known.
    """
    kind = _kind(autopilot, type)
    names = _PARAMETERS.get(kind, ())
    absent = [name for name in names if name not in values]
    if not names or absent:
        missing = f" ({', '.join(absent)} not received)" if absent else ""
        return f"what the autopilot does without its ground station is not known{missing}"
    stated = ", ".join(f"{name} = {values[name]:g}" for name in names)
    if kind == "copter":
        action, seconds = _COPTER.get(int(values["FS_GCS_ENABLE"])), values["FS_GCS_TIMEOUT"]
    elif kind == "px4":
        action, seconds = _PX4.get(int(values["NAV_DLL_ACT"])), values["COM_DL_LOSS_T"]
    elif kind == "plane":
        is_on = values["FS_GCS_ENABL"] > 0
        action = _PLANE.get(int(values["FS_LONG_ACTN"])) if is_on else "nothing"
        seconds = values["FS_LONG_TIMEOUT"]
    else:
        is_on = values["FS_GCS_ENABLE"] > 0
        action = _ROVER.get(int(values["FS_ACTION"])) if is_on else "nothing"
        seconds = values["FS_TIMEOUT"]
    if action == "nothing":
        return f"the autopilot does nothing without its ground station, it goes on as it is ({stated})"
    if action is None:
        return f"the autopilot's failsafe has an unknown value ({stated})"
    return f"after {seconds:g} s without its ground station the autopilot {action} ({stated})"


def _kind(autopilot: int, type: int) -> str:
    if autopilot == dialect.MAV_AUTOPILOT_PX4:
        return "px4"
    if autopilot != dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return ""
    if type in _PLANES:
        return "plane"
    return "rover" if type in _ROVERS else "copter"
