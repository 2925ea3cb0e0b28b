"""The Joints panel: sliders that move an arm, beside its 3D model and its camera."""

from __future__ import annotations

import json
import math
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

import anyio
import numpy as np
import pytest

from rwt import Server
from rwt_graph import Node
from rwt_lerobot.joints.controller import TrajectoryController
from rwt_lerobot.joints.limits import JointLimit
from rwt_participant.images import compressed_image
from rwt_participant.qos import LATCHED
from tests.browser.driver import LEFT_MESH, LEFT_STREAM, Browser, Page
from tests.browser.test_panels import release, text
from tests.waiting import until

pytestmark = pytest.mark.anyio

STATES = "sensor_msgs/JointState"
KNOB = 16
"""Width of a slider's knob in pixels, whose middle is at the position."""
STOPPED = "document.querySelector('.stopped')"
#: Angle of a joint in the model that the 3D view draws.
DRAWN = (
    "document.querySelector('.scene-view')?.robotScene?.rows.value"
    ".find(({{ topic }}) => topic === '/robot_description')?.layer?.robot?.joints[{!r}]?.angle"
)
URDF = """<robot name="two_joints"><link name="base"/><link name="upper"/><link name="hand"/>
<joint name="pan" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-1.5" upper="1.5" velocity="2" effort="1"/></joint>
<joint name="lift" type="revolute"><parent link="upper"/><child link="hand"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" velocity="2" effort="1"/></joint></robot>"""
#: A gamepad whose left stick is to the left; its left trigger is button 6.
GAMEPAD = """(() => {
  globalThis.pad = {axes: [-1, 0, 0, 0], buttons: Array.from({length: 8}, () => ({pressed: false}))};
  navigator.getGamepads = () => [globalThis.pad];
})()"""
TRIGGER = "globalThis.pad.buttons[6].pressed = {}"
GATE: dict[str, Any] = {
    "rules": {
        "arm": {
            "topics": ["/arm_controller/joint_trajectory"],
            "emergency": True,
            "lease": {"seconds": 0.5},
            "stop": {},
        }
    }
}


async def slide(page: Page, joint: str, position: float) -> None:
    """Click a slider of the panel where a position is."""
    slider = (
        f"[...document.querySelectorAll('.jog .limit')]"
        f".find((row) => row.querySelector('label').textContent === {json.dumps(joint)})"
        "?.querySelector('input:not(:disabled)')"
    )
    await page.wait(f"Boolean({slider})")
    left, top, width, height, least, most = await page.evaluate(
        f"((it) => (it.scrollIntoView({{ block: 'center' }}),"
        f" ((b) => [b.left, b.top, b.width, b.height, Number(it.min), Number(it.max)])"
        f"(it.getBoundingClientRect())))({slider})"
    )
    x = left + KNOB / 2 + (width - KNOB) * (position - least) / (most - least)
    await page.mouse("move", x, top + height / 2)
    await page.mouse("down")
    await page.mouse("up")


async def slide_until(page: Page, joint: str, position: float, arrived: Any) -> None:
    """Move a joint, again every five seconds: a page that is too busy for half a second holds it."""
    for _ in range(12):
        await slide(page, joint, position)
        with anyio.move_on_after(5):
            await until(arrived)
            return
    raise TimeoutError(f"{joint} does not arrive at {position}")


