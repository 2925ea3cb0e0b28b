"""Rotations as unit quaternions (x, y, z, w), and vectors, as plain tuples.

A product of tuples takes a fraction of a microsecond; numpy's overhead alone takes several. Arrays are used
for many points or times.
"""

from __future__ import annotations

import math
from typing import TypeAlias

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation `b` followed by `a`."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Rotate a vector by a unit quaternion: v + w t + u x t with t = 2 u x v, where u is the vector part."""
    qx, qy, qz, qw = q
    x, y, z = v
    tx = 2.0 * (qy * z - qz * y)
    ty = 2.0 * (qz * x - qx * z)
    tz = 2.0 * (qx * y - qy * x)
    return (
        x + qw * tx + qy * tz - qz * ty,
        y + qw * ty + qz * tx - qx * tz,
        z + qw * tz + qx * ty - qy * tx,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """Return the inverse rotation."""
    return (-q[0], -q[1], -q[2], q[3])


def dot(a: Quaternion, b: Quaternion) -> float:
    """Return the cosine of half the angle between two rotations; negative if their signs are opposite."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


def normalised(q: Quaternion) -> Quaternion:
    """Return `q` scaled to length 1; `q` must not be zero."""
    length = math.hypot(*q)
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def angle_between(a: Quaternion, b: Quaternion) -> float:
    """Return the angle between two rotations, in [0, π]; unlike acos, exact for small angles."""
    apart = math.dist(a, b)
    summed = math.dist(a, (-b[0], -b[1], -b[2], -b[3]))
    return 4.0 * math.atan2(min(apart, summed), max(apart, summed))


def slerp(a: Quaternion, b: Quaternion, fraction: float) -> Quaternion:
    """Return the rotation at `fraction` of the shorter path from `a` to `b`, at constant angular speed."""
    if dot(a, b) < 0.0:
        b = (-b[0], -b[1], -b[2], -b[3])
    half = 2.0 * math.atan2(math.dist(a, b), math.dist(a, (-b[0], -b[1], -b[2], -b[3])))
    sine = math.sin(half)
    if sine < 1e-9:
        # So close that linear interpolation is accurate.
        first, second = 1.0 - fraction, fraction
    else:
        first, second = math.sin((1.0 - fraction) * half) / sine, math.sin(fraction * half) / sine
    return normalised(
        (
            first * a[0] + second * b[0],
            first * a[1] + second * b[1],
            first * a[2] + second * b[2],
            first * a[3] + second * b[3],
        )
    )


def from_rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the turns around the fixed axes x, y, z in this order, in radians (rpy of URDF)."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def to_rpy(q: Quaternion) -> Vector:
    """Return roll, pitch and yaw in radians: the inverse of :func:`from_rpy`. Roll is 0 at pitch ±π/2."""
    x, y, z, w = q
    sine = 2.0 * (w * y - z * x)
    if abs(sine) > 1.0 - 1e-12:
        return 0.0, math.copysign(math.pi / 2, sine), -math.copysign(2.0, sine) * math.atan2(x, w)
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(sine),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )
