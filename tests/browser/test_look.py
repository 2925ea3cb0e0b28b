"""The look of the dashboard, in sizes and themes and of each panel: compared with the documentation's images.

Set the environment variable RECORD to record the images anew.
"""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, nullcontext
from pathlib import Path
from typing import Any

import anyio
import numpy as np
import pytest
from PIL import Image

from rwt import Server
from rwt_participant.qos import LATCHED
from tests.browser.driver import LEFT_MESH, LEFT_STREAM, Browser, Page, Picture
from tests.browser.test_panels import KINDS, open_panels, texts, violations

pytestmark = pytest.mark.anyio

IMAGES = Path(__file__).parents[2] / "docs" / "images" / "dashboard"
SIZES = {"desktop": (1440, 900), "tablet": (1024, 768), "phone": (390, 844)}
PANEL_SIZE = (900, 560)
#: Panels with images, in which black is a colour as any other.
WITH_IMAGES = ("scene", "camera", "wall")
#: Black pixels of a picture at most: what is drawn without a colour of the theme is black.
MOST_BLACK = 20
#: Pixels on a side of the squares that are compared: smaller details, such as numbers, change.
SQUARE = 12
#: Share of squares that may differ by more than this, of 255: the robot's camera and rates do.
MOST_DIFFERENT = 0.06
DIFFERENT = 40
CONFIGS: dict[str, dict[str, object]] = {
    "teleop": {"topic": "/cmd_vel"},
    "topics": {"topic": "/odom"},
    "services": {"name": "/add_two_ints"},
    "actions": {"name": "/fibonacci"},
    "parameters": {"node": "/demo_robot"},
    "values": {"fields": [{"topic": "/battery_state", "path": "percentage"}]},
}
#: On a busy machine, camera images are late, and grey.
NO_OLD_IMAGE = "!document.querySelector('canvas.old')"
HAS_ROBOT = "document.querySelector('.scene-view')?.robotScene?.base"


@asynccontextmanager
async def satellites(server: Server, page: Page) -> AsyncIterator[None]:
    """Positions of a robot that drives around a block."""
    with server.node("gps") as node:
        receiver = node.advertise("/fix", "sensor_msgs/NavSatFix", qos=LATCHED)
        for step in range(16):
            north, east = min(step, 6), max(0, step - 6)
            receiver.publish(
                {
                    "latitude": 52.52 + 1e-4 * north,
                    "longitude": 13.4 + 2e-4 * east,
                    "altitude": 34.0,
                    "position_covariance": [4.0, 0, 0, 0, 4, 0, 0, 0, 9],
                    "position_covariance_type": 2,
                }
            )
            # The page has each one, and asked for the topic before the second.
            await page.wait("document.querySelector('.position .number')")
            await anyio.sleep(0.3)
        yield


def squares(picture: Image.Image) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the mean colours of small squares."""
    size = (max(1, picture.width // SQUARE), max(1, picture.height // SQUARE))
    return np.asarray(picture.convert("RGB").resize(size, Image.Resampling.BOX)).astype(float)


async def _before_recording(seconds: float) -> None:
    """Wait until an image shows what a reader should see; a comparison waits until the page looks like it."""
    if "RECORD" in os.environ:
        await anyio.sleep(seconds)


def looks_like(path: Path) -> Callable[[Picture], bool]:
    """Return a comparison with an image; on request, the image is recorded first."""

    def compare(seen: Picture) -> bool:
        with Image.open(seen.path) as picture:
            if "RECORD" in os.environ:
                path.parent.mkdir(exist_ok=True)
                picture.convert("RGB").quantize(192).save(path, optimize=True)
            with Image.open(path) as expected:
                if picture.size != expected.size:
                    return False
                difference = np.abs(squares(picture) - squares(expected)).max(axis=2)
        return bool((difference > DIFFERENT).mean() <= MOST_DIFFERENT)

    return compare


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("size", SIZES)
async def test_the_page_looks_as_in_the_documentation(browser: Browser, size: str, theme: str) -> None:
    async with Server("ws://127.0.0.1:0", demo=True) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", *SIZES[size]) as page:
            page.forgive(LEFT_MESH, LEFT_STREAM)
            await page.evaluate(f"localStorage.setItem('rwt-theme', {theme!r})")
            await page.goto(url)
            await page.wait(HAS_ROBOT)
            if size == "phone":
                await page.click("[role=tab] >> text=Drive")
            await _before_recording(6)  # Rates of topics are known after a while.
            await page.wait(NO_OLD_IMAGE)
            name = f"{size}-{theme}"
            await page.picture_when(f"look {name}", looks_like(IMAGES / f"{name}.png"))
            assert await violations(page) == []


def behind(kind: str, title: str, front: str) -> dict[str, Any]:
    """Return a dock with a panel in a tab behind another one."""
    titles = {front: front.capitalize(), kind: title}
    panels = {each: {"id": each, "contentComponent": each, "title": titles[each]} for each in titles}
    width, height = PANEL_SIZE
    leaf = {"type": "leaf", "data": {"id": "1", "views": [front, kind], "activeView": front}, "size": width}
    root = {"type": "branch", "data": [leaf], "size": height}
    grid = {"root": root, "width": width, "height": height, "orientation": "HORIZONTAL"}
    return {"grid": grid, "panels": panels, "activeGroup": "1"}


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("kind", KINDS)
async def test_every_panel_first_opens_as_in_the_documentation(
    browser: Browser, kind: str, theme: str
) -> None:
    """In a browser that has never had the page, the panel comes to the front from behind another one."""
    title = texts("en")[f"{kind}.title"]
    async with Server("ws://127.0.0.1:0", demo=True) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", *PANEL_SIZE) as page:
            page.forgive(LEFT_MESH, LEFT_STREAM)
            await page.evaluate(
                f"localStorage.setItem('rwt-theme', {theme!r}); localStorage.setItem('rwt-side', 'false')"
            )
            front = "battery" if kind != "battery" else "log"
            panels = [(front, {}), (kind, CONFIGS.get(kind, {}))]
            await open_panels(page, url, panels, dock=behind(kind, title, front))
            await page.click(f".dv-tab >> text='{title}'")
            await page.wait(f"document.querySelector('.panel-{kind}')?.children.length")
            if kind == "scene":
                await page.wait(HAS_ROBOT)
            async with satellites(server, page) if kind == "position" else nullcontext():
                await _before_recording(2)
                await page.wait(NO_OLD_IMAGE)
            name = f"{kind}-{theme}"
            picture = await page.picture_when(f"look {name}", looks_like(IMAGES / f"{name}.png"))
            assert kind in WITH_IMAGES or picture.count((0, 0, 0), 2) < MOST_BLACK
