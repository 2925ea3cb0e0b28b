"""Pictures and video of image topics, as browsers show them."""

from __future__ import annotations

import time

import numpy as np
import pytest

from bench.paper.camera import LATENCY_PAGE, mark
from rwt_graph import Node
from rwt_participant.qos import SENSOR_DATA
from tests.browser.driver import Browser, Picture, near
from tests.browser.stand import stand

pytestmark = pytest.mark.anyio

WIDTH, HEIGHT = 640, 480
_RANDOM = np.random.default_rng(1)
_NOISE = _RANDOM.integers(0, 256, (HEIGHT // 4, WIDTH // 4, 3), np.uint8)
RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)


def quarters(*colours: tuple[int, int, int]) -> dict[str, object]:
    """`sensor_msgs/Image` of four quarters: upper left, upper right, lower left, lower right.

    A stripe of noise across the middle lets video flow: a player begins after so many bytes, and a picture
    that never changes has hardly any.
    """
    upper_left, upper_right, lower_left, lower_right = colours
    picture = np.empty((HEIGHT, WIDTH, 3), np.uint8)
    picture[: HEIGHT // 2, : WIDTH // 2] = upper_left
    picture[: HEIGHT // 2, WIDTH // 2 :] = upper_right
    picture[HEIGHT // 2 :, : WIDTH // 2] = lower_left
    picture[HEIGHT // 2 :, WIDTH // 2 :] = lower_right
    picture[HEIGHT // 2 - 20 : HEIGHT // 2 + 20] = _RANDOM.integers(0, 256, (40, WIDTH, 3), np.uint8)
    return {
        "height": HEIGHT,
        "width": WIDTH,
        "encoding": "rgb8",
        "step": 3 * WIDTH,
        "data": picture.tobytes(),
    }


#: Video has its own idea of green, and browsers have theirs of how to show it.
_TOLERANCE = 75


def shows(picture: Picture, *colours: tuple[int, int, int]) -> bool:
    places = [(160, 120), (480, 120), (160, 360), (480, 360)]
    return all(
        near(picture.at(*place), colour, _TOLERANCE) for place, colour in zip(places, colours, strict=True)
    )


@pytest.mark.parametrize("kind", ["mjpeg", "png", "vp8", "vp9", "h264"])
async def test_a_topic_is_seen_as_it_is_and_changes(browser: Browser, kind: str) -> None:
    async with stand("jazzy", browser.built, robot=False) as robot:
        images = robot.node.advertise("/camera", "sensor_msgs/Image", qos=SENSOR_DATA)
        wanted = [RED, GREEN, BLUE, WHITE]
        robot.node.create_timer(1 / 15, lambda: images.publish(quarters(*wanted)))
        address = f"{robot.url}test/img.html?stream=/stream?topic=/camera&type={kind}&bitrate=1000000"
        async with browser.page(address, WIDTH, HEIGHT) as page:
            await page.picture_when(f"stream {kind}", lambda seen: shows(seen, RED, GREEN, BLUE, WHITE))
            wanted[:] = [BLUE, WHITE, RED, GREEN]
            await page.picture_when(f"stream {kind} later", lambda seen: shows(seen, BLUE, WHITE, RED, GREEN))


async def test_the_demo_robots_camera(browser: Browser) -> None:
    async with stand("jazzy", browser.built) as robot:
        address = f"{robot.url}test/img.html?stream=/stream?topic=/camera/image_raw"
        async with browser.page(address, WIDTH, HEIGHT) as page:
            picture = await page.picture_when(
                "demo camera", lambda seen: seen.pixels.std() > 20 and len(np.unique(seen.pixels)) > 50
            )
            # The horizon: what is above it is not what is below.
            upper, lower = picture.pixels[:100].mean(axis=(0, 1)), picture.pixels[-100:].mean(axis=(0, 1))
            assert np.abs(upper - lower).max() > 20


async def test_the_viewers_page_plays_a_video_of_a_scene_that_stands_still(browser: Browser) -> None:
    async with stand("jazzy", browser.built) as robot:
        address = f"{robot.url}stream_viewer?topic=/camera/image_raw&type=vp8"
        async with browser.page(address, WIDTH, HEIGHT) as page:
            await page.wait("document.querySelector('video').currentTime > 0.5")


class DatedCamera:
    """Pictures of noise with their number and time in the first rows."""

    def __init__(self, node: Node) -> None:
        self._images = node.advertise("/camera/image_raw", "sensor_msgs/Image", qos=SENSOR_DATA)
        self._shots = 0
        node.create_timer(1 / 30, self._shoot)

    def _shoot(self) -> None:
        self._shots += 1
        picture = np.repeat(_NOISE, 4, axis=1).repeat(4, axis=0)
        mark(picture, self._shots % 4096, time.time_ns() // 1_000_000)
        self._images.publish(
            {
                "height": HEIGHT,
                "width": WIDTH,
                "encoding": "rgb8",
                "step": 3 * WIDTH,
                "data": picture.tobytes(),
            }
        )


async def test_a_picture_is_young_when_it_is_seen(browser: Browser) -> None:
    """From the camera's callback to the decoded pixel. On a busy machine most may be late; where a stock of
    pictures is kept, as players of video do, all of them are."""
    async with stand("jazzy", browser.built, robot=False, http=[LATENCY_PAGE]) as robot:
        DatedCamera(robot.node)
        async with browser.page(f"{robot.url}latency.html?type=mjpeg&quality=80", WIDTH, HEIGHT) as page:
            await page.wait("ages.length > 40")
            assert await page.evaluate("ages.splice(0).every((age) => age >= 0)")
            await page.wait("ages.length > 40 && Math.min(...ages.splice(0)) < 300")
