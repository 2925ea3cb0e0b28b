"""A robot that is driven from the keyboard, seen in its map."""

from __future__ import annotations

import pytest

from tests.browser.driver import Browser, Picture
from tests.browser.stand import stand
from tests.waiting import until

pytestmark = pytest.mark.anyio

RED = (255, 0, 0)


def metres(picture: Picture) -> tuple[float, float]:
    """Where the red arrow is in the map, of which 50 pixels are a metre."""
    across, down = picture.centre(RED, 60)
    return (across - 250) / 50, (200 - down) / 50


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
async def test_arrow_keys_drive_the_robot_over_its_map(browser: Browser, distro: str) -> None:
    speeds: list[float] = []
    async with (
        stand(distro, browser.built) as robot,
        browser.page(f"{robot.url}test/teleop.html") as page,
    ):
        robot.node.subscribe("/odom", lambda odom: speeds.append(odom.twist.twist.linear.x))
        await page.wait("state.map && state.robot")
        picture = await page.picture_when(f"teleop {distro}", lambda seen: seen.count(RED, 60) > 40)
        # The arrow begins where the robot is and is half a metre long.
        assert metres(picture) == pytest.approx((-3.1, -2.5), abs=0.15)
        await page.keyboard("down", "ArrowUp")
        await page.picture_when("teleop forth", lambda seen: metres(seen)[0] > -2.7)
        await page.keyboard("down", "ArrowLeft")
        await page.picture_when(f"teleop turn {distro}", lambda seen: metres(seen)[1] > -2.2)
        # On a slow machine the robot may stand at a wall by the time that it is seen.
        assert max(speeds) == pytest.approx(0.6)
        await page.keyboard("up", "ArrowLeft")
        await page.keyboard("up", "ArrowUp")
        await until(lambda: speeds[-1] == 0.0)
