"""The simulated Husky with its arm in ros3d: its meshes with their colours, and how they move."""

from __future__ import annotations

import numpy as np
import pytest

from rwt.extensions.demo.world.lens import Lens
from rwt.extensions.meshes.mesh_files import MeshFiles
from tests.browser.driver import Browser, Picture, Pixels
from tests.browser.stand import stand

pytest.importorskip("pybullet", reason="PyBullet has wheels for Linux only")

from husky_xarm.arm import ACTION
from husky_xarm.description import ARM_JOINTS, PACKAGE_FOLDERS
from husky_xarm.robot import HuskyXArm

pytestmark = pytest.mark.anyio

CLOSE = "show=robot&frame=odom&camera=1.3,-2.0,1.5&center=0,0,0.55"


def parts(seen: Picture) -> dict[str, Pixels]:
    """Where the base's plate and the arm's links are, by their hues: the lamp of ros3d makes them dark."""
    red, green, blue = np.moveaxis(seen.pixels, 2, 0)
    return {
        "yellow": (np.minimum(red, green) > 3 * blue) & (red > 40) & (abs(red - green) < 20),
        "red": (red > 2 * np.maximum(green, blue)) & (red > 40),
        "green": (green > 1.5 * np.maximum(red, blue)) & (green > 40),
        "blue": (blue > 1.5 * np.maximum(red, green)) & (blue > 40),
    }


def is_all_there(seen: Picture) -> bool:
    return all(part.sum() > 150 for part in parts(seen).values())


def hand(seen: Picture) -> float:
    """The column of the green link, which is near the hand."""
    return float(np.nonzero(parts(seen)["green"])[1].mean())


async def test_the_husky_stands_there_in_its_colours_and_lifts_its_arm(browser: Browser) -> None:
    http = [MeshFiles(PACKAGE_FOLDERS).http]
    async with stand("jazzy", browser.built, robot=False, http=http) as robot:
        husky = HuskyXArm(robot.graph, Lens(160, 120), camera_rate=1.0)
        async with browser.page(f"{robot.url}test/scene.html?{CLOSE}", 500, 400) as page:
            before = await page.picture_when("husky", is_all_there)
            point = {"positions": [1.2, -0.3, -0.9, 0.0, 1.3, 0.0], "time_from_start": {"sec": 1}}
            trajectory = {"joint_names": ARM_JOINTS, "points": [point]}
            await (await robot.node.send_goal(ACTION, {"trajectory": trajectory})).result()
            await page.picture_when(
                "husky moved",
                lambda seen: is_all_there(seen) and abs(hand(seen) - hand(before)) > 20,
            )
        husky.close()
