"""Recordings that the dashboard plays in place of the robot."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import anyio
import pytest

from rwt import Server
from rwt.extensions.recording import open_recording
from rwt_participant.qos import LATCHED
from tests.browser.driver import Browser, Page
from tests.browser.test_data_panels import address, write
from tests.browser.test_panels import open_panels, text, violations
from tests.waiting import until

pytestmark = pytest.mark.anyio

TIMELINE = ".timeline .number"
#: A picture of one pixel, as a browser decodes it.
RED_PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4z8AAAAMBAQDJ/pLvAAAAAElFTkSuQmCC"
)


async def record(path: Path) -> None:
    """Record a robot whose odometry counts, for two seconds."""
    async with Server("ws://127.0.0.1:0", record=path) as server:
        node = server.node("counter")
        odometry = node.advertise("/odom", "nav_msgs/Odometry")
        command = node.advertise("/cmd_vel", "geometry_msgs/Twist")
        node.advertise("/camera", "sensor_msgs/CompressedImage", qos=LATCHED).publish(
            {"format": "png", "data": RED_PIXEL}
        )
        for count in range(40):
            odometry.publish({"header": {"frame_id": "odom"}, "pose": {"pose": {"position": {"x": count}}}})
            command.publish({"linear": {"x": 0.5}})
            await anyio.sleep(0.05)
    with open_recording([path]) as recording:
        assert recording.complete


async def drop(page: Page, content: bytes, name: str = "run.mcap") -> None:
    """Drop a file on the page."""
    encoded = base64.b64encode(content).decode()
    await page.evaluate(
        f"""(() => {{
              const content = Uint8Array.from(atob({json.dumps(encoded)}), (it) => it.charCodeAt(0));
              const dataTransfer = new DataTransfer();
              dataTransfer.items.add(new File([content], {json.dumps(name)}));
              for (const kind of ["dragover", "drop"]) {{
                const options = {{ dataTransfer, bubbles: true, cancelable: true }};
                document.body.dispatchEvent(new DragEvent(kind, options));
              }}
            }})()"""
    )


async def test_a_dropped_recording_takes_the_place_of_the_robot(browser: Browser, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    await record(path)
    async with Server("ws://127.0.0.1:0", demo=True) as server:
        moved: list[float] = []
        server.node("wheels").subscribe("/cmd_vel", lambda twist: moved.append(twist.linear.x))
        clients: list[int] = []
        server.node("count").subscribe("/client_count", lambda count: clients.append(count.data))
        async with browser.page(f"{address(server)}healthz", 1300, 850) as page:
            await open_panels(page, address(server), [("topics", {})])
            await drop(page, path.read_bytes())
            await page.wait("document.querySelector('.timeline')")
            assert await page.evaluate("document.title") == "run.mcap · Robot"
            # The robot has no client any more, and a stop that reaches nothing is not offered.
            await until(lambda: clients[-1] == 0)
            assert not await page.evaluate("document.querySelector('.stop')")
            await page.wait(f"{text('.side')}.includes('/cmd_vel')")
            assert "/scan" not in await page.evaluate(text(".side"))
            # It ends where it was recorded, and what is shown is what was recorded last.
            await page.wait(f"/^0:0(.*) [/] 0:0\\1$/.test({text(TIMELINE)})")
            await page.click("text=/odom")
            await page.wait("document.querySelector('.panel-topics .detail input')")
            await write(page, ".panel-topics .detail input", "position.x")
            position = f"/position[.]x[^0-9]*([0-9]+)/.exec({text('.panel-topics .detail')})?.[1]"
            await page.wait(f"{position} === '39'")
            assert await violations(page) == []
            await page.picture("recording")
            # Another time is shown at once, also while it rests.
            await page.evaluate(
                """(() => {
                  const slider = document.querySelector('.timeline input');
                  slider.value = 0.5;
                  slider.dispatchEvent(new Event('input', { bubbles: true }));
                })()"""
            )
            await page.wait(f"{text(TIMELINE)}.startsWith('0:00.5 ')")
            await page.wait(f"Number({position}) < 20")
            # Nothing can be published, and Escape stops nothing.
            assert not await page.evaluate("document.querySelector('.panel-topics .detail details')")
            await page.keyboard("press", "Escape")
            assert not await page.evaluate("document.querySelector('.stopped')")
            await page.click("text=Back to the robot")
            await page.wait("document.querySelector('.state-open') && document.querySelector('.stop')")
            assert moved == []


async def test_the_camera_shows_what_was_recorded_and_not_the_robot(browser: Browser, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    await record(path)
    async with Server("ws://127.0.0.1:0") as server:
        asked = server.node("camera").advertise("/camera", "sensor_msgs/CompressedImage", qos=LATCHED)
        asked.publish({"format": "png", "data": b"no picture"})
        async with browser.page(f"{address(server)}healthz", 1300, 850) as page:
            await open_panels(page, address(server), [("topics", {})])
            await drop(page, path.read_bytes())
            canvas = "document.querySelector('.panel-camera canvas')"
            colour = f"{canvas}?.getContext('2d').getImageData(0, 0, 1, 1).data.join()"
            await page.wait(f"{colour} === '255,0,0,255'")


async def test_a_recording_of_the_robot_is_played_by_keys(browser: Browser, tmp_path: Path) -> None:
    await record(tmp_path / "drive.mcap")
    async with (
        Server("ws://127.0.0.1:0", recorder={"folder": tmp_path}) as server,
        browser.page(f"{address(server)}healthz", 390, 844) as page,
    ):
        await open_panels(page, address(server), [("player", {})])
        await page.wait("document.querySelector('[aria-label=\"Play drive.mcap\"]')")
        await page.evaluate("document.querySelector('[aria-label=\"Play drive.mcap\"]').focus()")
        await page.keyboard("press", "Enter")
        await page.wait("document.querySelector('.timeline [aria-label=Resume]')")  # It has ended.
        slider = "document.querySelector('.timeline input')"
        await page.evaluate(f"{slider}.focus()")
        await page.keyboard("press", "Home")
        await page.wait(f"{text(TIMELINE)}.startsWith('0:00.0 ')")
        await page.keyboard("press", "ArrowRight")
        await page.wait(f"{text(TIMELINE)}.startsWith('0:00.1 ')")
        for name in ("Add a bookmark", "Repeat"):
            await page.evaluate(f"document.querySelector('[aria-label=\"{name}\"]').focus()")
            await page.keyboard("press", "Enter")
        await page.wait("document.querySelector('[aria-label=Repeat]').ariaPressed === 'true'")
        await page.evaluate(f"{slider}.focus()")
        await page.keyboard("press", "End")
        await page.evaluate("document.querySelector('[aria-label=\"Go to 0:00.1\"]').focus()")
        await page.keyboard("press", "Enter")
        await page.wait(f"{text(TIMELINE)}.startsWith('0:00.1 ')")
        assert await violations(page) == []
        await page.evaluate(
            "document.querySelector('[aria-label=\"Remove the bookmark at 0:00.1\"]').focus()"
        )
        await page.keyboard("press", "Enter")
        await page.wait("!document.querySelector('.bookmark')")
        # From the end on it begins again.
        await page.evaluate("document.querySelector('.timeline [aria-label=Resume]').focus()")
        await page.keyboard("press", "Enter")
        await page.wait(f"{text(TIMELINE)} > '0:01.5'")
        await page.wait(f"{text(TIMELINE)} < '0:01.0'")


@pytest.mark.parametrize("content", [b"", b"no recording" * 100, "incomplete"], ids=["empty", "text", "cut"])
async def test_what_is_no_recording_leaves_the_page_at_the_robot(
    browser: Browser, tmp_path: Path, content: bytes | str
) -> None:
    if isinstance(content, str):
        path = tmp_path / "run.mcap"
        await record(path)
        content = path.read_bytes()[:-50]
    async with (
        Server("ws://127.0.0.1:0", demo=True) as server,
        browser.page(f"{address(server)}healthz", 1300, 850) as page,
    ):
        await open_panels(page, address(server), [("topics", {})])
        await drop(page, content, "<b>x</b>.mcap")
        await page.wait(f"{text('.notices')}.includes('<b>x</b>.mcap cannot be opened: ')")
        assert await page.evaluate(
            "!!document.querySelector('.state-open') && !!document.querySelector('.stop')"
        )
