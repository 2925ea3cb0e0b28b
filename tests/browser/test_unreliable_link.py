"""Driving over a link that stalls: what the dashboard shows and sends, and what reaches the robot."""

from __future__ import annotations

import io
import json
import os
import sys
import time
from itertools import pairwise
from typing import Any

import anyio
import pytest
from PIL import Image

from rwt import Server
from rwt.extensions.video.responses import VIDEO_SCRIPT
from rwt_graph import Node
from rwt_participant.qos import SENSOR_DATA
from tests.browser.driver import Browser, Page
from tests.browser.grip import Grip
from tests.browser.stalling_proxy import stalling_proxy
from tests.browser.test_panels import open_panels, text
from tests.waiting import until

pytestmark = pytest.mark.anyio

#: Dead-man timeout of the robot, in seconds.
LEASE = 0.5
GATE = {"rules": {"drive": {"topics": ["/cmd_vel"], "lease": {"seconds": LEASE}, "stop": {}}}}
TWIST = "geometry_msgs/Twist"
OLD = "document.querySelector('.camera canvas.old')"
FRESH = "document.querySelector('.camera canvas:not(.old)')"

GAMEPAD = """(() => {
  globalThis.pad = {axes: [0, 0, 0, 0], buttons: Array.from({length: 8}, () => ({pressed: false})), reads: 0};
  navigator.getGamepads = () => (globalThis.pad.reads++, [globalThis.pad]);
})()"""


class Robot:
    """Commands that reach the robot, with their times."""

    def __init__(self, wheels: Node) -> None:
        self.heard: list[tuple[float, float]] = []
        wheels.subscribe("/cmd_vel", self._hear, TWIST)

    def _hear(self, twist: Any) -> None:
        self.heard.append((time.monotonic(), twist.linear.x))

    @property
    def moves(self) -> bool:
        """True if the last command moves the robot."""
        return bool(self.heard) and self.heard[-1][1] != 0

    @property
    def streams(self) -> bool:
        """True if the last five commands move the robot and came without a gap."""
        last = self.heard[-5:]
        times = [*(at for at, _ in last), time.monotonic()]
        return (
            len(last) == 5
            and all(speed != 0 for _, speed in last)
            and all(after - before < LEASE for before, after in pairwise(times))
        )

    def moved_since(self, moment: float) -> list[float]:
        """Return the speeds other than zero that were commanded after a time."""
        return [speed for at, speed in self.heard if at >= moment and speed != 0]


async def _drive(page: Page, url: str, grip: Grip, robot: Robot) -> None:
    await open_panels(page, url, [("teleop", {"topic": "/cmd_vel"})])
    await page.evaluate(GAMEPAD)
    await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
    # The gate detects queued commands of a client that was streaming: three or more of them without a gap,
    # such as a busy page makes.
    await grip.drive_until(lambda: robot.streams)


CONTROLS = pytest.mark.parametrize("control", ["key", "stick", "gamepad"])
#: Seconds without a link, and without a processor; a full run has `STALL_SECONDS='3 45' SUSPEND_SECONDS=20`.
STALLS = [1.0, 10.0, *map(float, os.environ.get("STALL_SECONDS", "").split())]
SUSPENDED_SECONDS = float(os.environ.get("SUSPEND_SECONDS", "4"))


@pytest.mark.parametrize("seconds", STALLS)
@CONTROLS
async def test_after_a_stall_the_robot_moves_only_with_a_new_grip(
    browser: Browser, control: str, seconds: float
) -> None:
    async with (
        Server("ws://127.0.0.1:0", demo=True, gate=GATE) as server,
        stalling_proxy(int(server.urls[0].rsplit(":", 1)[1].strip("/"))) as link,
    ):
        robot = Robot(server.node("wheels"))
        url = f"http://127.0.0.1:{link.port}/"
        async with browser.page(f"{url}healthz", 700, 600) as page:
            page.forgive("WebSocket", "Failed to load", "ERR_")
            grip = Grip(page, control)
            await _drive(page, url, grip, robot)
            stalled = time.monotonic()
            link.stall()
            await page.wait(
                f"/^No answer from the robot for [0-9.]+ s/.test({text('.state > [aria-hidden]:last-child')})"
            )
            await page.wait("document.querySelector('.drive-forward').disabled")
            await page.wait(f"{text('.drive')}.includes('Driving is off')")
            await until(lambda: not robot.moves)
            while time.monotonic() < stalled + seconds:
                await grip.keep()
                await anyio.sleep(0.1)
            link.resume()
            await page.wait(f"{text('.state')}.startsWith('Connected')")
            await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
            for _ in range(10):
                await grip.keep()
                await anyio.sleep(0.1)
            # The lease and a turn; on a busy machine the test's own loop is late as well.
            assert robot.moved_since(stalled + LEASE + 0.5) == []
            await grip.release()
            await anyio.sleep(0.1)
            await grip.drive_until(lambda: robot.moves)
            await grip.release()


