"""The page at a robot with a gate: who drives is seen, and its stop is the robot's, for everybody."""

from __future__ import annotations

from typing import Any

import anyio
import pytest

from rwt import Server, connect
from rwt_participant.errors import RobotError
from tests.browser.driver import Browser
from tests.browser.test_panels import open_panels, release, text, violations
from tests.waiting import until

pytestmark = pytest.mark.anyio

GATE = {"rules": {"drive": {"topics": ["/cmd_vel"], "lease": {"seconds": 60}, "stop": {}, "emergency": True}}}
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
            await page.wait(f"{text('.driver')}.includes('No driver')")
            await other.call("/gate/take_lease", {"topic": "/cmd_vel"}, "rwt_gate_msgs/Lease")
            await page.wait(f"{text('.driver')} === 'admin (127.0.0.1) drives'")
            answer = await other.call("/gate/release_lease", {"topic": "/cmd_vel"}, "rwt_gate_msgs/Lease")
            assert answer.success
            await page.wait(f"{text('.driver')}.includes('No driver')")

            await page.keyboard("press", "Escape")
            await page.wait(f"{text('.stopped')}.includes('stopped for all clients by rosbridge:')")
            refused: Any = await other.call("/gate/take_lease", {"topic": "/cmd_vel"}, "rwt_gate_msgs/Lease")
            assert "the emergency stop is on" in refused.message
            await until(lambda: len(told) > 5)
            assert set(told) == {0.0}
            # Who pressed it keeps still until it is released there, too.
            await other.call("/gate/release_stop", {}, "rwt_gate_msgs/Stop")
            await release(page)

            await page.click("text=Take the lease")
            await page.wait(f"{text('.driver')} === 'You drive'")
            refused = await other.call("/gate/take_lease", {"topic": "/cmd_vel"}, "rwt_gate_msgs/Lease")
            assert not refused.success
            await page.click("text=Release the lease")
            await page.wait(f"{text('.driver')}.includes('No driver')")
            await other.call("/gate/take_lease", {"topic": "/cmd_vel"}, "rwt_gate_msgs/Lease")
            await page.click("text=Take over")
            await page.wait(f"{text('.lease .problem')}.includes('/cmd_vel is held by rosbridge:')")


async def test_a_lease_is_asked_for_and_handed_over(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0", demo=True, gate=GATE) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz") as one, browser.page(f"{url}healthz") as two:
            for page in (one, two):
                await open_panels(page, url, [("teleop", {"topic": "/cmd_vel"})])
            # A lease that is taken by driving is this page's own, too.
            await one.evaluate("document.querySelector('.drive-forward').focus()")
            await one.keyboard("down", " ")
            await one.wait(f"{text('.driver')} === 'You drive'")
            await one.keyboard("up", " ")
            await two.wait(f"/^admin [(](Chrome|Firefox), Linux[)] drives$/.test({text('.driver')})")
            await two.click("text=Ask for control")
            await two.wait("document.querySelector('.lease button:disabled')?.textContent === 'Asked'")
            await one.wait(f"{text('.lease-request')}.includes('asks for control')")
            assert await violations(one) == []
            await one.click("text=Hand over")
            await two.wait(f"{text('.driver')} === 'You drive'")
            await one.wait(f"{text('.driver')}.endsWith(' drives')")


CLAMPING = {
    "rules": {
        "drive": {
            "topics": ["/cmd_vel"],
            "fields": {"linear.x": {"min": -0.2, "max": 0.2, "beyond": "clamp"}},
        }
    }
}


async def test_clamped_values_are_shown_beside_the_stick(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0", demo=True, gate=CLAMPING) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 700, 600) as page:
            await open_panels(page, url, [("teleop", {"topic": "/cmd_vel"})])
            await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
            await page.evaluate("document.querySelector('.drive-forward').focus()")
            await page.keyboard("down", " ")
            await page.wait(f"{text('.clamped')}.includes('linear.x 0.2 instead of 0.4')")
            await page.keyboard("up", " ")


ASKING = {
    "rules": {
        "agent": {
            "roles": ["agent"],
            "services": ["/add_two_ints"],
            "approval": {"roles": ["admin"], "seconds": 120, "remember_seconds": 600},
        }
    }
}
AGENT = "an-agent-s-token-0123456789"
PERSON = "a-person-s-token-0123456789"


async def test_a_person_answers_what_a_client_asks(browser: Browser) -> None:
    tokens = {"agent": {"token": AGENT, "role": "agent"}, "person": {"token": PERSON, "role": "admin"}}
    settings: dict[str, Any] = {
        "gate": ASKING,
        "auth": {"tokens": tokens},
        "roles": {"agent": {"call": ["*"]}},
    }
    async with (
        Server("ws://127.0.0.1:0", demo=True, **settings) as server,
        connect(server.urls[0], headers={"Authorization": f"Bearer {AGENT}"}) as agent,
    ):
        outcomes: dict[int, object] = {}

        async def ask(number: int) -> None:
            request = {"a": number, "b": 1}
            try:
                answer: Any = await agent.call("/add_two_ints", request, "example_interfaces/AddTwoInts")
                outcomes[number] = answer.sum
            except RobotError as error:
                outcomes[number] = str(error)

        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 700, 600) as page, anyio.create_task_group() as tasks:
            await page.evaluate(f"sessionStorage.setItem('rwt-token {server.urls[0]}/', '{PERSON}')")
            await open_panels(page, url, [("topics", {})])
            # Whatever is open, that somebody waits is seen, and leads to the panel.
            tasks.start_soon(ask, 1)
            await page.click("text=1 request for approval")
            await page.wait(f"{text('.approval')}.includes('rosbridge:')")
            for part in ("(agent)", "wants to call", "/add_two_ints", '"a": 1', "gate.rules.agent"):
                await page.wait(f"{text('.approval')}.includes({part!r})")
            assert await violations(page) == []
            await page.click("text=Approve once")
            await until(lambda: outcomes.get(1) == 2)
            tasks.start_soon(ask, 2)
            await page.wait(f"{text('.approval pre')}.includes('\"a\": 2')")
            await page.click(".approval .plot-bar > button")
            await until(lambda: 2 in outcomes)
            assert "no" in str(outcomes[2])
            await page.wait(f"{text('.approvals')}.includes('No pending requests')")
            tasks.start_soon(ask, 3)
            await page.click("text=Approve for 10 min")
            await until(lambda: outcomes.get(3) == 4)
            del outcomes[3]
            await ask(3)
            assert outcomes[3] == 4, "an approval for some time covers the same request"
