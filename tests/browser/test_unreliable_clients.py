"""Driving by roslib, over WebSockets and data channels, while the link stalls or the browser is suspended."""

from __future__ import annotations

import sys
import time
from urllib.parse import urlsplit

import anyio
import pytest

from tests.browser.driver import Browser, Page
from tests.browser.stalling_proxy import stalling_proxy
from tests.browser.stand import stand
from tests.browser.test_unreliable_link import GATE, LEASE, STALLS, SUSPENDED_SECONDS, Robot
from tests.waiting import until

pytestmark = pytest.mark.anyio

#: Clients of the page: over a WebSocket, and over an ordered and a lossy data channel.
CLIENTS = {
    "WebSocket": "new ROSLIB.Ros({ url: location.origin.replace('http', 'ws') })",
    "ordered channel": "ros",
    "lossy channel": "fresh",
}
DRIVE = """(() => {
  const driver = %s;
  const vel = new ROSLIB.Topic({ ros: driver, name: '/cmd_vel', messageType: 'geometry_msgs/Twist' });
  const turn = { x: 0, y: 0, z: 0 };
  globalThis.speed = 0;
  globalThis.driver = driver;
  setInterval(() => {
    if (driver.isConnected) vel.publish({ linear: { x: globalThis.speed, y: 0, z: 0 }, angular: turn });
  }, 50);
})()"""
"""A control that sends a command every 50 ms while it is connected, also when it is released."""


class Client:
    """Page with roslib whose control is held and released.

    Args:
        by: one of :data:`CLIENTS`.
    """

    def __init__(self, page: Page, url: str, library: str, by: str) -> None:
        self._page = page
        self._url = f"{url}test/webrtc.html?library={library}"
        self._by = by
        self._is_connected = "driver.isConnected"
        if by != "WebSocket":
            # A browser keeps the channels of a lost peer open.
            self._is_connected += " && connection.connectionState === 'connected'"

    async def connect(self) -> None:
        await self._page.goto(self._url)
        await self._page.wait("state.open")
        await self._page.evaluate(DRIVE % CLIENTS[self._by])
        await self._page.wait("driver.isConnected")

    async def grip(self, robot: Robot) -> None:
        """Release the control and hold it, until the robot moves; connect again if needed."""
        for _ in range(20):
            if not await self._page.evaluate(self._is_connected):
                await self.connect()
            await self._page.evaluate("speed = 0")
            await anyio.sleep(0.3)
            await self._page.evaluate("speed = 0.3")
            with anyio.move_on_after(3):
                await until(lambda: robot.streams)
                return
        raise TimeoutError("the robot does not move although the control was held twenty times")


async def _moves_no_more(robot: Robot, since: float) -> None:
    await anyio.sleep(3)
    # The lease and a turn; on a busy machine the test's own loop is late as well.
    assert robot.moved_since(since + LEASE + 0.5) == []


LIBRARIES = pytest.mark.parametrize("library", ["1", "2"])


@pytest.mark.parametrize("seconds", STALLS)
@LIBRARIES
async def test_after_a_stall_the_robot_moves_only_with_a_new_grip(
    browser: Browser, library: str, seconds: float
) -> None:
    async with (
        stand("jazzy", browser.built, robot=False, webrtc=True, gate=GATE) as where,
        stalling_proxy(urlsplit(where.url).port or 0) as link,
    ):
        robot = Robot(where.node)
        url = f"http://127.0.0.1:{link.port}/"
        async with browser.page(f"{url}healthz") as page:
            page.forgive("WebSocket", "Failed to load", "ERR_", "User-Initiated Abort")
            client = Client(page, url, library, "WebSocket")
            await client.connect()
            await client.grip(robot)
            stalled = time.monotonic()
            link.stall()
            await until(lambda: not robot.moves)
            await anyio.sleep(max(0.0, stalled + seconds - time.monotonic()))
            link.resume()
            await _moves_no_more(robot, stalled)
            await client.grip(robot)


@pytest.mark.skipif(sys.platform != "linux", reason="finds the processes of the browser in /proc")
@pytest.mark.parametrize("by", CLIENTS)
@LIBRARIES
async def test_after_a_suspension_the_robot_moves_only_with_a_new_grip(
    browser: Browser, library: str, by: str
) -> None:
    async with stand("jazzy", browser.built, robot=False, webrtc=True, gate=GATE) as where:
        robot = Robot(where.node)
        async with browser.page(f"{where.url}healthz") as page:
            page.forgive("WebSocket", "Failed to load", "ERR_", "User-Initiated Abort")
            client = Client(page, where.url, library, by)
            await client.connect()
            await client.grip(robot)
            with browser.suspended():
                stopped = time.monotonic()
                await until(lambda: not robot.moves)
                await anyio.sleep(SUSPENDED_SECONDS)
                assert robot.moved_since(stopped + LEASE + 0.5) == []
            await _moves_no_more(robot, stopped)
            await client.grip(robot)
