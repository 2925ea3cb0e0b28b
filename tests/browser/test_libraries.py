"""Pages that use the libraries of `/lib/` as they used the content delivery network of Robot Web Tools.

The pages lie on another server than the robot, as pages that used it did.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rwt import Server
from rwt.extensions.dashboard import find_static_files
from tests.browser.driver import HERE, Browser, Picture, near
from tests.browser.stand import REGISTRIES
from tests.docs.blocks import ROOT
from tests.docs.processes import Running, commands_folder
from tests.processes import free_port
from tests.waiting import until

pytestmark = pytest.mark.anyio

#: The markers that NAV2D draws, on white: the robot is orange, the goal pink, a direction green.
ORANGE, PINK, GREEN = (255, 171, 87), (255, 129, 171), (87, 255, 87)
RED, BLUE = (255, 0, 0), (0, 0, 255)


@contextmanager
def site(tmp_path: Path, page: str, robot: int) -> Iterator[str]:
    """The URL of a page on a plain web server, which takes its scripts from a robot at a port."""
    text = (HERE / "pages" / "dropin" / page).read_text(encoding="utf-8").replace("9090", str(robot))
    (tmp_path / page).write_text(text, encoding="utf-8")
    port = free_port()
    command = [sys.executable, "-m", "http.server", str(port), "--bind", "127.0.0.1"]
    with Running(command, tmp_path, commands_folder(tmp_path / "commands")) as server:
        server.wait_for_port(port)
        yield f"http://127.0.0.1:{port}/{page}"


def port_of(server: Server) -> int:
    return int(server.urls[0].rsplit(":", 1)[1])


def test_the_documentation_lists_what_is_built() -> None:
    files = find_static_files()
    assert files is not None, "the page is not built: npm run --prefix web build"
    built = [
        [re.sub(r"<[^>]+>", "", cell) for cell in row.split("<td>")[1:5]]
        for row in re.findall(r"<tr><td>.*", files["lib/index.html"].path.read_text(encoding="utf-8"))
    ]
    page = (ROOT / "docs" / "reference" / "libraries.md").read_text(encoding="utf-8")
    documented = [
        [cell.strip().replace("`", "") for cell in row.strip("|").split("|")]
        for row in re.findall(r"^\| `.*\|$", page, re.MULTILINE)
    ]
    assert documented == [
        [name, release, name_of_global, "" if needs == "-" else needs.replace(".min.js", "")]
        for name, release, name_of_global, needs in built
    ]
    assert {f"lib/{name}" for name, *_ in built} == {
        name for name in files if name.startswith("lib/") and name.endswith(".js")
    }


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
async def test_keyboardteleop_drives_while_a_key_is_held(
    browser: Browser, distro: str, tmp_path: Path
) -> None:
    commands: list[tuple[float, float]] = []
    async with Server("ws://127.0.0.1:0", registry=REGISTRIES[distro]) as server:
        server.node("test").subscribe(
            "/base_controller/command",
            lambda twist: commands.append((twist.linear.x, twist.angular.z)),
            "geometry_msgs/Twist",
        )
        with site(tmp_path, "keyboardteleop.html", port_of(server)) as url:
            async with browser.page(url) as page:
                await page.wait("ros.isConnected")
                await page.keyboard("down", "ArrowUp")
                await until(lambda: len(commands) > 3)
                await page.keyboard("down", "a")
                await until(lambda: commands[-1] == (0.45, 0.9))
                assert set(commands) == {(0.45, 0.0), (0.45, 0.9)}
                await page.wait("said.textContent === 'drives at 0.45'")
                # A page that loses the keyboard does not hear that its keys are let go.
                await page.evaluate("dispatchEvent(new Event('blur'))")
                await until(lambda: commands[-1] == (0.0, 0.0))
                await page.keyboard("up", "a")
                await page.keyboard("up", "ArrowUp")
                sent = len(commands)
                await page.keyboard("down", "s")
                await until(lambda: len(commands) > sent)
                assert commands[sent:][0] == (-0.45, 0.0)
                await page.evaluate("ros.close()")
                await page.wait("!ros.isConnected")


def goal_of(path: Any) -> tuple[float, float, float]:
    """Where a `nav_msgs/Path` leads: x, y and heading."""
    pose = path.poses[-1].pose
    return pose.position.x, pose.position.y, 2 * math.atan2(pose.orientation.z, pose.orientation.w)


def metres(picture: Picture, colour: tuple[int, int, int]) -> tuple[float, float]:
    """Where a marker is in the map, of which 50 pixels are a metre."""
    across, down = picture.centre(colour, 30)
    return (across - 250) / 50, (200 - down) / 50


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
async def test_nav2d_sends_the_robot_to_where_the_map_is_clicked(
    browser: Browser, distro: str, tmp_path: Path
) -> None:
    async with Server("ws://127.0.0.1:0", registry=REGISTRIES[distro], demo=True) as server:
        plans: list[tuple[float, float, float]] = []
        server.node("test").subscribe("/plan", lambda path: plans.append(goal_of(path)))
        with site(tmp_path, "nav2d.html", port_of(server)) as url:
            async with browser.page(url) as page:
                begins = await page.picture_when(f"nav2d {distro}", lambda seen: seen.count(ORANGE, 30) > 30)
                assert metres(begins, ORANGE) == pytest.approx((-3.4, -2.5), abs=0.2)
                await page.mouse("dblclick", 250 - 90, 200 + 125)
                await until(lambda: bool(plans))
                assert plans[0] == pytest.approx((-1.8, -2.5, 0.0), abs=0.05)
                await page.picture_when("nav2d goal", lambda seen: seen.count(PINK, 30) > 10)

                def arrived(seen: Picture) -> bool:
                    # The mark goes with the goal, and the robot is where the mark was.
                    return seen.count(PINK, 30) == 0 and metres(seen, ORANGE) == pytest.approx(
                        (-1.8, -2.5), abs=0.35
                    )

                await page.picture_when("nav2d arrived", arrived)


async def test_nav2d_takes_a_direction(browser: Browser, tmp_path: Path) -> None:
    async with Server("ws://127.0.0.1:0", registry=REGISTRIES["jazzy"], demo=True) as server:
        plans: list[tuple[float, float, float]] = []
        server.node("test").subscribe("/plan", lambda path: plans.append(goal_of(path)))
        with site(tmp_path, "nav2d.html", port_of(server)) as url:
            async with browser.page(f"{url}?orientation") as page:
                await page.picture_when("nav2d direction begins", lambda seen: seen.count(ORANGE, 30) > 30)
                await page.mouse("move", 250 - 90, 200 + 125)
                await page.mouse("down")
                await page.mouse("move", 250 - 90, 200 + 75, {"steps": 4})
                await page.picture_when("nav2d direction", lambda seen: seen.count(GREEN, 30) > 10)
                await page.mouse("up")
                await until(lambda: bool(plans))
                assert plans[0] == pytest.approx((-1.8, -2.5, math.pi / 2), abs=0.1)


def plain(colour: tuple[int, int, int]) -> dict[str, object]:
    """`sensor_msgs/Image` of one colour."""
    pixels = np.full((48, 64, 3), colour, np.uint8)
    return {"height": 48, "width": 64, "encoding": "rgb8", "step": 192, "data": pixels.tobytes()}


async def test_mjpegcanvas_shows_cameras_and_changes_between_them(browser: Browser, tmp_path: Path) -> None:
    async with Server("ws://127.0.0.1:0", registry=REGISTRIES["jazzy"]) as server:
        node = server.node("test")
        cameras = {
            name: node.advertise(f"{name}/image_color", "sensor_msgs/Image")
            for name in ("/wide_stereo/left", "/l_forearm_cam")
        }
        node.create_timer(0.1, lambda: cameras["/wide_stereo/left"].publish(plain(RED)))
        node.create_timer(0.1, lambda: cameras["/l_forearm_cam"].publish(plain(BLUE)))

        def shows(picture: Picture, lower: tuple[int, int, int]) -> bool:
            return near(picture.at(160, 120), RED) and near(picture.at(160, 360), lower)

        with site(tmp_path, "mjpegcanvas.html", port_of(server)) as url:
            async with browser.page(url, 400, 520) as page:
                await page.picture_when("mjpegcanvas", lambda seen: shows(seen, BLUE))
                await page.keyboard("press", "Tab")
                await page.keyboard("press", "Enter")
                await page.wait("document.activeElement.name === 'stream'")
                await page.keyboard("press", "ArrowDown")
                await page.keyboard("press", "Tab")
                await page.keyboard("press", "Enter")
                await page.picture_when("mjpegcanvas changed", lambda seen: shows(seen, RED))
                assert await page.evaluate("heard") == ["/wide_stereo/left/image_color"]
