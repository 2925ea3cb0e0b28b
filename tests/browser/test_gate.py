"""The page at a robot with a gate: who drives is seen, and its stop is the robot's, for everybody."""

from __future__ import annotations

from typing import Any

import pytest

from rwt import Server, connect
from tests.browser.driver import Browser, until
from tests.browser.test_panels import open_panels, text

pytestmark = pytest.mark.anyio

GATE = {"rules": {"drive": {"topics": ["/cmd_vel"], "lease": {}, "stop": {}, "emergency": True}}}
TWIST = "geometry_msgs/Twist"


async def test_who_drives_is_seen_and_the_stop_holds_for_everybody(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0", demo=True, gate=GATE) as server,
        connect(server.urls[0]) as other,
    ):
        url = server.urls[0].replace("ws", "http", 1) + "/"
        told: list[float] = []
        robot = server.node("watcher")
        robot.subscribe("/cmd_vel", lambda twist: told.append(twist.linear.x), TWIST)
        async with browser.page(f"{url}healthz") as page:
            await open_panels(page, url, [("teleop", {"topic": "/cmd_vel"})])
            await page.wait(f"{text('.driver')}.includes('Nobody drives')")
            await other.call("/gate/take_lease", {"topic": "/cmd_vel"}, "rwt_gate_msgs/Lease")
            await page.wait(f"{text('.driver')}.includes('Driven by rosbridge:')")
            answer = await other.call("/gate/release_lease", {"topic": "/cmd_vel"}, "rwt_gate_msgs/Lease")
            assert answer.success
            await page.wait(f"{text('.driver')}.includes('Nobody drives')")

            await page.keyboard("press", "Escape")
            await page.wait(f"{text('.stopped')}.includes('stopped for everybody by rosbridge:')")
            refused: Any = await other.call("/gate/take_lease", {"topic": "/cmd_vel"}, "rwt_gate_msgs/Lease")
            assert "the emergency stop is on" in refused.message
            await until(lambda: len(told) > 5)
            assert set(told) == {0.0}
            # Who pressed it keeps still until it is released there, too.
            await other.call("/gate/release_stop", {}, "rwt_gate_msgs/Stop")
            await page.click("text=Release")
            await page.wait("!document.querySelector('.stopped')")
