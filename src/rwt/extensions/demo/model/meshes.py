"""Visuals of the robot as COLLADA files over HTTP, generated on request.

`ros3d` ignores materials of boxes, cylinders and spheres in a URDF; only meshes have colours.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from rwt.extensions.demo.model.shapes import Shape, text
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route

#: Package of the meshes.
PACKAGE: Final = "rwt_demo"
#: Path at which :mod:`rwt.extensions.meshes.mesh_files` would serve it.
PATH: Final = f"/packages/{PACKAGE}/meshes/"

#: Ambient share of a surface's colour: viewers have one lamp or none.
_GLOW: Final = 0.5

_DAE: Final = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_effects><effect id="paint"><profile_COMMON><technique sid="common"><phong>
<emission><color>{glow}</color></emission><diffuse><color>{diffuse}</color></diffuse>
</phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="material"><instance_effect url="#paint"/></material></library_materials>
<library_geometries><geometry id="shape"><mesh>
{points}{normals}<vertices id="corners"><input semantic="POSITION" source="#points"/></vertices>
<triangles count="{count}" material="material"><input semantic="VERTEX" source="#corners" offset="0"/>
<input semantic="NORMAL" source="#normals" offset="0"/><p>{triangles}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="scene"><node><instance_geometry url="#shape"><bind_material>
<technique_common><instance_material symbol="material" target="#material"/></technique_common>
</bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene>
</COLLADA>
"""
_SOURCE: Final = """<source id="{name}">
<float_array id="{name}-array" count="{numbers}">{values}</float_array>
<technique_common><accessor source="#{name}-array" count="{count}" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
"""


@dataclass(frozen=True, slots=True)
class Visual:
    """Shape and colour of a link.

    Attributes:
        colour: red, green and blue, 0 … 1.
    """

    shape: Shape
    colour: tuple[float, float, float]

    def collada(self) -> str:
        """Return the mesh as a COLLADA document."""
        surface = self.shape.surface()
        return _DAE.format(
            glow=_colour(self.colour, _GLOW),
            diffuse=_colour(self.colour, 1 - _GLOW),
            points=_source("points", surface.points),
            normals=_source("normals", surface.normals),
            count=len(surface.triangles),
            triangles=" ".join(str(index) for triangle in surface.triangles for index in triangle),
        )


def mesh_pages(visuals: Mapping[str, Visual]) -> HttpExtension:
    """Return the extension for :func:`rwt.serve` with one COLLADA file for each link."""

    def page(request: HttpRequest, reader: Reader) -> HttpResponse:
        name = request.path.removeprefix(PATH)
        visual = visuals.get(name.removesuffix(".dae"))
        if visual is None or not name.endswith(".dae"):
            known = " ".join(f"{link}.dae" for link in visuals)
            return HttpResponse(f"package {PACKAGE} has no mesh {name!r}; it has {known}\n".encode(), 404)
        return HttpResponse(visual.collada().encode(), content_type="model/vnd.collada+xml")

    # As in rwt.extensions.meshes.mesh_files: the appearance of a robot needs no right to one topic.
    return HttpExtension((Route(f"{PATH}*", page, Audience.ADMITTED),))


def mesh_url(link: str) -> str:
    """Return the ``package://`` URL of a link's mesh."""
    return f"package://{PACKAGE}/meshes/{link}.dae"


def _colour(colour: Iterable[float], share: float) -> str:
    return " ".join(text(value * share) for value in colour) + " 1"


def _source(name: str, vectors: Iterable[tuple[float, float, float]]) -> str:
    values = [text(value) for vector in vectors for value in vector]
    count = len(values)
    return _SOURCE.format(name=name, numbers=count, values=" ".join(values), count=count // 3)