async def test_sliders_move_the_demo_robots_arm_and_a_stop_holds_it(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0", demo=True) as server:
        arm: dict[str, float] = {}
        server.node("watch").subscribe(
            "/joint_states", lambda state: arm.update(zip(state.name, state.position, strict=True)), STATES
        )
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(url, 1000, 640) as page:
            page.forgive(LEFT_MESH, LEFT_STREAM)
            await page.wait(
                "document.querySelector('.panel-scene') && document.querySelector('.panel-camera')"
            )
            await page.click('header .menus summary:has-text("Add panel")')
            await page.click("[data-kind=joints]")
            await page.wait("document.querySelectorAll('.jog .limit').length === 6")  # Not the wheels.
            pan = "shoulder_pan_joint"
            await slide_until(page, pan, 0.8, lambda: abs(arm[pan] - 0.8) < 0.1)
            await page.wait(f"Math.abs({DRAWN.format(pan)} - 0.8) < 0.1")
            await page.wait(f"/[34]\\d\\.\\d°/.test({text('.jog .number')})")
            await page.wait("document.querySelector('.camera canvas')?.width > 0")
            # Away from the other end, which takes 4 s.
            await slide_until(page, pan, -3.0, lambda: arm[pan] < 0.6)
            await page.keyboard("press", "Escape")
            await page.wait(STOPPED)
            await anyio.sleep(0.3)
            held = arm[pan]
            assert held > -2.9
            await page.wait("!document.querySelector('.jog input:enabled')")
            await anyio.sleep(0.5)
            await release(page)
            await anyio.sleep(0.5)
            assert arm[pan] == pytest.approx(held, abs=0.01)


@asynccontextmanager
async def robot_arm(server: Server) -> AsyncIterator[dict[str, float]]:
    """An arm with two joints and a camera, whose controller allows less than its description."""
    node = Node(server.graph, "arm")
    limits = [JointLimit("pan", -1.5, 1.5), JointLimit("lift", -0.5, 0.5)]
    controller = TrajectoryController(node, limits, "/arm_controller", node.log.warning)
    node.advertise("/robot_description", "std_msgs/String", qos=LATCHED).publish({"data": URDF})
    states = node.advertise("/joint_states", STATES)
    image = node.advertise("/front/image_raw/compressed", "sensor_msgs/CompressedImage")
    arm = {"pan": 0.0, "lift": 0.0}
    picture = compressed_image(np.full((24, 32, 3), (200, 40, 40), np.uint8), frame_id="front")

    def step() -> None:
        controller.measure(tuple(arm.values()))
        arm.update(zip(arm, controller.step(0.05) or (), strict=False))
        states.publish({"name": list(arm), "position": list(arm.values())})
        image.publish(picture)

    timer = node.create_timer(0.05, step)
    yield arm
    timer.cancel()
    controller.close()


async def test_an_arm_opens_its_panels_and_shows_leases_and_rejections(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0", gate=GATE) as server, robot_arm(server) as arm:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(url, 1300, 900) as page:
            await page.wait("document.querySelectorAll('.jog .limit').length === 2")
            for kind in ("scene", "camera"):
                await page.wait(f"document.querySelector('.panel-{kind}')")
            await slide_until(page, "pan", 1.0, lambda: arm["pan"] == pytest.approx(1.0, abs=0.05))
            await page.wait(f"Math.abs({DRAWN.format('pan')} - 1) < 0.1")
            await page.wait(f"{text('.driver')}.includes('You drive')")
            await anyio.sleep(1)  # The lease ends; the next motion is a new grip.
            await slide_until(page, "pan", 0.2, lambda: arm["pan"] == pytest.approx(0.2, abs=0.05))
            assert "stalled" not in await page.evaluate(text(".notices"))
            await slide(page, "lift", 1.2)
            await page.wait(f"{text('.joints')}.includes('lift moves from -0.5 to 0.5 rad, not to')")
            assert arm["lift"] <= 0.5
            stop = server.node("operator")
            await slide_until(page, "pan", -1.4, lambda: arm["pan"] < 0.1)
            await stop.call("/gate/stop", {"reason": "somebody is near"}, "rwt_gate_msgs/Stop")
            await page.wait(f"{STOPPED} && !document.querySelector('.jog input:enabled')")
            held = arm["pan"]
            await anyio.sleep(0.5)
            assert arm["pan"] == pytest.approx(held, abs=0.01)
            assert not math.isclose(held, -1.4, abs_tol=0.01)


async def test_a_gamepad_moves_joints_while_its_trigger_is_held(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0", gate=GATE) as server, robot_arm(server) as arm:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(url, 1300, 900) as page:
            await page.wait("document.querySelectorAll('.jog .limit').length === 2")
            await page.evaluate(GAMEPAD)
            await anyio.sleep(0.5)
            assert arm["pan"] == 0

            async def push_to(position: float) -> None:
                """Hold the trigger, again every five seconds: a page that was too busy needs a new grip."""
                for _ in range(12):
                    await page.evaluate(TRIGGER.format("true"))
                    with anyio.move_on_after(5):
                        await until(lambda: arm["pan"] > position)
                        return
                    await page.evaluate(TRIGGER.format("false"))
                    await anyio.sleep(0.5)
                raise TimeoutError(f"pan does not arrive at {position}")

            await push_to(0.3)
            await page.evaluate(TRIGGER.format("false"))
            await anyio.sleep(1)
            held = arm["pan"]
            await anyio.sleep(0.5)
            assert arm["pan"] == held < 1.4
            await push_to(held + 0.1)
            operator = server.node("operator")
            await operator.call("/gate/stop", {"reason": "somebody is near"}, "rwt_gate_msgs/Stop")
            await page.wait(f"{STOPPED} && !document.querySelector('.jog input:enabled')")
            held = arm["pan"]
            await release(page)
            await page.wait("document.querySelector('.jog input:enabled')")
            await anyio.sleep(0.5)
            assert arm["pan"] == pytest.approx(held, abs=0.01)  # The trigger is held as before the stop.
            assert arm["lift"] == 0


async def test_a_controller_that_names_its_joints_gets_those(browser: Browser) -> None:
    commands: list[Mapping[str, Any]] = []
    async with Server("ws://127.0.0.1:0") as server:
        node = Node(server.graph, "arm")
        node.advertise("/robot_description", "std_msgs/String", qos=LATCHED).publish({"data": URDF})
        states = node.advertise("/joint_states", STATES, qos=LATCHED)
        states.publish({"name": ["lift", "pan"], "position": [0.1, 0.2]})
        # ROS's type is control_msgs/JointTrajectoryControllerState, which is not bundled; its field counts.
        controller = node.advertise("/arm_controller/controller_state", "control_msgs/JointJog", qos=LATCHED)
        controller.publish({"joint_names": ["lift"]})
        node.subscribe("/arm_controller/joint_trajectory", commands.append, "trajectory_msgs/JointTrajectory")
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(url, 1300, 900) as page:
            await page.wait("document.querySelectorAll('.jog .limit').length === 1")
            await page.click(".jog button[aria-label='lift: more']")
            await until(lambda: commands)
            assert list(commands[0].joint_names) == ["lift"]  # type: ignore[attr-defined]
