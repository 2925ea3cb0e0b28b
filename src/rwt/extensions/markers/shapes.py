"""Shapes of controls: `visualization_msgs/Marker`, in metres, in the frame of the marker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

Shape = Mapping[str, object]
"""A `visualization_msgs/Marker`."""

Point = tuple[float, float, float]
"""x, y, z in metres."""

Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""

UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)


class Colour(NamedTuple):
    """Colour: red, green, blue and opacity, each 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0


GREY = Colour(0.6, 0.6, 0.6)

# Numbers of `visualization_msgs/Marker`.
_ARROW, _CUBE, _SPHERE, _CYLINDER, _TEXT, _MESH, _TRIANGLES = 0, 1, 2, 3, 9, 10, 11


def box(size: Point, colour: Colour = GREY, at: Point = (0.0, 0.0, 0.0)) -> Shape:
    """Return a box of a length, width and height around `at`."""
    return _shape(_CUBE, size, colour, at)


def sphere(diameter: float, colour: Colour = GREY, at: Point = (0.0, 0.0, 0.0)) -> Shape:
    """Return a sphere around `at`."""
    return _shape(_SPHERE, (diameter, diameter, diameter), colour, at)


def cylinder(diameter: float, height: float, colour: Colour = GREY, at: Point = (0.0, 0.0, 0.0)) -> Shape:
    """Return an upright cylinder around `at`."""
    return _shape(_CYLINDER, (diameter, diameter, height), colour, at)


def arrow(
    tail: Point, head: Point, width: float, colour: Colour = GREY, orientation: Quaternion = UPRIGHT
) -> Shape:
    """Return an arrow from `tail` to `head`, both rotated by `orientation`; `width` is that of the shaft."""
    points = [_point(tail), _point(head)]
    return {
        **_shape(_ARROW, (width, 2 * width, 3 * width), colour, orientation=orientation),
        "points": points,
    }


def text(words: str, height: float, colour: Colour = GREY, at: Point = (0.0, 0.0, 0.0)) -> Shape:
    """Return text around `at` that faces the viewer; capital letters have that `height`."""
    return {**_shape(_TEXT, (height, height, height), colour, at), "text": words}


def mesh(resource: str, scale: float = 1.0, colour: Colour | None = None) -> Shape:
    """Return a mesh from a file.

    Args:
        resource: `package://name/path` or a URL.
        scale: metres for a unit of the file.
        colour: None for the file's own.
    """
    own = colour is None
    shape = _shape(_MESH, (scale, scale, scale), Colour(0.0, 0.0, 0.0, 0.0) if colour is None else colour)
    return {**shape, "mesh_resource": resource, "mesh_use_embedded_materials": own}


def triangles(corners: Sequence[Point], colour: Colour, orientation: Quaternion = UPRIGHT) -> Shape:
    """Return triangles of three corners each, rotated by `orientation`."""
    return {
        **_shape(_TRIANGLES, (1.0, 1.0, 1.0), colour, orientation=orientation),
        "points": [_point(corner) for corner in corners],
    }


def pose(at: Point, orientation: Quaternion = UPRIGHT) -> Mapping[str, object]:
    """Return a `geometry_msgs/Pose`."""
    return {"position": _point(at), "orientation": quaternion(orientation)}


def quaternion(value: Quaternion) -> Mapping[str, object]:
    """Return a `geometry_msgs/Quaternion`."""
    return _fields("xyzw", value, "a rotation")


def _point(value: Point) -> Mapping[str, object]:
    return _fields("xyz", value, "a place or size")


def _fields(names: str, value: tuple[float, ...], what: str) -> Mapping[str, object]:
    if len(value) != len(names):
        raise ValueError(f"{what} has {', '.join(names)}; got {value}")
    return dict(zip(names, value, strict=True))


def _shape(
    kind: int, scale: Point, colour: Colour, at: Point = (0.0, 0.0, 0.0), orientation: Quaternion = UPRIGHT
) -> Shape:
    return {
        "type": kind,
        "pose": pose(at, orientation),
        "scale": _point(scale),
        "color": colour._asdict(),
    }
