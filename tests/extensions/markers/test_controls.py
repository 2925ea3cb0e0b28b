"""Controls as messages: which axis, which handles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

import pytest

from rwt.extensions.markers import (
    Colour,
    arrow,
    box,
    button,
    cylinder,
    interactive_marker,
    menu_control,
    mesh,
    move_3d,
    move_axis,
    move_plane,
    rotate_axis,
    six_dof,
    sphere,
    text,
)
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry

REGISTRIES = [Registry(distro) for distro in DISTROS.values()]


def turned(quaternion: Mapping[str, Any], vector: tuple[float, float, float]) -> list[float]:
    """A vector turned by a quaternion, by the textbook: v + 2w(u x v) + 2 u x (u x v)."""
    u = [quaternion[axis] for axis in "xyz"]

    def cross(a: list[float], b: list[float]) -> list[float]:
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    once = cross(u, list(vector))
    twice = cross(u, once)
    return [round(v + 2 * (quaternion["w"] * a + b), 6) for v, a, b in zip(vector, once, twice, strict=True)]


@pytest.mark.parametrize(("axis", "direction"), [("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1])])
@pytest.mark.parametrize("make", [move_axis, rotate_axis, move_plane])
def test_the_controls_own_x_is_turned_to_the_axis(make: Any, axis: str, direction: list[float]) -> None:
    control = make(axis)
    assert turned(control["orientation"], (1.0, 0.0, 0.0)) == direction
    for shape in control["markers"]:
        assert shape["pose"]["orientation"] == control["orientation"]


def test_another_axis_is_refused() -> None:
    with pytest.raises(ValueError, match="axis: expected x, y or z, got 'w'"):
        move_axis("w")


def test_six_dof_has_each_of_the_six_once() -> None:
    modes = [(control["name"], control["interaction_mode"]) for control in six_dof()]
    assert sorted(modes) == [
        *((f"move_{axis}", 3) for axis in "xyz"),
        *((f"rotate_{axis}", 5) for axis in "xyz"),
    ]
    assert {control["orientation_mode"] for control in six_dof(fixed=True)} == {1}


def test_a_ring_closes_and_keeps_its_radii() -> None:
    control: Any = rotate_axis("z", scale=2.0)
    [ring] = control["markers"]
    points = [(point["x"], point["y"], point["z"]) for point in ring["points"]]
    assert len(points) % 3 == 0
    assert {round(math.hypot(y, z), 2) for _, y, z in points} == {0.8, 1.0}
    assert {x for x, _, _ in points} == {0.0}
    assert points[0] in points[-3:]


def test_shapes_of_ones_own_take_the_place_of_handles() -> None:
    control: Any = move_plane("z", box((1.0, 2.0, 3.0), Colour(1.0, 0.0, 0.0)), name="slab")
    [shape] = control["markers"]
    assert (control["name"], shape["type"], shape["scale"]) == ("slab", 1, {"x": 1.0, "y": 2.0, "z": 3.0})
    assert shape["header"]["frame_id"] == ""


@pytest.mark.parametrize("registry", REGISTRIES, ids=lambda registry: registry.distro.name)
def test_everything_fits_the_types_of_either_distribution(registry: Registry) -> None:
    shapes = [
        arrow((0, 0, 0), (1, 0, 0), 0.1),
        box((1, 1, 1)),
        cylinder(1, 2),
        mesh("package://robot/meshes/hand.dae"),
        mesh("package://robot/meshes/hand.stl", 0.001, Colour(1, 1, 1)),
        sphere(1),
        text("hello", 0.2),
    ]
    controls = [*six_dof(), move_plane("z"), move_3d(*shapes), button(*shapes), menu_control(*shapes)]
    marker: Any = Payload.from_value(
        registry.message("visualization_msgs/InteractiveMarker"),
        interactive_marker("all", description="All of it", controls=controls),
    ).value()
    assert len(marker.controls) == len(controls) + 1
    by_file, coloured = marker.controls[-2].markers[3:5]
    assert (by_file.mesh_use_embedded_materials, coloured.mesh_use_embedded_materials) == (True, False)
    assert marker.controls[-1].markers[0].text == "All of it"


def test_a_place_has_three_numbers() -> None:
    with pytest.raises(ValueError, match=r"a place or size has x, y, z; got \(0.1, 0.2\)"):
        box(cast(Any, (0.1, 0.2)), Colour(1.0, 0.0, 0.0))
