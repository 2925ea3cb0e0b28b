"""Names of flight modes, as mavros has them, and the parameters of the command that sets them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from pymavlink import mavutil

from rwt_mavlink.link.frames import dialect

#: PX4's main modes, and those below AUTO (https://docs.px4.io, `px4_custom_mode.h`), with mavros's names.
_PX4_AUTO: Final = 4
_PX4_MAIN: Final[Mapping[int, str]] = {
    1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED", 8: "RATTITUDE",
}  # fmt: skip
_PX4_SUB: Final[Mapping[int, str]] = {
    1: "READY", 2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND", 7: "RTGS", 8: "FOLLOW_TARGET",
    9: "PRECLAND",
}  # fmt: skip


def mode_name(autopilot: int, type: int, base_mode: int, custom_mode: int) -> str:
    """Return the name of the mode in a heartbeat; the number in `CMODE(…)` if it has no name."""
    if not base_mode & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return f"MODE(0x{base_mode:02X})"
    if autopilot == dialect.MAV_AUTOPILOT_PX4:
        main, sub = (custom_mode >> 16) & 0xFF, custom_mode >> 24
        if main == _PX4_AUTO and sub in _PX4_SUB:
            return f"AUTO.{_PX4_SUB[sub]}"
        if main in _PX4_MAIN:
            return _PX4_MAIN[main]
    elif custom_mode in (names := _ardupilot(type)):
        return names[custom_mode]
    return f"CMODE({custom_mode})"


def mode_parameters(autopilot: int, type: int, name: str) -> tuple[float, float, float] | None:
    """Return the parameters of DO_SET_MODE for a mode by name or number; None if there is no such mode."""
    base = float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    if autopilot == dialect.MAV_AUTOPILOT_PX4:
        for sub, known in _PX4_SUB.items():
            if name == f"AUTO.{known}":
                return base, float(_PX4_AUTO), float(sub)
        found = [number for number, known in _PX4_MAIN.items() if known == name]
    else:
        found = [number for number, known in _ardupilot(type).items() if known == name]
        if not found and name.isascii() and name.isdigit() and int(name) < 256:
            found = [int(name)]
    return (base, float(found[0]), 0.0) if found else None


def _ardupilot(type: int) -> Mapping[int, str]:
    found: Mapping[int, str] | None = mavutil.mode_mapping_bynumber(type)
    return found or {}
