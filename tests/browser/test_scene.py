"""Views of a robot in ros3d: map, scan, points, description with meshes, transforms, markers."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

import pytest

from rwt.extensions.demo.arm.kinematics import ARM
from rwt.extensions.meshes.mesh_files import MeshFiles
from rwt_graph import Node
from tests.browser.driver import Browser, near
from tests.browser.stand import Stand, stand
from tests.browser.test_map import FLOOR, SOLID

pytestmark = pytest.mark.anyio

BACKGROUND = (16, 16, 16)
RED, GREEN, BLUE = (255, 0, 0), (0, 255, 0), (0, 0, 255)
YELLOW, MAGENTA = (255, 255, 0), (255, 0, 255)
#: From straight above, ten metres high; not quite, as the camera's up would be undefined.
ABOVE = "camera=0,-0.1,12"


def scene(robot: Stand, show: str, *options: str) -> str:
    return f"{robot.url}test/scene.html?show={show}&{'&'.join(options or (ABOVE,))}"


def transform(parent: str, child: str, x: float, y: float, z: float = 0.0) -> Mapping[str, object]:
    return {
        "header": {"frame_id": parent},
        "child_frame_id": child,
        "transform": {"translation": {"x": x, "y": y, "z": z}, "rotation": {"w": 1.0}},
    }


def is_tinted(seen: tuple[int, int, int], colour: tuple[int, int, int]) -> bool:
    """Return True if points of `colour` were drawn there: ros3d draws points twice, which bleaches them."""
    bright = [value for value, full in zip(seen, colour, strict=True) if full]
    pale = [value for value, full in zip(seen, colour, strict=True) if not full]
    return min(bright) > 200 and max(pale) < min(bright) - 20


class Frames:
    """Publishes where frames are in the map; all of them each time, as only the last message is kept."""

    def __init__(self, node: Node) -> None:
        self._tf = node.advertise("/tf", "tf2_msgs/TFMessage", latch=True)
        self._frames: dict[str, Mapping[str, object]] = {}

    def put(self, child: str, x: float, y: float, z: float = 0.0) -> None:
        self._frames[child] = transform("map", child, x, y, z)
        self._tf.publish({"transforms": list(self._frames.values())})


async def test_the_map_lies_on_the_floor(browser: Browser) -> None:
    async with stand("noetic", browser.built) as robot, browser.page(scene(robot, "map")) as page:
        occupied = (100, 100, 100)
        picture = await page.picture_when("map 3d", lambda seen: seen.count(occupied, 5) > 5000)
        floor = [picture.at(*await page.pixel(*point)) for point in FLOOR]
        assert floor == [(0, 0, 0)] * len(FLOOR)
        assert [picture.at(*await page.pixel(*point)) for point in SOLID] == [occupied] * len(SOLID)


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
async def test_the_scan_lies_on_the_walls_that_the_laser_sees(browser: Browser, distro: str) -> None:
    async with stand(distro, browser.built) as robot, browser.page(scene(robot, "map,scan")) as page:
        hit = [(-4.9, -2.4), (-3.4, -3.9), (-1.1, -3.5), (-1.1, -1.5), (-4.4, -0.1)]
        missed = [(-3.4, -2.0), (-1.05, 2.0), (3.0, 3.0), (4.9, 3.0)]
        places = {point: await page.pixel(*point, 0.17) for point in hit + missed}
        picture = await page.picture_when(
            f"scan {distro}",
            lambda seen: all(is_tinted(seen.at(*places[point]), MAGENTA) for point in hit),
        )
        assert [point for point in missed if is_tinted(picture.at(*places[point]), MAGENTA)] == []


def cloud(patches: Mapping[tuple[float, float], int]) -> Mapping[str, object]:
    """`sensor_msgs/PointCloud2` of squares of a metre, each of one colour, 0xRRGGBB."""
    points = b"".join(
        struct.pack("<fffI", x + column / 20 - 0.5, y + row / 20 - 0.5, 0.0, colour)
        for (x, y), colour in patches.items()
        for column in range(21)
        for row in range(21)
    )
    fields = [
        {"name": name, "offset": 4 * index, "datatype": 7, "count": 1} for index, name in enumerate("xyz")
    ]
    return {
        "header": {"frame_id": "camera"},
        "height": 1,
        "width": len(points) // 16,
        "fields": [*fields, {"name": "rgb", "offset": 12, "datatype": 6, "count": 1}],
        "point_step": 16,
        "row_step": len(points),
        "data": points,
        "is_dense": True,
    }


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
async def test_points_have_their_places_and_colours(browser: Browser, distro: str) -> None:
    async with (
        stand(distro, browser.built, robot=False) as robot,
        browser.page(scene(robot, "cloud")) as page,
    ):
        Frames(robot.node).put("camera", 0.0, -1.0)
        points = robot.node.advertise("/cloud", "sensor_msgs/PointCloud2", latch=True)
        points.publish(cloud({(-2.0, 1.0): 0xFF0000, (0.0, 1.0): 0x00FF00, (2.0, 2.0): 0x0000FF}))
        there = {(-2, 0): RED, (0, 0): GREEN, (2, 1): BLUE}
        places = {point: await page.pixel(*point) for point in there}
        picture = await page.picture_when(
            f"cloud {distro}",
            lambda seen: all(is_tinted(seen.at(*places[point], 4), there[point]) for point in there),
        )
        assert near(picture.at(*await page.pixel(0, -2)), BACKGROUND)
        points.publish(cloud({(0.0, 1.0): 0xFFFF00}))
        picture = await page.picture_when(
            f"cloud {distro} later", lambda seen: is_tinted(seen.at(*places[0, 0], 4), YELLOW)
        )
        assert near(picture.at(*places[-2, 0], 4), BACKGROUND)


def stl_box(x: float, y: float, z: float) -> bytes:
    """A box around the origin as binary STL."""
    corners = [(a * x / 2, b * y / 2, c * z / 2) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [side[i:j] for side in sides for i, j in ((0, 3),)] + [
        (side[0], side[2], side[3]) for side in sides
    ]
    body = b"".join(
        struct.pack("<12fH", 0, 0, 0, *(value for corner in triangle for value in corners[corner]), 0)
        for triangle in triangles
    )
    return bytes(80) + struct.pack("<I", len(triangles)) + body


#: A square of 2 m by 2 m in yellow that needs no light.
DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="t"><phong>
<emission><color>1 1 0 1</color></emission><diffuse><color>0 0 0 1</color></diffuse></phong>
</technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">-1 -1 0 1 -1 0 1 1 0 -1 1 0</float_array><technique_common>
<accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 1 2 0 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"><bind_material>
<technique_common>
<instance_material symbol="m" target="#m"/></technique_common></bind_material></instance_geometry></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""

URDF = """<robot name="meshed">
<link name="base"><visual><geometry><mesh filename="package://meshed/meshes/body.stl"/></geometry>
<material name="red"><color rgba="1 0 0 0.9"/></material></visual></link>
<link name="flag"><visual><origin xyz="0 0 0.5"/>
<geometry><mesh filename="package://meshed/meshes/flag.dae" scale="0.5 0.5 0.5"/></geometry></visual></link>
<joint name="pole" type="fixed"><parent link="base"/><child link="flag"/></joint></robot>"""


async def test_a_robot_with_meshes_is_drawn_where_its_frames_are(browser: Browser, tmp_path: Path) -> None:
    meshes = tmp_path / "meshed/meshes"
    meshes.mkdir(parents=True)
    (meshes / "body.stl").write_bytes(stl_box(2.0, 1.0, 0.2))
    (meshes / "flag.dae").write_text(DAE)
    async with stand("noetic", browser.built, robot=False, http=[MeshFiles([tmp_path]).http]) as robot:
        robot.graph.parameters.set("/robot_description", URDF)
        frames = Frames(robot.node)
        async with browser.page(scene(robot, "robot")) as page:
            frames.put("base", -2.0, 0.0)
            frames.put("flag", 2.0, 1.0)
            picture = await page.picture_when(
                "urdf", lambda seen: seen.count(RED) > 500 and seen.count(YELLOW) > 300
            )
            assert near(picture.at(*await page.pixel(-2, 0, 0.1)), RED)
            assert near(picture.at(*await page.pixel(-1.1, 0, 0.1)), RED)
            assert near(picture.at(*await page.pixel(-2, 0.7, 0.1)), BACKGROUND)
            assert near(picture.at(*await page.pixel(2, 1, 0.5)), YELLOW)
            there = await page.pixel(-2, -2, 0.1)
            frames.put("base", -2.0, -2.0)
            picture = await page.picture_when("urdf moved", lambda seen: near(seen.at(*there), RED))
            assert near(picture.at(*await page.pixel(-2, 0, 0.1)), BACKGROUND)


#: Of the demo robot's links, in ros3d's dimmest light: half of them shines, a third of the rest is lit.
BODY, ARM_ORANGE, ARM_GREY = (34, 68, 136), (153, 85, 17), (145, 145, 145)


async def test_the_demo_robot_stands_where_it_is_in_its_colours(browser: Browser) -> None:
    """On the orange marker of the map, seen from above."""
    close = ("camera=-3.4,-2.6,3", "center=-3.4,-2.5,0")
    async with (
        stand("noetic", browser.built) as robot,
        browser.page(scene(robot, "robot,handles", *close)) as page,
    ):
        orange = (255, 140, 0)
        body = await page.pixel(-3.4, -2.4, 0.15)
        picture = await page.picture_when(
            "demo robot", lambda seen: seen.count(orange) > 200 and near(seen.at(*body), BODY, 15)
        )
        assert near(picture.at(*await page.pixel(-3.3, -2.58, 0.15)), BODY, 15)
        assert near(picture.at(*await page.pixel(-3.05, -2.5, 0.1)), orange)
        assert near(picture.at(*await page.pixel(-3.4, -2.86, 0.0)), (51, 89, 255))
        assert near(picture.at(*await page.pixel(-2.6, -2.5, 0.0)), BACKGROUND)


async def test_the_demo_robots_arm_is_seen_moving(browser: Browser) -> None:
    beside = ("camera=-2.7,-3.5,0.7", "center=-3.4,-2.5,0.25")
    async with stand("jazzy", browser.built) as robot, browser.page(scene(robot, "robot", *beside)) as page:
        # Where the upper arm and the forearm are when all joints are at 0, which is upright.
        upper, forearm = [await page.pixel(-3.52, -2.5, z) for z in (0.4, 0.5)]
        picture = await page.picture_when("demo arm", lambda seen: seen.count(ARM_ORANGE, 30) > 500)
        assert near(picture.at(*forearm), BACKGROUND)
        command = robot.node.advertise("/arm_controller/joint_trajectory", "trajectory_msgs/JointTrajectory")
        point = {"positions": [0.0] * len(ARM), "time_from_start": {"sec": 2}}
        command.publish({"joint_names": [joint.name for joint in ARM], "points": [point]})
        await page.picture_when(
            "demo arm up",
            lambda seen: (
                near(seen.at(*forearm), ARM_ORANGE, 30)
                and near(seen.at(*upper), ARM_GREY, 30)
                and near(seen.at(forearm[0] + 30, forearm[1]), BACKGROUND)
            ),
        )


async def test_axes_follow_a_frame(browser: Browser) -> None:
    async with stand("noetic", browser.built, robot=False) as robot:
        frames = Frames(robot.node)
        async with browser.page(scene(robot, "axes", ABOVE, "axes=gripper")) as page:
            for name, x, y in (("tf", -2.0, 1.0), ("tf moved", 1.0, -1.0)):
                frames.put("gripper", x, y)
                on_x, on_y = await page.pixel(x + 0.5, y, 0.1), await page.pixel(x, y + 0.5, 0.1)
                picture = await page.picture_when(
                    name,
                    lambda seen, on_x=on_x, on_y=on_y: (
                        _is_axis(seen.at(*on_x), 0) and _is_axis(seen.at(*on_y), 1)
                    ),
                )
                assert near(picture.at(*await page.pixel(x - 1.0, y)), BACKGROUND)


def _is_axis(colour: tuple[int, int, int], channel: int) -> bool:
    """Return True if a colour is red, or green, in any light."""
    others = [value for index, value in enumerate(colour) if index != channel]
    return colour[channel] > 60 and max(others) < 30


def marker(
    id: int, x: float, y: float, colour: tuple[float, float, float], **fields: object
) -> dict[str, object]:
    """A `visualization_msgs/Marker` of a metre; not quite opaque, so that no lamp changes its colour."""
    return {
        "header": {"frame_id": "map"},
        "ns": "test",
        "id": id,
        "type": 1,
        "pose": {"position": {"x": x, "y": y}, "orientation": {"w": 1.0}},
        "scale": {"x": 1.0, "y": 1.0, "z": 0.1},
        "color": dict(zip("rgba", (*colour, 0.9), strict=True)),
        **fields,
    }


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
async def test_markers_come_move_and_go(browser: Browser, distro: str) -> None:
    async with (
        stand(distro, browser.built, robot=False) as robot,
        browser.page(scene(robot, "marker,markers")) as page,
    ):
        Frames(robot.node).put("base", 0.0, 0.0)
        one = robot.node.advertise("/marker", "visualization_msgs/Marker", latch=True)
        several = robot.node.advertise("/markers", "visualization_msgs/MarkerArray", latch=True)
        one.publish(marker(1, -2, 1, (1, 0, 0)))
        several.publish(
            {"markers": [marker(1, 0, 0, (0, 1, 0), type=2), marker(2, 2, -1, (0, 0, 1), type=3)]}
        )
        picture = await page.picture_when(
            f"markers {distro}",
            lambda seen: min(seen.count(colour) for colour in (RED, GREEN, BLUE)) > 300,
        )
        assert near(picture.at(*await page.pixel(-2, 1)), RED)
        assert near(picture.at(*await page.pixel(-2.4, 1.4)), RED)
        assert near(picture.at(*await page.pixel(0, 0)), GREEN)
        assert near(picture.at(*await page.pixel(0.45, 0.45)), BACKGROUND)
        assert near(picture.at(*await page.pixel(2, -1)), BLUE)
        one.publish(marker(1, -2, -1, (1, 0, 0)))
        several.publish({"markers": [{"ns": "test", "id": 2, "action": 2}]})
        there = await page.pixel(-2, -1)
        picture = await page.picture_when(
            f"markers {distro} later", lambda seen: near(seen.at(*there), RED) and seen.count(BLUE) == 0
        )
        assert near(picture.at(*await page.pixel(-2, 1)), BACKGROUND)
        assert near(picture.at(*await page.pixel(0, 0)), GREEN)