@pytest.mark.skipif(sys.platform != "linux", reason="finds the processes of the browser in /proc")
@CONTROLS
async def test_after_a_suspension_the_robot_moves_only_with_a_new_grip(
    browser: Browser, control: str
) -> None:
    async with Server("ws://127.0.0.1:0", demo=True, gate=GATE) as server:
        robot = Robot(server.node("wheels"))
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 700, 600) as page:
            page.forgive("WebSocket", "Failed to load", "ERR_")
            grip = Grip(page, control)
            await _drive(page, url, grip, robot)
            with browser.suspended():
                stopped = time.monotonic()
                await until(lambda: not robot.moves)
                assert robot.moved_since(stopped + LEASE + 0.5) == []
                await anyio.sleep(SUSPENDED_SECONDS)
            # The clock of a computer that was suspended jumps, too.
            await page.evaluate("Date.now = ((now) => () => now() + 3_600_000)(Date.now)")
            for _ in range(20):
                await grip.keep()
                await anyio.sleep(0.1)
            assert robot.moved_since(stopped + LEASE + 0.5) == []
            await grip.release()
            await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
            await grip.drive_until(lambda: robot.moves)
            await grip.release()
            await until(lambda: not robot.moves)


@CONTROLS
async def test_in_the_background_a_page_does_not_drive(browser: Browser, control: str) -> None:
    async with Server("ws://127.0.0.1:0", demo=True, gate=GATE) as server:
        robot = Robot(server.node("wheels"))
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 700, 600) as page:
            grip = Grip(page, control)
            await _drive(page, url, grip, robot)
            hidden = time.monotonic()
            await _set_hidden(page, hidden=True)
            await until(lambda: not robot.moves)
            for _ in range(10):
                await grip.keep()
                await anyio.sleep(0.1)
            assert robot.moved_since(hidden + LEASE + 0.5) == []
            await _set_hidden(page, hidden=False)
            for _ in range(10):
                await grip.keep()
                await anyio.sleep(0.1)
            assert robot.moved_since(hidden + LEASE + 0.5) == []
            await grip.release()
            await grip.drive_until(lambda: robot.moves)
            await grip.release()


async def _set_hidden(page: Page, *, hidden: bool) -> None:
    """Put the page into the background, or back; a headless browser shows all of its pages."""
    state = "hidden" if hidden else "visible"
    await page.evaluate(
        f"""(Object.defineProperties(document, {{
          hidden: {{ value: {str(hidden).lower()}, configurable: true }},
          visibilityState: {{ value: '{state}', configurable: true }},
        }}), document.dispatchEvent(new Event('visibilitychange')))"""
    )


async def test_without_a_gate_old_commands_end_in_a_standstill(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0", demo=True) as server,
        stalling_proxy(int(server.urls[0].rsplit(":", 1)[1].strip("/"))) as link,
    ):
        robot = Robot(server.node("wheels"))
        url = f"http://127.0.0.1:{link.port}/"
        async with browser.page(f"{url}healthz", 700, 600) as page:
            page.forgive("WebSocket", "Failed to load", "ERR_")
            grip = Grip(page, "key")
            await _drive(page, url, grip, robot)
            link.stall()
            await anyio.sleep(3)
            before = len(robot.heard)
            link.resume()
            await page.wait(f"{text('.state')}.startsWith('Connected')")
            await until(lambda: len(robot.heard) > before and not robot.moves)
            # Half a second of commands, at 20 a second, and what a busy machine adds.
            assert len(robot.heard) - before < 30
            after = time.monotonic()
            for _ in range(10):
                await grip.keep()
                await anyio.sleep(0.1)
            assert robot.moved_since(after) == []


