"""`ROS3D.DepthCloud` with depth and colour in one video."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import quote

import numpy as np
import pytest

from rwt.extensions.demo.world.lens import Lens
from rwt.extensions.depth_cloud import DepthCloudEncoder
from rwt_graph import Node
from rwt_participant.qos import SENSOR_DATA
from tests.browser.driver import Browser, Page, Picture, near
from tests.browser.stand import stand
from tests.browser.test_scene import BACKGROUND, BODY, Frames, scene

pytestmark = pytest.mark.anyio

SIZE = 256
"""Rows and columns of the camera, which is also its focal length: at 1 m it sees one metre."""
TILE = 1.5
"""Metres of depth in one tile."""


@dataclass(frozen=True)
class Patch:
    """A square before the wall, or in it: its middle and half its edge at its depth, metres."""

    x: float
    y: float
    depth: float
    colour: tuple[int, int, int]
    half: float = 0.2

    def place(self, across: float, down: float) -> tuple[float, float, float]:
        """A point of it, from -1 to 1 either way, as the camera has it: right, down, forwards."""
        return self.x + across * self.half, self.y + down * self.half, self.depth


WALL = Patch(0.0, 0.0, 2.4, (60, 60, 200), 1.2)
#: In the near tile, on the seam of both, in the far one.
PATCHES = (
    Patch(-0.2, -0.2, 1.0, (220, 40, 40)),
    Patch(0.4, 0.3, 1.5, (40, 200, 40)),
    Patch(-0.6, 0.6, 2.0, (220, 200, 40), 0.25),
)
#: Where the depth camera measures nothing.
HOLE = Patch(0.7, -0.7, 2.4, (255, 255, 255), 0.3)


class Camera:
    """Sees the patches, and noise along the lower edge: a player begins to play after so many bytes."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._depths = node.advertise("/depth", "sensor_msgs/Image", qos=SENSOR_DATA)
        self._colours = node.advertise("/colour", "sensor_msgs/Image", qos=SENSOR_DATA)
        self._random = np.random.default_rng(1)
        node.create_timer(1 / 15, self._shoot)

    def _shoot(self) -> None:
        depth = np.empty((SIZE, SIZE), np.uint16)
        colour = np.empty((SIZE, SIZE, 3), np.uint8)
        for patch in (WALL, *PATCHES, HOLE):
            (left, top), (right, bottom) = (
                [round(SIZE * (value / patch.depth + 0.5)) for value in patch.place(end, end)[:2]]
                for end in (-1, 1)
            )
            depth[top:bottom, left:right] = 0 if patch is HOLE else round(1000 * patch.depth)
            colour[top:bottom, left:right] = patch.colour
        colour[-16:] = self._random.integers(0, 256, (16, SIZE, 3), np.uint8)
        now = self._node.clock.time_ns()
        stamp = {"sec": now // 10**9, "nanosec": now % 10**9}
        for topic, pixels, encoding in ((self._depths, depth, "16UC1"), (self._colours, colour, "rgb8")):
            topic.publish(
                {
                    "header": {"stamp": stamp, "frame_id": "eye"},
                    "height": SIZE,
                    "width": SIZE,
                    "encoding": encoding,
                    "step": pixels.nbytes // SIZE,
                    "data": pixels.tobytes(),
                }
            )


def asked(kind: str, *, frame: str, f: float, tile: float) -> list[str]:
    """The depth cloud's part of a scene's address."""
    finely = {"mjpeg": "quality=90", "vp8": "bitrate=4000000&qmin=4"}[kind]
    stream = f"/stream?topic=/depthcloud_encoded&type={kind}&{finely}"
    return [f"type={kind}", f"stream={quote(stream)}", f"optical={frame}", f"f={f:.1f}", f"tile={tile}"]


async def is_there(page: Page, picture: Picture, patch: Patch) -> bool:
    """Return True if the patch is where it should be, and ends where it should."""
    inside = [patch.place(a, b) for a in (-0.75, 0.0, 0.75) for b in (-0.75, 0.0, 0.75)]
    outside = [patch.place(*at) for at in ((-1.3, 0), (1.3, 0), (0, -1.3), (0, 1.3))]
    seen = [picture.at(*await page.pixel(*point)) for point in inside]
    beside = [picture.at(*await page.pixel(*point)) for point in outside]
    return all(near(each, patch.colour, 60) for each in seen) and not any(
        near(each, patch.colour, 60) for each in beside
    )


@pytest.mark.parametrize("kind", ["mjpeg", "vp8"])
async def test_points_are_where_the_depth_camera_saw_them(browser: Browser, kind: str) -> None:
    beside = ("camera=2.2,-2.0,-1.0", "center=0,0,1.7")
    async with stand("noetic", browser.built, robot=False) as robot:
        Frames(robot.node).put("eye", 0.0, 0.0)
        Camera(robot.node)
        DepthCloudEncoder(
            robot.graph, "/depth", "/colour", crop_size=SIZE, target_resolution=SIZE, max_depth_per_tile=TILE
        )
        options = asked(kind, frame="eye", f=125, tile=TILE)
        async with browser.page(scene(robot, "depthcloud", *beside, *options)) as page:
            picture = await page.picture_when(
                f"depth cloud {kind}",
                lambda seen: min(seen.count(patch.colour, 60) for patch in PATCHES) > 200,
            )
            for patch in PATCHES:
                assert await is_there(page, picture, patch), patch
            assert near(picture.at(*await page.pixel(*WALL.place(0, -0.8))), WALL.colour, 60)
            assert near(picture.at(*await page.pixel(*HOLE.place(0, 0))), BACKGROUND)


async def test_the_demo_robot_sees_walls_where_the_map_has_them(browser: Browser) -> None:
    behind = ("camera=-5.4,-4.3,1.9", "center=-2.2,-2.3,0.5")
    lens = Lens()
    options = asked("vp8", frame="camera_optical_frame", f=125 * lens.focal / lens.height, tile=3.0)
    async with (
        stand("jazzy", browser.built) as robot,
        browser.page(scene(robot, "map,robot,depthcloud", *behind, *options)) as page,
    ):
        # On both sides of a door in the wall at x = -1.1, and its opening between them.
        violet, yellow = [await page.pixel(-1.1, y, 0.6) for y in (-1.9, -3.1)]
        opening = [await page.pixel(-1.1, y, 0.6) for y in (-2.1, -2.9)]
        picture = await page.picture_when(
            "demo depth cloud",
            lambda seen: _is_violet(seen.at(*violet)) and _is_yellow(seen.at(*yellow)),
        )
        assert not any(_is_violet(picture.at(*at)) or _is_yellow(picture.at(*at)) for at in opening)
        assert picture.count(BODY, 15) > 300


def _is_violet(colour: tuple[int, int, int]) -> bool:
    red, green, blue = colour
    return blue > red > green + 10


def _is_yellow(colour: tuple[int, int, int]) -> bool:
    red, green, blue = colour
    return red > green > blue + 30
