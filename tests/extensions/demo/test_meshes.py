"""The demo robot's meshes: closed surfaces of the right size, served as COLLADA."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.demo.drive import Chassis
from rwt.extensions.demo.model.meshes import Visual, mesh_pages
from rwt.extensions.demo.model.shapes import Cuboid, Cylinder, Shape, Sphere
from rwt.extensions.demo.model.urdf import visuals
from rwt_transports.http.routes import HttpRequest, HttpResponse
from tests.page_readers import SeesNothing

NAMESPACE = {"c": "http://www.collada.org/2005/11/COLLADASchema"}
lengths = st.floats(0.01, 10.0)
shapes = st.one_of(
    st.builds(Cuboid, lengths, lengths, lengths),
    st.builds(Cylinder, lengths, lengths),
    st.builds(Sphere, lengths),
)


def volume(shape: Shape) -> float:
    match shape:
        case Cuboid(x, y, z):
            return x * y * z
        case Cylinder(radius, length):
            return math.pi * radius**2 * length
        case Sphere(radius):
            return 4 / 3 * math.pi * radius**3


@given(shapes)
def test_a_surface_is_closed_and_faces_outwards(shape: Shape) -> None:
    surface = shape.surface()
    points, normals = np.array(surface.points), np.array(surface.normals)
    a, b, c = (points[[triangle[corner] for triangle in surface.triangles]] for corner in range(3))
    across = np.cross(b - a, c - a)
    # The volume by the divergence theorem is right only if every side is there and turned outwards. What has
    # corners is a little less than what is round.
    assert (a * across).sum() / 6 == pytest.approx(volume(shape), rel=0.05)
    assert np.allclose(np.abs(across.sum(axis=0)), 0, atol=1e-9)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    sides = np.linalg.norm(across, axis=1) > 1e-9
    facing = np.einsum("ij,ij->i", across, normals[[triangle[0] for triangle in surface.triangles]])
    assert (facing[sides] > 0).all()
    # All corners are on the shape and none beyond it.
    half = shape.element().attrib
    if isinstance(shape, Cuboid):
        assert np.allclose(
            np.abs(points), np.array([float(side) for side in half["size"].split()]) / 2, rtol=1e-4
        )
    else:
        assert np.hypot(points[:, 0], points[:, 1]).max() == pytest.approx(shape.radius)


def get(name: str) -> HttpResponse:
    [route] = mesh_pages(visuals(Chassis())).routes
    assert route.path == "/packages/rwt_demo/meshes/*"
    response = route.page(HttpRequest("GET", f"/packages/rwt_demo/meshes/{name}"), SeesNothing())
    assert isinstance(response, HttpResponse)
    return response


@pytest.mark.parametrize("link", visuals(Chassis()))
def test_each_link_has_a_file_in_its_colour(link: str) -> None:
    response = get(f"{link}.dae")
    assert (response.status, response.content_type) == (200, "model/vnd.collada+xml")
    assert isinstance(response.body, bytes)
    file = ET.fromstring(response.body)
    shone, lit = (
        [float(value) for value in (file.findtext(f".//c:{kind}/c:color", "", NAMESPACE)).split()]
        for kind in ("emission", "diffuse")
    )
    visual = visuals(Chassis())[link]
    assert [a + b for a, b in zip(shone[:3], lit[:3], strict=True)] == pytest.approx(visual.colour)
    triangles = file.find(".//c:triangles", NAMESPACE)
    assert triangles is not None
    indexes = [int(index) for index in triangles.findtext("c:p", "", NAMESPACE).split()]
    assert len(indexes) == 3 * int(triangles.get("count", "0")) == 3 * len(visual.shape.surface().triangles)
    for source in file.iterfind(".//c:source", NAMESPACE):
        array, accessor = source.find("c:float_array", NAMESPACE), source.find(".//c:accessor", NAMESPACE)
        assert array is not None and accessor is not None
        values = (array.text or "").split()
        assert len(values) == int(array.get("count", "0")) == 3 * int(accessor.get("count", "0"))
        assert max(indexes) == len(values) // 3 - 1


@pytest.mark.parametrize(
    "name", ["", "hand.dae", "base_link", "base_link.stl", "../base_link.dae", "tool_link.dae"]
)
def test_what_is_no_mesh_says_what_there_is(name: str) -> None:
    response = get(name)
    assert response.status == 404
    assert isinstance(response.body, bytes)
    assert response.body.startswith(f"package rwt_demo has no mesh {name!r}; it has base_link.dae ".encode())


def test_a_box_as_a_whole() -> None:
    """Four corners a side, two triangles, and the first side is the one at the back."""
    surface = Cuboid(2.0, 4.0, 6.0).surface()
    assert surface.triangles[:2] == [(0, 1, 2), (0, 2, 3)]
    assert surface.points[:4] == [(-1.0, 2.0, -3.0), (-1.0, -2.0, -3.0), (-1.0, -2.0, 3.0), (-1.0, 2.0, 3.0)]
    assert surface.normals[:4] == [(-1.0, 0.0, 0.0)] * 4
    assert Visual(Cuboid(2.0, 4.0, 6.0), (1.0, 0.0, 0.5)).collada().count("<color>0.5 0 0.25 1</color>") == 2
