"""The 3D panel of the robot's page: every type of marker, updates of maps, markers that are dragged."""

from __future__ import annotations

import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from rwt import Server
from rwt.extensions.markers import (
    Colour,
    Event,
    Feedback,
    InteractiveMarkerServer,
    box,
    interactive_marker,
    move_plane,
)
from rwt_graph import Node
from tests.browser.driver import Browser, Page, Picture, Size
from tests.browser.test_panels import open_panels, text
from tests.waiting import until

pytestmark = pytest.mark.anyio

DISTROS = pytest.mark.parametrize("distro", ["jazzy", "noetic"])
SIZE: Size = {"width": 900, "height": 760}
#: What the markers are coloured: nothing else in the view is.
MAGENTA = {"r": 1.0, "g": 0.0, "b": 1.0, "a": 1.0}
ORIGIN = {"x": 0.0, "y": 0.0, "z": 0.0}
UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
ACROSS = [{"x": -0.4, "y": 0.0, "z": 0.0}, {"x": 0.4, "y": 0.0, "z": 0.0}]
TRIANGLE = [{"x": -0.4, "y": -0.4, "z": 0.0}, {"x": 0.4, "y": -0.4, "z": 0.0}, {"x": 0.0, "y": 0.4, "z": 0.0}]
#: By type: its scale, and its points. All of them cover the place that they are at.
MARKERS: dict[int, tuple[tuple[float, float, float], list[dict[str, float]]]] = {
    0: ((0.9, 0.4, 0.4), []),
    1: ((0.6, 0.6, 0.6), []),
    2: ((0.6, 0.6, 0.6), []),
    3: ((0.6, 0.6, 0.2), []),
    4: ((0.3, 0.0, 0.0), ACROSS),
    5: ((0.3, 0.0, 0.0), ACROSS),
    6: ((0.5, 0.5, 0.5), [ORIGIN]),
    7: ((0.5, 0.5, 0.5), [ORIGIN]),
    8: ((0.4, 0.4, 0.0), [ORIGIN]),
    9: ((0.0, 0.0, 0.4), []),
    10: ((0.6, 0.6, 0.6), []),
    11: ((1.0, 1.0, 1.0), TRIANGLE),
    12: ((0.3, 0.4, 0.1), ACROSS),
}
TEXT = 9


