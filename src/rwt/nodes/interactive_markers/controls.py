"""Interactive markers and their controls as messages, with handles for controls that have no shape of their
own."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from enum import IntEnum
from typing import Final

from rwt.nodes.interactive_markers.shapes import (
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
    """An axis of the marker."""

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
    MOVE_ROTATE = 6
    MOVE_3D = 7
    ROTATE_3D = 8
    MOVE_ROTATE_3D = 9


#: `orientation_mode`: turned with the marker, or as its frame is.
_INHERIT, _FIXED = 0, 1

_HALF = math.sqrt(0.5)
#: How a control, whose own axis is x, is turned to have it along each axis of the marker.
_TURNS: Final[Mapping[Axis, Quaternion]] = {
    Axis.X: UPRIGHT,
    Axis.Y: (0.0, 0.0, _HALF, _HALF),
    Axis.Z: (0.0, -_HALF, 0.0, _HALF),
}
#: Not quite opaque: ros3djs draws such colours as they are, and others in the light of a lamp at one side.
_COLOURS: Final[Mapping[Axis, Colour]] = {
    Axis.X: Colour(0.9, 0.15, 0.15, 0.9),
    Axis.Y: Colour(0.15, 0.8, 0.15, 0.9),
    Axis.Z: Colour(0.2, 0.35, 1.0, 0.9),
}
_WHITE = Colour(1.0, 1.0, 1.0)
#: Corners of the circle that a ring is.
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
        name: unique in its server.
        frame: what `at` and `orientation` are relative to; the marker moves with it.
        at: metres.
        scale: size of the handles, metres.
        description: shown above the marker.
    """
    shown = list(controls)
    if description:
        shown.append(_control(Mode.NONE, "", [text(description, 0.15 * scale, _WHITE, (0, 0, 1.2 * scale))]))
    return {
        # A stamp of zero: the marker stays fixed to its frame when that moves.
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
    """Dragging moves the marker along one of its axes.

    Args:
        axis: also by name, `"x"`.
        shapes: what is dragged; two arrows without any.
        name: what feedback says; `move_x` and so on by default.
        scale: of the arrows: each ends that many metres from the middle.
        fixed: True if the axes are those of the frame, however the marker is turned.
    """
    chosen = _axis(axis)
    handles = shapes or tuple(_arrows(chosen, scale))
    return _control(Mode.MOVE_AXIS, name or f"move_{chosen.name.lower()}", handles, chosen, fixed)


def rotate_axis(
    axis: Axis | str, *shapes: Shape, name: str = "", scale: float = 1.0, fixed: bool = False
) -> Control:
    """Dragging turns the marker around one of its axes: by a ring of radius scale/2 without any shapes."""
    chosen = _axis(axis)
    handles = shapes or (_ring(chosen, scale),)
    return _control(Mode.ROTATE_AXIS, name or f"rotate_{chosen.name.lower()}", handles, chosen, fixed)


def move_plane(
    normal: Axis | str, *shapes: Shape, name: str = "", scale: float = 1.0, fixed: bool = False
) -> Control:
    """Dragging moves the marker in the plane that stands upright on an axis: by a ring without any shapes."""
    chosen = _axis(normal)
    handles = shapes or (_ring(chosen, scale),)
    return _control(Mode.MOVE_PLANE, name or "move_plane", handles, chosen, fixed)


def move_3d(*shapes: Shape, name: str = "move_3d") -> Control:
    """Dragging moves the marker in the plane that faces the viewer most."""
    return _control(Mode.MOVE_3D, name, shapes)


def button(*shapes: Shape, name: str = "button") -> Control:
    """A click is reported, and opens the menu where there is one."""
    return _control(Mode.BUTTON, name, shapes)


def menu_control(*shapes: Shape, name: str = "menu") -> Control:
    """A click opens the menu, and nothing can be dragged."""
    return _control(Mode.MENU, name, shapes)


def six_dof(scale: float = 1.0, *, fixed: bool = False) -> list[Control]:
    """Six controls: moving along, and turning around, each axis."""
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
        # Without a frame, a shape is relative to the marker. A stamp of zero goes with that.
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
        here, there = (_direction(segment + step) for step in (0, 1))
        a, b = _at(here, inner), _at(here, outer)
        c, d = _at(there, outer), _at(there, inner)
        corners += [a, b, c, a, c, d]
    return triangles(corners, _COLOURS[axis], _TURNS[axis])


def _direction(segment: int) -> tuple[float, float]:
    angle = math.tau * segment / _SEGMENTS
    return math.cos(angle), math.sin(angle)


def _at(direction: tuple[float, float], radius: float) -> Point:
    return (0.0, round(radius * direction[0], 4), round(radius * direction[1], 4))
