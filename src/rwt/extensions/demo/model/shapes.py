"""Shapes of the robot, as URDF and as triangle meshes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final
from xml.etree import ElementTree as ET

Point = tuple[float, float, float]

#: Number of corners of a circle.
_AROUND: Final = 32
#: Number of bands of a sphere from pole to pole.
_BANDS: Final = 12


@dataclass(frozen=True, slots=True)
class Surface:
    """Triangle mesh, counterclockwise as seen from outside.

    Attributes:
        points: corners, metres.
        normals: unit normal at each point.
        triangles: indexes of three points each.
    """

    points: Sequence[Point]
    normals: Sequence[Point]
    triangles: Sequence[tuple[int, int, int]]


@dataclass(frozen=True, slots=True)
class Cuboid:
    """Box around the origin; metres."""

    x: float
    y: float
    z: float

    def element(self, inset: float = 0.0) -> ET.Element:
        """Return URDF of the box, shrunk by a margin in metres."""
        return ET.Element("box", size=" ".join(text(side - 2 * inset) for side in (self.x, self.y, self.z)))

    def surface(self) -> Surface:
        """Return the six flat sides."""
        points: list[Point] = []
        normals: list[Point] = []
        for axis in range(3):
            for sign in (-1.0, 1.0):
                # Two further directions, which form a right-handed system with the first.
                for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                    points.append(self._corner(axis, sign, a * sign, float(b)))
                normals += [_axes(axis, sign, 0.0, 0.0)] * 4
        sides = range(0, len(points), 4)
        return Surface(points, normals, [(at, at + i, at + i + 1) for at in sides for i in (1, 2)])

    def _corner(self, axis: int, sign: float, a: float, b: float) -> Point:
        x, y, z = _axes(axis, sign, a, b)
        return x * self.x / 2, y * self.y / 2, z * self.z / 2


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Cylinder around the origin along z; metres."""

    radius: float
    length: float

    def element(self, inset: float = 0.0) -> ET.Element:
        """Return URDF of the shape, shrunk by a margin in metres."""
        radius, length = text(self.radius - inset), text(self.length - 2 * inset)
        return ET.Element("cylinder", radius=radius, length=length)

    def surface(self) -> Surface:
        """Return a smooth side and two flat ends."""
        top, side = self.length / 2, self.radius
        return _revolved(
            (
                (_Rim(0.0, -top, 0.0, -1.0), _Rim(side, -top, 0.0, -1.0)),
                (_Rim(side, -top, 1.0, 0.0), _Rim(side, top, 1.0, 0.0)),
                (_Rim(side, top, 0.0, 1.0), _Rim(0.0, top, 0.0, 1.0)),
            )
        )


@dataclass(frozen=True, slots=True)
class Sphere:
    """Sphere around the origin; metres."""

    radius: float

    def element(self, inset: float = 0.0) -> ET.Element:
        """Return URDF of the shape, shrunk by a margin in metres."""
        return ET.Element("sphere", radius=text(self.radius - inset))

    def surface(self) -> Surface:
        """Return a smooth surface."""
        return _revolved(tuple(pairwise(self._rims())))

    def _rims(self) -> Iterator[_Rim]:
        for band in range(_BANDS + 1):
            height = -math.cos(math.pi * band / _BANDS)
            out = math.sin(math.pi * band / _BANDS)
            yield _Rim(self.radius * out, self.radius * height, out, height)


Shape = Cuboid | Cylinder | Sphere


@dataclass(frozen=True, slots=True)
class _Rim:
    """Circle about z, with the outward and upward components of its normals."""

    radius: float
    z: float
    outwards: float
    upwards: float


def text(value: float) -> str:
    """Return a number in URDF notation."""
    return f"{value:.6g}"


def _axes(axis: int, along: float, a: float, b: float) -> Point:
    """Return a vector by its component along an axis and those along the next two, cyclically."""
    x, y, z = ((along, a, b), (b, along, a), (a, b, along))[axis]
    return x, y, z


def _revolved(strips: Sequence[tuple[_Rim, _Rim]]) -> Surface:
    """Return the surface between pairs of rims, each from below to above as seen from outside."""
    circle = [
        (math.cos(angle), math.sin(angle)) for angle in (math.tau * i / _AROUND for i in range(_AROUND))
    ]
    rims = [rim for strip in strips for rim in strip]
    triangles = []
    for first in range(0, len(rims) * _AROUND, 2 * _AROUND):
        for here in range(_AROUND):
            low, next_low = first + here, first + (here + 1) % _AROUND
            high, next_high = low + _AROUND, next_low + _AROUND
            triangles += [(low, next_low, next_high), (low, next_high, high)]
    return Surface(
        [(rim.radius * cos, rim.radius * sin, rim.z) for rim in rims for cos, sin in circle],
        [(rim.outwards * cos, rim.outwards * sin, rim.upwards) for rim in rims for cos, sin in circle],
        triangles,
    )
