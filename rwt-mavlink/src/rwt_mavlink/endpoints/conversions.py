"""Conversions between MAVLink's axes (north-east-down, forward-right-down) and those of ROS (REP 103)."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
"""Quaternion as w, x, y, z."""

_HALF: Final = math.sqrt(0.5)
#: Rotation from north-east-down to east-north-up.
_NED_ENU: Final[Quaternion] = (0.0, _HALF, _HALF, 0.0)
#: Rotation from forward-right-down to forward-left-up.
_FRD_FLU: Final[Quaternion] = (0.0, 1.0, 0.0, 0.0)


def ned_enu(x: float, y: float, z: float) -> Vector:
    """Convert a vector between north-east-down and east-north-up, in either direction."""
    return y, x, -z


def frd_flu(x: float, y: float, z: float) -> Vector:
    """Convert a vector between forward-right-down and forward-left-up, in either direction."""
    return x, -y, -z


def enu_orientation(attitude: Quaternion) -> Quaternion:
    """Return the orientation of forward-left-up in east-north-up of an attitude in MAVLink's axes."""
    turned = _product(_product(_NED_ENU, attitude), _FRD_FLU)
    return turned if turned[0] >= 0 else (-turned[0], -turned[1], -turned[2], -turned[3])


def from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the quaternion of rotations about x, y and z, in radians."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def yaw_of(w: float, x: float, y: float, z: float) -> float:
    """Return the rotation of a quaternion about z, in radians."""
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def ned_yaw(yaw: float) -> float:
    """Convert a heading between anticlockwise from east and clockwise from north, in radians."""
    return math.remainder(math.pi / 2 - yaw, math.tau)


def vector(values: Vector) -> dict[str, float]:
    """Return a `geometry_msgs/Vector3` or a `geometry_msgs/Point`."""
    return dict(zip("xyz", values, strict=True))


def quaternion(values: Quaternion) -> dict[str, float]:
    """Return a `geometry_msgs/Quaternion`."""
    return dict(zip("wxyz", values, strict=True))


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )
