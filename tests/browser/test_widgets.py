"""The elements for other people's pages, on the pages that the documentation shows."""

from __future__ import annotations

import io
import json
import math
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import anyio.to_thread
import numpy as np
import pytest
from PIL import Image

from rwt import Server
from tests.browser.driver import NODE, REFUSED, Browser, Page, Picture, near
from tests.browser.grip import hold_until
from tests.browser.stand import REGISTRIES
from tests.docs.blocks import ALL_BLOCKS, ROOT
from tests.docs.processes import Running, commands_folder
from tests.processes import free_port
from tests.waiting import until

pytestmark = pytest.mark.anyio

BOTH = pytest.mark.parametrize("distro", ["jazzy", "noetic"])
PAGES = sorted(path.stem for path in (ROOT / "web" / "pages").glob("*.html"))
AXE = (ROOT / "web" / "node_modules" / "axe-core" / "axe.min.js").read_text(encoding="utf-8")


@asynccontextmanager
async def robot(distro: str = "jazzy", *, demo: bool = True, **settings: Any) -> AsyncIterator[Server]:
    """A robot that serves the pages of the documentation."""
    async with Server("ws://127.0.0.1:0", registry=REGISTRIES[distro], demo=demo, **settings) as server:
        yield server


def http(server: Server, path: str = "") -> str:
    return f"{server.urls[0].replace('ws', 'http', 1)}/{path}"


@asynccontextmanager
async def shown(
    browser: Browser, server: Server, name: str, width: int = 700, height: int = 700
) -> AsyncIterator[Page]:
    """A page of the documentation."""
    async with browser.page(http(server, f"web/pages/{name}.html"), width, height) as page:
        yield page


def part(element: str, selector: str) -> str:
    """A part of an element, as JavaScript."""
    return f"document.querySelector('{element}')?.shadowRoot?.querySelector('{selector}')"


async def place(page: Page, what: str) -> tuple[float, float, float, float]:
    """Left, top, width and height of an element."""
    box = await page.evaluate(
        f"(({{ left, top, width, height }}) => [left, top, width, height])({what}.getBoundingClientRect())"
    )
    left, top, width, height = box
    return left, top, width, height


class Odometry:
    """Speed of the robot."""

    def __init__(self, server: Server) -> None:
        self.linear = self.angular = math.nan
        self.fastest = 0.0
        server.node("odometry").subscribe("/odom", self._hear)

    def _hear(self, odom: Any) -> None:
        twist = odom.twist.twist
        self.linear, self.angular = twist.linear.x, twist.angular.z
        self.fastest = max(self.fastest, self.linear)

    @property
    def stands(self) -> bool:
        return self.linear == self.angular == 0.0


# -- what each shows, and what it does to the robot ----------------------------------------------------------


@BOTH
async def test_video_shows_what_the_camera_sees(browser: Browser, distro: str) -> None:
    async with robot(distro) as server, shown(browser, server, "video") as page:
        await page.wait(f"{part('rwt-video', 'canvas.shown')}?.width === 640")
        left, top, width, height = await place(page, part("rwt-video", "canvas"))
        url = http(server, "snapshot?topic=/camera/image_raw")
        body = await anyio.to_thread.run_sync(lambda: urlopen(url).read())
        size = round(width), round(height)
        expected = np.asarray(Image.open(io.BytesIO(body)).convert("RGB").resize(size)).astype(int)
        rows = slice(round(top), round(top) + size[1])
        columns = slice(round(left), round(left) + size[0])
        # On a busy machine the image is old now and then, and grey.
        await page.picture_when(
            f"widget video {distro}",
            lambda picture: bool(np.abs(picture.pixels[rows, columns] - expected).mean() < 8),
        )
        assert "Hz" in await page.evaluate(f"{part('rwt-video', '[part=details]')}.textContent")
        assert (
            await page.evaluate(
                f"{part('rwt-video', 'canvas')}.ariaLabel || {part('rwt-video', 'canvas')}"
                ".getAttribute('aria-label')"
            )
            == "What the robot sees"
        )