def place(type: int) -> tuple[float, float]:
    """Where a marker of a type is: in rows of five."""
    return 1.3 * (type % 5 - 2), 1.3 * (1 - type // 5)


def marker(type: int, **fields: object) -> dict[str, Any]:
    scale, points = MARKERS.get(type, ((1.0, 1.0, 1.0), []))
    x, y = place(type)
    return {
        "header": {"frame_id": "map"},
        "ns": "test",
        "id": type,
        "type": type,
        "pose": {"position": {"x": x, "y": y, "z": 0.0}, "orientation": UPRIGHT},
        "scale": dict(zip("xyz", scale, strict=True)),
        "color": MAGENTA,
        "points": points,
        "text": "<b>label</b>",
        "mesh_resource": "package://shapes/plate.stl",
        **fields,
    }


def write_plate(folder: Path) -> None:
    """A package with a square of a metre as a mesh."""
    corners = [(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)]
    facets = [(corners[0], corners[1], corners[2]), (corners[0], corners[2], corners[3])]
    mesh = bytes(80) + struct.pack("<I", len(facets))
    for facet in facets:
        mesh += struct.pack("<12fH", 0, 0, 1, *(number for corner in facet for number in corner), 0)
    (folder / "shapes").mkdir()
    (folder / "shapes" / "package.xml").write_text("<package><name>shapes</name></package>")
    (folder / "shapes" / "plate.stl").write_bytes(mesh)


@asynccontextmanager
async def scene_from_above(
    browser: Browser, distro: str, folder: Path, **config: object
) -> AsyncIterator[tuple[Node, Page]]:
    """A robot that is nothing but a frame, and the 3D panel above it."""
    write_plate(folder)
    async with (
        Server("ws://127.0.0.1:0", distro=distro, packages=[folder]) as server,
        browser.page(f"{server.urls[0].replace('ws', 'http', 1)}/healthz", **SIZE) as page,
    ):
        node = server.node("test")
        frame = {
            "header": {"frame_id": "map"},
            "child_frame_id": "base_link",
            "transform": {"rotation": UPRIGHT},
        }
        node.advertise("/tf_static", "tf2_msgs/TFMessage", latch=True).publish({"transforms": [frame]})
        await open_panels(page, server.urls[0].replace("ws", "http", 1) + "/", [("scene", config)])
        await page.wait("document.querySelector('.scene-view')?.robotScene?.base")
        # What the server says comes into the heading, and may move what is below.
        await page.wait(f"{text('header')}.includes('admin')")
        await page.wait(f"{text('header')}.includes('ROS ')")
        await page.click("button:has-text('Top view')")
        yield node, page


async def pixel(page: Page, x: float, y: float) -> tuple[float, float]:
    """Where a point of the ground is drawn."""
    spot = await page.evaluate(
        "(({ view }) => { const at = view.controls.target.clone();"
        f" at.set({x}, {y}, 0); return view.pixel(at) }})(document.querySelector('.scene-view').robotScene)"
    )
    return spot["x"], spot["y"]


def is_magenta(picture: Picture, at: tuple[float, float]) -> bool:
    red, green, blue = picture.at(*at)
    return red > 90 and blue > 90 and green < 70


@DISTROS
async def test_every_type_of_marker_is_drawn_where_it_is(
    browser: Browser, distro: str, tmp_path: Path
) -> None:
    async with scene_from_above(browser, distro, tmp_path) as (node, page):
        publisher = node.advertise("/marks", "visualization_msgs/MarkerArray", latch=True)
        publisher.publish({"markers": [marker(type) for type in MARKERS]})
        await page.wait("document.querySelector('.scene-text')")
        spots = {type: await pixel(page, *place(type)) for type in MARKERS if type != TEXT}
        missing: list[int] = []

        def all_there(picture: Picture) -> bool:
            missing[:] = [type for type, at in spots.items() if not is_magenta(picture, at)]
            return not missing

        try:
            await page.picture_when(f"markers {distro}", all_there)
        except AssertionError as error:
            raise AssertionError(f"not drawn: {missing}") from error
        assert await page.evaluate(text(".scene-text")) == "<b>label</b>", "text, and no HTML"
        publisher.publish({"markers": [marker(1, action=2)]})
        await page.picture_when(f"markers without one {distro}", lambda seen: not is_magenta(seen, spots[1]))
        # One that there is not is said, and the others stay.
        publisher.publish({"markers": [marker(99)]})
        await page.wait(f"{text('.scene-problems')}.includes('/marks: there is no marker of type 99')")
        publisher.publish({"markers": [marker(2, pose={"position": {"x": float("nan")}})]})
        await page.wait(f"{text('.scene-problems')}.includes('has NaN or infinite numbers')")
        publisher.publish({"markers": [marker(3, action=3)]})
        await page.picture_when(
            f"no markers {distro}", lambda seen: not any(is_magenta(seen, at) for at in spots.values())
        )


@DISTROS
async def test_a_map_is_changed_by_updates_that_begin_later(
    browser: Browser, distro: str, tmp_path: Path
) -> None:
    layers = {"/global_costmap/costmap": True}
    async with scene_from_above(browser, distro, tmp_path, layers=layers) as (node, page):
        info = {
            "width": 40,
            "height": 40,
            "resolution": 0.1,
            "origin": {"position": {"x": -2.0, "y": -2.0}, "orientation": UPRIGHT},
        }
        grid = {"header": {"frame_id": "map"}, "info": info, "data": [0] * 1600}
        node.advertise("/map", "nav_msgs/OccupancyGrid", latch=True).publish(grid)
        node.advertise("/global_costmap/costmap", "nav_msgs/OccupancyGrid", latch=True).publish(grid)
        # Not on the lines of the ground, which are a metre apart.
        wall, cost = await pixel(page, -1.25, 0.45), await pixel(page, 1.25, 0.45)
        await page.picture_when(
            f"map {distro}", lambda seen: min(seen.at(*wall)) > 220 and min(seen.at(*cost)) > 220
        )
        update = {"header": {"frame_id": "map"}, "y": 10, "width": 10, "height": 20, "data": [100] * 200}
        updates = node.advertise("/map_updates", "map_msgs/OccupancyGridUpdate", latch=True)
        updates.publish({**update, "x": 5})
        costs = node.advertise("/global_costmap/costmap_updates", "map_msgs/OccupancyGridUpdate", latch=True)
        costs.publish({**update, "x": 25})

        def is_changed(seen: Picture) -> bool:
            red, green, blue = seen.at(*cost)
            return max(seen.at(*wall)) < 110 and green < 120 < min(red, blue)

        await page.picture_when(f"map updated {distro}", is_changed)
        updates.publish({**update, "x": 39})
        await page.wait(f"{text('.scene-problems')}.includes('the update\\'s width is 10; expected 0 to 1')")


@DISTROS
async def test_a_marker_is_dragged_and_its_program_hears_of_it(
    browser: Browser, distro: str, tmp_path: Path
) -> None:
    events: list[Feedback] = []
    async with scene_from_above(browser, distro, tmp_path) as (node, page):
        markers = InteractiveMarkerServer(node, "/slabs")
        slab = box((0.8, 0.8, 0.1), Colour(1.0, 0.0, 1.0, 1.0))
        markers.insert(interactive_marker("slab", controls=[move_plane("z", slab)]), events.append)
        markers.apply_changes()
        start, end = await pixel(page, 0, 0), await pixel(page, 1.5, 1.0)
        await page.picture_when(f"slab {distro}", lambda seen: is_magenta(seen, start))
        await page.drag((round(start[0]), round(start[1])), (round(end[0]), round(end[1])))
        await until(lambda: bool(events) and events[-1].event is Event.MOUSE_UP)
        assert [events[0].event, events[1].event] == [Event.MOUSE_DOWN, Event.POSE_UPDATE]
        at = markers.marker("slab").pose.position
        assert (at.x, at.y, at.z) == pytest.approx((1.5, 1.0, 0.0), abs=0.1)
        await page.picture_when(
            f"slab dragged {distro}", lambda seen: is_magenta(seen, end) and not is_magenta(seen, start)
        )


async def test_it_is_drawn_as_finely_as_is_chosen_and_whole_when_nothing_moves(
    browser: Browser, tmp_path: Path
) -> None:
    fineness = (
        "(({ view: { canvas } }) => canvas.width / canvas.clientWidth)"
        "(document.querySelector('.scene-view').robotScene)"
    )
    chosen = "document.querySelector('.scene-tools .menu .choice select')"
    async with scene_from_above(browser, "jazzy", tmp_path) as (node, page):
        publisher = node.advertise("/marks", "visualization_msgs/MarkerArray", latch=True)
        publisher.publish({"markers": [marker(1)]})
        # Without a graphics card what moves is drawn coarsely; what stands still is not.
        await page.wait(f"Math.abs({fineness} - devicePixelRatio) < 0.01")
        for quality, drawn in (("low", "0.5"), ("high", "devicePixelRatio")):
            await page.click("summary:has-text('Layers')")
            await page.wait(chosen)
            await page.evaluate(
                f"{chosen}.value = '{quality}';"
                f" {chosen}.dispatchEvent(new Event('change', {{ bubbles: true }}))"
            )
            await page.wait(f"Math.abs({fineness} - {drawn}) < 0.01")
            # Once it is drawn it has found the robot, and turned the camera to it.
            await page.wait(
                "(({ base, view }) => base && view.drawn)(document.querySelector('.scene-view').robotScene)"
            )
            await page.click("button:has-text('Top view')")
            spot = await pixel(page, *place(1))
            await page.picture_when(f"quality {quality}", lambda seen, spot=spot: is_magenta(seen, spot))
