"""Interactive markers and their controls as messages, with handles for controls without shapes of their
own."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from enum import IntEnum
from typing import Final

from rwt.extensions.markers.shapes import (
    UPRIGHT,
    Colour,
    Point,
    Quaternion,
    Shape,
    arrow,
    pose,
    quaternion,
    text,
    triangles,
)

Control = Mapping[str, object]
"""A `visualization_msgs/InteractiveMarkerControl`."""


class Axis(IntEnum):
    """Axis of the marker."""

    X = 0
    Y = 1
    Z = 2


class Mode(IntEnum):
    """Effect of dragging a control: `interaction_mode` of `visualization_msgs/InteractiveMarkerControl`."""

    NONE = 0
    MENU = 1
    BUTTON = 2
    MOVE_AXIS = 3
    MOVE_PLANE = 4
    ROTATE_AXIS = 5
    MOVE_3D = 7


#: `orientation_mode`: of the marker, or of its frame.
_INHERIT, _FIXED = 0, 1

_HALF = math.sqrt(0.5)
#: Rotation of a control, whose own axis is x, to each axis of the marker.
_TURNS: Final[Mapping[Axis, Quaternion]] = {
    Axis.X: UPRIGHT,
    Axis.Y: (0.0, 0.0, _HALF, _HALF),
    Axis.Z: (0.0, -_HALF, 0.0, _HALF),
}
#: Not quite opaque: ros3djs does not shade such colours.
_COLOURS: Final[Mapping[Axis, Colour]] = {
    Axis.X: Colour(0.9, 0.15, 0.15, 0.9),
    Axis.Y: Colour(0.15, 0.8, 0.15, 0.9),
    Axis.Z: Colour(0.2, 0.35, 1.0, 0.9),
}
_WHITE = Colour(1.0, 1.0, 1.0)
#: Number of corners of a ring.
_SEGMENTS = 24


def interactive_marker(
    name: str,
    *,
    frame: str = "map",
    at: Point = (0.0, 0.0, 0.0),
    orientation: Quaternion = UPRIGHT,
    scale: float = 1.0,
    description: str = "",
    controls: Iterable[Control] = (),
) -> Mapping[str, object]:
    """Return a `visualization_msgs/InteractiveMarker`.

    Args:
        name: name, unique in its server.
        frame: frame of `at` and `orientation`; the marker moves with it.
        at: position in metres.
        scale: size of the handles, metres.
        description: text above the marker.
    """
    shown = list(controls)
    if description:
        shown.append(_control(Mode.NONE, "", [text(description, 0.15 * scale, _WHITE, (0, 0, 1.2 * scale))]))
    return {
        # With a stamp of zero, the marker moves with its frame.
        "header": {"frame_id": frame, "stamp": {"sec": 0, "nanosec": 0}},
        "name": name,
        "pose": pose(at, orientation),
        "scale": scale,
        "description": description,
        "controls": shown,
    }


def move_axis(
    axis: Axis | str, *shapes: Shape, name: str = "", scale: float = 1.0, fixed: bool = False
) -> Control:
    """Return a control that moves the marker along one of its axes.

    Args:
        axis: axis, also by name (`"x"`).
        shapes: handles; two arrows by default.
        name: name in feedback; by default `move_x` and so on.
        scale: distance of the arrows' ends from the middle in metres.
        fixed: True for the axes of the frame instead of the marker.
    """
    chosen = _axis(axis)
    handles = shapes or tuple(_arrows(chosen, scale))
    return _control(Mode.MOVE_AXIS, name or f"move_{chosen.name.lower()}", handles, chosen, fixed)


def rotate_axis(
    axis: Axis | str, *shapes: Shape, name: str = "", scale: float = 1.0, fixed: bool = False
) -> Control:
    """Return a control that turns the marker around an axis; by default a ring of radius scale/2."""
    chosen = _axis(axis)
    handles = shapes or (_ring(chosen, scale),)
    return _control(Mode.ROTATE_AXIS, name or f"rotate_{chosen.name.lower()}", handles, chosen, fixed)


def move_plane(
    normal: Axis | str, *shapes: Shape, name: str = "", scale: float = 1.0, fixed: bool = False
) -> Control:
    """Return a control that moves the marker in the plane perpendicular to an axis; by default a ring."""
    chosen = _axis(normal)
    handles = shapes or (_ring(chosen, scale),)
    return _control(Mode.MOVE_PLANE, name or "move_plane", handles, chosen, fixed)


def move_3d(*shapes: Shape, name: str = "move_3d") -> Control:
    """Return a control that moves the marker in the plane of the view."""
    return _control(Mode.MOVE_3D, name, shapes)


def button(*shapes: Shape, name: str = "button") -> Control:
    """Return a control that reports clicks, and opens the menu if there is one."""
    return _control(Mode.BUTTON, name, shapes)


def menu_control(*shapes: Shape, name: str = "menu") -> Control:
    """Return a control that opens the menu, without dragging."""
    return _control(Mode.MENU, name, shapes)


def six_dof(scale: float = 1.0, *, fixed: bool = False) -> list[Control]:
    """Return six controls: moving along, and turning around, each axis."""
    return [make(axis, scale=scale, fixed=fixed) for axis in Axis for make in (rotate_axis, move_axis)]


def _axis(axis: Axis | str) -> Axis:
    try:
        return Axis[axis.upper()] if isinstance(axis, str) else Axis(axis)
    except KeyError:
        raise ValueError(f"axis: expected x, y or z, got {axis!r}") from None


def _control(
    mode: Mode, name: str, shapes: Iterable[Shape], axis: Axis = Axis.X, fixed: bool = False
) -> Control:
    return {
        "name": name,
        "orientation": quaternion(_TURNS[axis]),
        "orientation_mode": _FIXED if fixed else _INHERIT,
        "interaction_mode": int(mode),
        "always_visible": True,
        # Without a frame and with a stamp of zero, a shape is relative to the marker.
        "markers": [
            {"header": {"frame_id": "", "stamp": {"sec": 0, "nanosec": 0}}, **shape} for shape in shapes
        ],
    }


def _arrows(axis: Axis, scale: float) -> Iterator[Shape]:
    for way in (1.0, -1.0):
        tail, head = (way * 0.55 * scale, 0.0, 0.0), (way * scale, 0.0, 0.0)
        yield arrow(tail, head, 0.08 * scale, _COLOURS[axis], _TURNS[axis])


def _ring(axis: Axis, scale: float) -> Shape:
    """Return a flat ring, seen from both sides, around the control's x axis."""
    inner, outer = 0.4 * scale, 0.5 * scale
    corners: list[Point] = []
    for segment in range(_SEGMENTS):
        a, b = _at(segment, inner), _at(segment, outer)
        c, d = _at(segment + 1, outer), _at(segment + 1, inner)
        corners += [a, b, c, a, c, d]
    return triangles(corners, _COLOURS[axis], _TURNS[axis])


def _at(segment: int, radius: float) -> Point:
    angle = math.tau * segment / _SEGMENTS
    return (0.0, round(radius * math.cos(angle), 4), round(radius * math.sin(angle), 4))