@BOTH
async def test_teleop_drives_while_a_key_is_held(browser: Browser, distro: str) -> None:
    async with robot(distro) as server:
        odom = Odometry(server)
        async with shown(browser, server, "teleop") as page:
            await page.wait(part("rwt-teleop", "button:not([disabled])"))
            await page.evaluate(
                "window.told = []; for (const name of ['hold', 'drive', 'release'])"
                " document.addEventListener('rwt-' + name, ({ type, detail }) => told.push([type, detail]))"
            )
            await hold_until(page, "w", lambda: odom.linear > 0.55)
            await page.picture(f"widget teleop {distro}")
            await page.keyboard("up", "w")
            await until(lambda: odom.stands)
            told = await page.evaluate("told")
            assert told[0] == ["rwt-hold", {"topic": "/cmd_vel"}]
            assert ["rwt-drive", {"topic": "/cmd_vel", "linear": 0.6, "lateral": 0, "angular": 0}] in told
            assert ["rwt-release", {"topic": "/cmd_vel"}] in told


async def test_teleop_drives_by_stick_and_button(browser: Browser) -> None:
    async with robot() as server:
        odom = Odometry(server)
        async with shown(browser, server, "teleop") as page:
            await page.wait(part("rwt-teleop", "button:not([disabled])"))
            left, top, width, height = await place(page, part("rwt-teleop", ".stick"))
            middle = left + width / 2, top + height / 2
            await page.mouse("move", *middle)
            await page.mouse("down")
            await page.mouse("move", max(1.0, middle[0] - width), middle[1])
            await until(lambda: odom.angular > 1.4)
            await page.mouse("up")
            await until(lambda: odom.stands)
            left, top, width, height = await place(page, part("rwt-teleop", ".drive-back"))
            await page.mouse("move", left + width / 2, top + height / 2)
            await page.mouse("down")
            await until(lambda: odom.linear < -0.3)
            await page.mouse("up")
            await until(lambda: odom.stands)


@pytest.mark.parametrize(
    "happens",
    [
        "dispatchEvent(new Event('blur'))",
        """Object.defineProperty(document, 'hidden', { value: true });
        document.dispatchEvent(new Event('visibilitychange'))""",
        "location.replace('about:blank')",
        "document.querySelector('rwt-teleop').remove()",
        "document.querySelector('rwt-teleop').robotShown.stop.stop()",
    ],
    ids=["blur", "hidden", "left", "removed", "stopped"],
)
async def test_teleop_lets_go_when_its_user_cannot(browser: Browser, happens: str) -> None:
    async with robot() as server:
        odom = Odometry(server)
        async with shown(browser, server, "teleop") as page:
            await page.wait(part("rwt-teleop", "button:not([disabled])"))
            await hold_until(page, "ArrowUp", lambda: odom.linear > 0.3)
            await page.evaluate(happens)
            await until(lambda: odom.stands)
            await page.keyboard("up", "ArrowUp")


@BOTH
async def test_stop_stops_and_keeps_the_page_from_driving(browser: Browser, distro: str) -> None:
    async with robot(distro) as server:
        odom = Odometry(server)
        async with shown(browser, server, "own_page", 700, 1200) as page:
            await page.wait(part("rwt-teleop", "button:not([disabled])"))
            kind = {"jazzy": "nav2_msgs/action/NavigateToPose", "noetic": "nav2_msgs/NavigateToPoseAction"}
            goal = {
                "pose": {"header": {"frame_id": "map"}, "pose": {"position": {"x": 3, "y": -2.5, "z": 0}}}
            }
            await page.evaluate(
                "document.querySelector('rwt-stop').robotShown.session"
                f".commands.sendGoal('/navigate_to_pose', '{kind[distro]}', {json.dumps(goal)})"
                ".outcome.then(({ outcome }) => { window.outcome = outcome }) && undefined"
            )
            await until(lambda: odom.linear > 0.1)
            await page.keyboard("press", "Escape")
            await until(lambda: odom.stands)
            await page.wait("window.outcome === 'canceled'")
            stopped = await page.picture(f"widget stop {distro}")
            assert stopped.count((0xB3, 0x12, 0x1D), 20) > 200
            assert "Stopped" in await page.evaluate(f"{part('rwt-stop', '[part=status]')}.textContent")
            assert await page.evaluate(f"{part('rwt-teleop', 'button')}.disabled")
            await page.evaluate("document.querySelector('rwt-stop').release()")
            await page.wait(f"!{part('rwt-teleop', 'button')}.disabled")


@BOTH
async def test_plot_draws_values_as_they_come(browser: Browser, distro: str) -> None:
    async with robot(distro) as server:
        commands = server.node("driver").advertise("/cmd_vel", "geometry_msgs/Twist")
        async with shown(browser, server, "plot") as page:
            await page.wait(f"{part('rwt-plot', 'canvas')} && {part('rwt-plot', '[part=legend]')}")
            server.node("clock").create_timer(0.1, lambda: commands.publish({"angular": {"z": 1.0}}))
            blue, red = (0x2F, 0x7E, 0xD8), (0xD1, 0x49, 0x5B)

            left, top, width, height = await place(page, part("rwt-plot", ".u-over"))

            def heights(picture: Picture, colour: tuple[int, int, int]) -> list[int]:
                """Return the distance in pixels from the top of the plot to the end of a curve."""
                end = picture.mask(colour, 45)[round(top) : round(top + height), round(left + width) - 6 :]
                return list(np.nonzero(end)[0])

            def drawn(picture: Picture) -> bool:
                # The axis goes from -2 to 2: what is 1 stands a quarter of it above what is 0.
                zero, one = heights(picture, blue), heights(picture, red)
                return bool(zero and one) and all(
                    abs(float(np.median(found)) - expected) < 4
                    for found, expected in ((zero, height / 2), (one, height / 4))
                )

            await page.picture_when(f"widget plot {distro}", drawn)
            names, *rows = (
                (await page.evaluate("document.querySelector('rwt-plot').csv()")).strip().split("\n")
            )
            assert names == "time,twist.twist.linear.x,twist.twist.angular.z"
            assert float(rows[-1].split(",")[2]) == pytest.approx(1.0, abs=0.05)
            await page.evaluate(f"{part('rwt-plot', '[part=button]')}.click()")
            assert await page.evaluate("document.querySelector('rwt-plot').paused") is True


@BOTH
async def test_topic_and_battery_say_what_there_is(browser: Browser, distro: str) -> None:
    async with robot(distro) as server:
        async with shown(browser, server, "topic") as page:
            await page.wait(f"{part('rwt-topic', 'output')}?.textContent.startsWith('hello world')")
            whole = "document.querySelectorAll('rwt-topic')[1].shadowRoot.querySelector('.message')"
            await page.wait(f"{whole}?.textContent.includes('child_frame_id: base_link')")
        async with shown(browser, server, "battery") as page:
            await page.wait(f"{part('rwt-battery', '[part=value]')}?.textContent.includes('100 %')")
            assert await page.evaluate(f"{part('rwt-battery', 'meter')}.low") == 30


#: Of the floor on the map, of walls, and of the robot's body.
FLOOR, WALL, BODY = (0xF4, 0xF3, 0xF9), (0x46, 0x50, 0x5E), (0x22, 0x44, 0x88)


@BOTH
async def test_map_shows_the_robot_and_sends_it_where_it_is_clicked(browser: Browser, distro: str) -> None:
    async with robot(distro) as server:
        odom = Odometry(server)
        async with shown(browser, server, "map", 700, 560) as page:
            await page.wait(f"{part('rwt-map', '[part=button]')} && {part('rwt-map', 'canvas')}")
            await page.evaluate(
                "window.told = []; for (const name of ['goal', 'goal-end'])"
                " document.addEventListener('rwt-' + name, ({ type, detail }) => told.push([type, detail]))"
            )
            # The canvas itself has its size from the first frame on only.
            left, top, width, height = await place(page, part("rwt-map", "[part=view]"))
            # The view begins above the robot.
            await page.picture_when(
                f"widget map {distro}",
                lambda seen: (
                    seen.count(FLOOR, 12) > 30_000
                    and seen.count(WALL, 12) > 1000
                    and near(seen.at(left + width / 2, top + height / 2, 4), BODY, 70)
                ),
            )
            await page.evaluate(f"{part('rwt-map', '[part=button]')}.click()")
            start = round(left + width / 2 + 50), round(top + height / 2)
            await page.drag(start, (start[0] + 40, start[1]))
            await until(lambda: odom.linear > 0.1)
            goal = (await page.evaluate("told"))[0]
            assert goal[0] == "rwt-goal"
            assert goal[1]["frame"] == "map"
            assert (goal[1]["x"], goal[1]["y"], goal[1]["yaw"]) == pytest.approx((-2.1, -2.5, 0), abs=0.4)
            await page.wait("told.length > 1")
            assert (await page.evaluate("told"))[1] == ["rwt-goal-end", {"outcome": "succeeded"}]


