"""The map, by ros2d on roslib 2 and by ros3d on roslib 1."""

from __future__ import annotations

import pytest

from tests.browser.driver import Browser
from tests.browser.stand import stand

pytestmark = pytest.mark.anyio

WHITE, BLACK = (255, 255, 255), (0, 0, 0)
#: Points of the demo's house in metres, and whether something solid is there.
FLOOR = [(-3.4, -2.5), (0.5, 2.0), (3.0, 0.0), (-1.05, -2.5), (2.7, 1.25)]
SOLID = [(-1.05, 0.5), (-4.0, 2.0), (4.5, 3.4), (3.9, -2.3), (2.2, -3.7), (4.96, 0.0)]


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
async def test_ros2d_draws_the_map_over_png(browser: Browser, distro: str) -> None:
    async with (
        stand(distro, browser.built) as robot,
        browser.page(f"{robot.url}test/map2d.html") as page,
    ):
        await page.wait("state.map")
        picture = await page.picture_when(f"map 2d {distro}", lambda seen: seen.count(WHITE, 5) > 50_000)

        def colour(x: float, y: float) -> tuple[int, int, int]:
            # 10 m by 8 m on 500 by 400 pixels, the origin in the middle.
            return picture.at(250 + 50 * x, 200 - 50 * y)

        assert {point: colour(*point) for point in FLOOR} == dict.fromkeys(FLOOR, WHITE)
        assert {point: colour(*point) for point in SOLID} == dict.fromkeys(SOLID, BLACK)