class Camera:
    """Camera whose images reach the server late, as over a network with a queue.

    Attributes:
        backlog: seconds between taking and publishing an image that the queue grows or shrinks to.
    """

    def __init__(self, node: Node, type: str) -> None:
        self.backlog = 0.0
        self._delay = 0.0
        self._images = node.advertise("/eye", f"sensor_msgs/{type}", qos=SENSOR_DATA)
        self._is_raw = type == "Image"
        node.create_timer(0.05, self._shoot)

    def _shoot(self) -> None:
        # No image overtakes another.
        self._delay = min(self._delay + 0.04, self.backlog)
        taken = time.time() - self._delay
        header = {"stamp": {"sec": int(taken), "nanosec": int(taken % 1 * 1e9)}}
        pixels = Image.new("RGB", (16, 12), (200, 60, 20))
        if self._is_raw:
            size = {"height": 12, "width": 16, "step": 48, "encoding": "rgb8"}
            self._images.publish({"header": header, **size, "data": pixels.tobytes()})
        else:
            with io.BytesIO() as file:
                pixels.save(file, "JPEG")
                self._images.publish({"header": header, "format": "jpeg", "data": file.getvalue()})


@pytest.mark.parametrize("way", ["MJPEG", "Compressed messages", "Raw messages"])
async def test_old_images_show_their_age(browser: Browser, way: str) -> None:
    nodes = ["rosapi", *(["web_video_server"] if way == "MJPEG" else [])]
    async with Server("ws://127.0.0.1:0", nodes=nodes) as server:
        camera = Camera(server.node("camera"), "CompressedImage" if way.startswith("Comp") else "Image")
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 700, 600) as page:
            page.forgive("404")
            await open_panels(page, url, [("camera", {"topic": "/eye"})])
            await page.wait(f"{text('.camera-state')}.includes('{way}') && {FRESH}")
            camera.backlog = 2.0
            await page.wait(f"{OLD} && /The image is (1.9|2.[0-4]) s old/.test({text('.camera-state')})")
            camera.backlog = 0.0
            await page.wait(f"{FRESH} && !{text('.camera-state')}.includes('old')")


async def test_an_image_that_stays_shows_its_age(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0") as server,
        stalling_proxy(int(server.urls[0].rsplit(":", 1)[1].strip("/"))) as link,
    ):
        Camera(server.node("camera"), "Image")
        url = f"http://127.0.0.1:{link.port}/"
        async with browser.page(f"{url}healthz", 700, 600) as page:
            page.forgive("WebSocket", "Failed to load", "ERR_")
            await open_panels(page, url, [("camera", {"topic": "/eye"})])
            await page.wait(f"{text('.camera-state')}.includes('MJPEG') && {FRESH}")
            link.stall()
            await page.wait(f"{OLD} && /The image is [1-9][.0-9]+ s old/.test({text('.camera-state')})")
            link.resume()
            await page.wait(FRESH)


async def test_a_video_that_stays_shows_its_age(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0", demo=True) as server,
        stalling_proxy(int(server.urls[0].rsplit(":", 1)[1].strip("/"))) as link,
    ):
        stream = "topic=/camera/image_raw&type=vp8&bitrate=1000000"
        url = f"http://127.0.0.1:{link.port}/stream_viewer?{stream}"
        video, state = "document.querySelector('video')", text("[role=status]")
        async with browser.page(url, 700, 600) as page:
            page.forgive("ERR_", "404")
            await page.wait(f"{video}.currentTime > 0 && {state} === ''")
            link.stall()
            await page.wait(f"{video}.style.filter && /is [1-9][.0-9]+ s old/.test({state})")
            link.resume()


SLOW_VIDEO = """((script) => {
  document.body.innerHTML = '<video></video><p></p>';
  globalThis.delay = 0.1;
  const begun = performance.now();
  const received = () => (performance.now() - begun) / 1000 - delay;
  Object.defineProperties(document.querySelector('video'), {
    buffered: { value: { length: 1, end: received } }, currentTime: { get: received },
  });
  new Function(script)();
})(%s)"""
"""A video that is shown as soon as it is received."""


async def test_a_video_that_arrives_late_shows_its_age(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0") as server,
        browser.page(f"{server.urls[0].replace('ws', 'http', 1)}/healthz") as page,
    ):
        page.forgive("404")
        await page.evaluate(SLOW_VIDEO % json.dumps(VIDEO_SCRIPT))
        await page.evaluate("new Promise((later) => setTimeout(later, 1000, true))")
        assert await page.evaluate(text("p")) == ""
        await page.evaluate("delay = 2")
        await page.wait(f"document.querySelector('video').style.filter && /is 1[.]9 s old/.test({text('p')})")
        await page.evaluate("delay = 0.1")
        await page.wait(f"{text('p')} === ''")