@BOTH
async def test_scene_shows_the_robot_in_its_house(browser: Browser, distro: str) -> None:
    async with robot(distro) as server, shown(browser, server, "scene", 700, 560) as page:
        await page.picture_when(
            f"widget scene {distro}",
            lambda seen: (
                seen.count(FLOOR, 12) > 10_000 and seen.count(WALL, 12) > 500 and seen.count(BODY, 60) > 60
            ),
        )


# -- for everybody -------------------------------------------------------------------------------------------


async def faults(page: Page) -> list[str]:
    """Return the violations that axe finds."""
    await page.evaluate(f"{AXE}; undefined")
    found = await page.evaluate("axe.run()")
    return [f"{each['id']}: {node['html']}" for each in found["violations"] for node in each["nodes"]]


@pytest.mark.parametrize("name", PAGES)
async def test_axe_finds_nothing(browser: Browser, name: str) -> None:
    async with robot() as server, shown(browser, server, name) as page:
        await page.wait(
            "[...document.querySelectorAll('*')].filter((each) => each.shadowRoot)"
            ".every((each) => each.robotShown.session.graph.value.topics.size)"
        )
        assert await faults(page) == []


async def test_elements_speak_the_language_of_the_page_or_their_own(browser: Browser) -> None:
    async with robot() as server, shown(browser, server, "teleop") as page:
        forward = f"{part('rwt-teleop', '.drive-forward')}?.getAttribute('aria-label')"
        await page.wait(f"{forward} === 'Forward'")
        await page.evaluate("document.documentElement.lang = 'de'")
        await page.wait(f"{forward} === 'Vorwärts'")
        await page.evaluate("document.querySelector('rwt-teleop').lang = 'en'")
        await page.wait(f"{forward} === 'Forward'")


async def test_a_thumb_can_drive_and_stop(browser: Browser) -> None:
    async with robot() as server, shown(browser, server, "own_page", 390, 844) as page:
        await page.wait(part("rwt-teleop", "button:not([disabled])"))
        await page.picture("widget phone")
        assert await page.evaluate("document.documentElement.scrollWidth") <= 390
        for what in (
            part("rwt-stop", "button"),
            part("rwt-teleop", ".drive-back"),
            part("rwt-teleop", ".stick"),
        ):
            _, _, width, height = await place(page, what)
            assert min(width, height) >= 44, what


# -- what is wrong is said -----------------------------------------------------------------------------------


def bare(body: str) -> str:
    """A page with these elements, as a script for a blank page of the robot's."""
    return f"document.querySelector('main').innerHTML = {body!r}"


@pytest.mark.parametrize(
    ("element", "says"),
    [
        ('<rwt-topic topic="/gone"></rwt-topic>', "The robot has no topic /gone."),
        ("<rwt-topic></rwt-topic>", "The attribute topic is missing."),
        ('<rwt-topic topic="/odom" field="pose.nothing"></rwt-topic>', "/odom has no field pose.nothing."),
        (
            '<rwt-video topic="/odom"></rwt-video>',
            "/odom has the type nav_msgs/msg/Odometry; this element shows",
        ),
        (
            '<rwt-battery topic="/odom"></rwt-battery>',
            "/odom has the type nav_msgs/msg/Odometry; this element shows",
        ),
        ('<rwt-plot topic="/odom" field="a.b"></rwt-plot>', "/odom has no field a.b."),
        (
            '<rwt-topic topic="<img src=x onerror=alert(1)>"></rwt-topic>',
            "The robot has no topic <img src=x onerror=alert(1)>.",
        ),
        (
            '<rwt-stop robot="robot:9090"></rwt-stop>',
            "must be a URL such as ws://robot:9090, not robot:9090.",
        ),
    ],
)
async def test_mistakes_are_said_in_the_element(browser: Browser, element: str, says: str) -> None:
    async with robot() as server, shown(browser, server, "topic") as page:
        quoted = element.replace("<img", "&lt;img").replace("onerror=alert(1)>", "onerror=alert(1)&gt;")
        await page.evaluate(bare(quoted))
        name = element[1:].split(">")[0].split()[0]
        await page.wait(f"{part(name, '[part=problem]')}?.textContent.includes({says!r})")
        assert await page.evaluate("document.querySelectorAll('img').length") == 0


async def test_a_role_that_may_not_is_told(browser: Browser) -> None:
    roles, auth = {"guest": {"subscribe": ["/odom"]}}, {"default_role": "guest"}
    async with robot(roles=roles, auth=auth) as server, shown(browser, server, "topic") as page:
        await page.evaluate(
            bare(
                "<rwt-teleop topic='/cmd_vel'></rwt-teleop><rwt-stop></rwt-stop>"
                "<rwt-video topic='/camera/image_raw'></rwt-video>"
            )
        )
        await page.wait(
            f"{part('rwt-teleop', '[part=problem]')}?.textContent"
            " === 'Your role (guest) may not publish on /cmd_vel.'"
        )
        await page.wait(
            f"{part('rwt-video', '[part=problem]')}?.textContent"
            " === 'Your role (guest) may not subscribe to /camera/image_raw.'"
        )
        await page.wait(f"{part('rwt-stop', '[part=status]')}?.textContent.includes('nothing to stop')")


TOKEN = "0123456789abcdef0123"


async def test_a_token_is_asked_for_and_kept_for_the_tab(browser: Browser) -> None:
    auth = {"tokens": {"eye": {"token": TOKEN, "role": "viewer"}}}
    async with robot(auth=auth) as server, shown(browser, server, "battery") as page:
        page.forgive("WebSocket", "401", REFUSED)
        field = part("rwt-battery", "input[name=token]")
        await page.wait(field)
        assert await faults(page) == []
        await page.evaluate(f"{field}.focus()")
        for key in TOKEN:
            await page.keyboard("press", key)
        await page.keyboard("press", "Enter")
        await page.wait(f"{part('rwt-battery', '[part=value]')}?.textContent.includes('100 %')")
        assert await page.evaluate("location.href.includes('?')") is False
        await page.evaluate("location.reload()")
        await page.wait(f"{part('rwt-battery', '[part=value]')}?.textContent.includes('100 %')")


async def test_strange_values_break_nothing(browser: Browser) -> None:
    async with robot(demo=False) as server:
        node = server.node("strange")
        numbers = node.advertise("/number", "std_msgs/Float64", latch=True)
        text = node.advertise("/text", "std_msgs/String", latch=True)
        battery = node.advertise("/battery", "sensor_msgs/BatteryState", latch=True)
        image = node.advertise("/image", "sensor_msgs/Image", latch=True)
        text.publish({"data": "<img src=x onerror=alert(1)>" + "x" * 16_000_000})
        battery.publish({"percentage": math.nan})
        image.publish({"height": 1, "width": 1, "encoding": "no such", "step": 1, "data": b"1"})
        node.create_timer(0.05, lambda: numbers.publish({"data": math.nan}))
        async with shown(browser, server, "topic") as page:
            await page.evaluate(
                bare(
                    "<rwt-plot topic='/number'></rwt-plot><rwt-topic topic='/text' field='data'></rwt-topic>"
                    "<rwt-battery></rwt-battery><rwt-video topic='/image'></rwt-video>"
                )
            )
            await page.wait(f"{part('rwt-topic', 'output')}?.textContent.startsWith('<img src=x')")
            assert await page.evaluate(f"{part('rwt-topic', 'output')}.textContent.length") < 1000
            await page.wait(f"{part('rwt-plot', '[part=value]')}?.textContent === '\\u2013'")
            await page.wait(
                f"{part('rwt-battery', '[part=status]')}?.textContent.includes('does not report')"
            )
            await page.wait(f"{part('rwt-video', '[part=problem]')}?.textContent.includes('no such')")


async def test_a_robot_that_comes_back_is_shown_again(browser: Browser) -> None:
    async with AsyncExitStack() as stack:
        first = await stack.enter_async_context(AsyncExitStack())
        server = await first.enter_async_context(robot())
        url = server.urls[0]
        page = await stack.enter_async_context(shown(browser, server, "battery"))
        page.forgive("WebSocket", "ERR_CONNECTION", REFUSED)
        await page.wait(f"{part('rwt-battery', '[part=value]')}")
        await first.aclose()
        await page.wait(f"{part('rwt-battery', '[part=problem]')}?.textContent.includes('lost')")
        await stack.enter_async_context(Server(url, demo=True))
        await page.wait(f"!{part('rwt-battery', '[part=problem]')}")


# -- in pages of others --------------------------------------------------------------------------------------


def test_the_documentation_shows_the_pages_that_are_served() -> None:
    documented = {
        name: block.code
        for block in ALL_BLOCKS
        if (name := block.value("file"))
        and block.value("run") == "browser"
        and "/web/widgets.js" in block.code
    }
    assert documented == {
        path.name: path.read_text(encoding="utf-8") for path in (ROOT / "web" / "pages").glob("*.html")
    }


@contextmanager
def elsewhere(tmp_path: Path, server: Server) -> Iterator[str]:
    """The files of a folder on another server, in which they name that of the robot."""
    port = int(server.urls[0].rsplit(":", 1)[1])
    for path in tmp_path.iterdir():
        path.write_text(path.read_text(encoding="utf-8").replace("9090", str(port)), encoding="utf-8")
    web = free_port()
    command = [sys.executable, "-m", "http.server", str(web), "--bind", "127.0.0.1"]
    with Running(command, tmp_path, commands_folder(tmp_path / "commands")) as plain:
        plain.wait_for_port(web)
        yield f"http://127.0.0.1:{web}/"


def bundled(source: str) -> str:
    """A script with the packages that it imports."""
    command = [
        str(NODE / "node_modules/.bin/esbuild"),
        "--bundle",
        "--format=esm",
        "--jsx=automatic",
        "--loader=jsx",
    ]
    done = subprocess.run(command, input=source, cwd=NODE, capture_output=True, text=True, check=True)
    return str(done.stdout)


@pytest.mark.parametrize("source", ["app.jsx", "app.vue.js"])
async def test_react_and_vue_use_the_elements(browser: Browser, tmp_path: Path, source: str) -> None:
    blocks = {block.value("file"): block.code for block in ALL_BLOCKS if block.page.stem == "own-page-react"}
    (tmp_path / "index.html").write_text(blocks["index.html"], encoding="utf-8")
    (tmp_path / "app.js").write_text(bundled(blocks[source]), encoding="utf-8")
    async with robot() as server:
        odom = Odometry(server)
        with elsewhere(tmp_path, server) as site:
            async with browser.page(f"{site}index.html", 700, 900) as page:
                await page.wait(f"{part('rwt-video', 'canvas.shown')}?.width === 640")
                await page.wait(part("rwt-teleop", "button:not([disabled])"))
                assert await page.evaluate("document.querySelector('rwt-teleop').maxLinear") == 0.3
                await page.click("main > button")
                await page.wait("document.querySelector('rwt-teleop').maxLinear === 0.6")
                await page.evaluate(f"{part('rwt-teleop', '.drive-forward')}.focus()")
                await hold_until(page, "w", lambda: odom.linear > 0.5)
                await page.wait("document.querySelector('#speed').textContent === '0.60 m/s'")
                await page.keyboard("up", "w")
                await until(lambda: odom.stands)


async def test_a_page_of_another_server_in_an_iframe(browser: Browser, tmp_path: Path) -> None:
    own = (ROOT / "web" / "pages" / "own_page.html").read_text(encoding="utf-8")
    (tmp_path / "own_page.html").write_text(own, encoding="utf-8")
    frame = '<!doctype html><iframe src="own_page.html" title="robot" width="600" height="1100"></iframe>'
    (tmp_path / "index.html").write_text(f"{frame}<input>", encoding="utf-8")
    async with robot() as server:
        odom = Odometry(server)
        with elsewhere(tmp_path, server) as site:
            async with browser.page(f"{site}index.html", 700, 1200) as page:
                inner = "document.querySelector('iframe').contentDocument"
                button = f"{inner}.querySelector('rwt-teleop')?.shadowRoot.querySelector('.drive-forward')"
                await page.wait(f"{button} && !{button}.disabled")
                await page.evaluate(f"{button}.focus()")
                await hold_until(page, "ArrowUp", lambda: odom.linear > 0.3)
                # The page around takes the keyboard away: the frame does not hear that the key is let go.
                await page.evaluate("document.querySelector('input').focus()")
                await until(lambda: odom.stands)
                await page.keyboard("up", "ArrowUp")
