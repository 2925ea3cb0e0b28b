"""Every panel of the robot's page on the demo robot: what it shows, and what it does to the robot."""

from __future__ import annotations

import io
import json
import math
import os
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

import anyio
import numpy as np
import pytest
from PIL import Image

from rwt import Server
from rwt.extensions.recording import open_recording
from rwt_participant.qos import LATCHED
from tests.browser.driver import IS_MUTE, LEFT_MESH, LEFT_STREAM, MUTE, Browser, Page
from tests.browser.grip import hold_until
from tests.browser.stand import Stand, stand
from tests.waiting import until

pytestmark = pytest.mark.anyio

DISTROS = pytest.mark.parametrize("distro", ["jazzy", "noetic"])
WEB = Path(__file__).parents[2] / "web"
AXE = WEB / "node_modules" / "axe-core" / "axe.min.js"
KINDS = (
    *(
        "scene",
        "camera",
        "wall",
        "teleop",
        "joints",
        "goal",
        "approvals",
        "device",
        "topics",
        "plot",
        "values",
        "position",
        "services",
        "actions",
        "parameters",
    ),
    *("log", "diagnostics", "battery", "frames", "nodes", "player", "server"),
)


#: What is to be hit by a finger and is less than 44 pixels wide or high; a label is hit as well.
SMALL = """[...document.querySelectorAll('button, input, select, summary')]
  .filter((it) => it.checkVisibility({ visibilityProperty: true }))
  .map((it) => [it, (it.type === 'checkbox' ? it.labels[0] : it).getBoundingClientRect()])
  .filter(([, { width, height }]) => width && Math.min(width, height) < 43.9)
  .map(([it, { width, height }]) => `${it.outerHTML.slice(0, 120)}: ${width} x ${height}`)"""


@asynccontextmanager
async def panel(
    browser: Browser,
    distro: str,
    kind: str,
    *,
    robot: bool = True,
    size: tuple[int, int] = (500, 400),
    **config: object,
) -> AsyncIterator[tuple[Stand, Page]]:
    """The page with one panel open."""
    async with (
        stand(distro, browser.built, robot=robot) as served,
        browser.page(f"{served.url}healthz", *size) as page,
    ):
        await open_panels(page, served.url, [(kind, config)])
        yield served, page


async def open_panels(
    page: Page,
    url: str,
    panels: list[tuple[str, dict[str, object]]],
    *,
    robot: str = "",
    dock: dict[str, Any] | None = None,
) -> None:
    """Have the page at a URL begin with these panels, for its own robot or another one, docked as given."""
    layout = {
        "version": 1,
        "panels": [{"id": kind, "kind": kind, "config": config} for kind, config in panels],
        "dock": dock,
    }
    key = f"rwt-last-layout{robot or url.replace('http', 'ws', 1)}"
    await page.evaluate(f"localStorage.setItem({json.dumps(key)}, {json.dumps(json.dumps(layout))})")
    await page.goto(url)
    await page.wait("document.querySelector('.state-open')")


async def release(page: Page) -> None:
    """Hold the control that releases the stop, by the keyboard."""
    await page.evaluate("document.querySelector('.release').focus()")
    await page.keyboard("down", "Enter")
    await page.wait("!document.querySelector('.stopped')")
    await page.keyboard("up", "Enter")


def text(selector: str) -> str:
    return f"(document.querySelector({json.dumps(selector)})?.textContent ?? '')"


async def fill(page: Page, name: str, value: str) -> None:
    await page.evaluate(
        f"""((name, value) => {{
          const labels = [...document.querySelectorAll(".message-form label")];
          const input = labels.find(l => l.textContent.startsWith(name)).querySelector("input");
          input.value = value;
          input.dispatchEvent(new Event("input", {{ bubbles: true }}));
        }})({json.dumps(name)}, {json.dumps(value)})"""
    )


@DISTROS
async def test_a_service_is_called_from_a_form(browser: Browser, distro: str) -> None:
    async with panel(browser, distro, "services", name="/add_two_ints") as (_, page):
        await page.wait("document.querySelector('.message-form input')")
        await fill(page, "a", "20")
        await fill(page, "b", "22")
        await page.click(".panel-services [type=submit]")
        await page.wait(f"{text('.panel-services [role=status]')}.includes('42')")
        await fill(page, "a", "1.5")
        await page.wait("document.querySelector('.panel-services [type=submit]').disabled")


@DISTROS
async def test_a_goal_is_sent_with_feedback_and_result(browser: Browser, distro: str) -> None:
    async with panel(browser, distro, "actions", name="/fibonacci") as (_, page):
        await page.wait("document.querySelector('.message-form input')")
        await fill(page, "order", "11")
        await page.click(".panel-actions [type=submit]")
        await page.wait(f"{text('.panel-actions')}.includes('Feedback')")
        # All twelve numbers, without a click.
        result = text(".panel-actions [role=status]")
        await page.wait(f"{result}.includes('Succeeded') && /sequence.*34.*55.*89/s.test({result})")


async def test_a_goal_is_cancelled(browser: Browser) -> None:
    async with panel(browser, "jazzy", "actions", name="/fibonacci") as (_, page):
        await page.wait("document.querySelector('.message-form input')")
        await fill(page, "order", "40")
        await page.click(".panel-actions [type=submit]")
        await page.wait(f"{text('.panel-actions')}.includes('Feedback')")
        await page.click("text=Cancel")
        await page.wait(f"{text('.panel-actions [role=status]')}.includes('Cancelled')")


async def test_a_parameter_is_set_and_one_that_does_not_fit_is_refused(browser: Browser) -> None:
    async with panel(browser, "jazzy", "parameters", node="/demo_robot") as (served, page):
        field = "document.getElementById('parameter /demo_robot:max_speed')"

        async def set_to(value: str) -> None:
            await page.evaluate(
                f"(() => {{ {field}.value = {value!r};"
                f" {field}.dispatchEvent(new Event('change', {{bubbles: true}})) }})()"
            )

        await page.wait(f"{field}?.value === '0.8'")
        await set_to("0.3")
        speeds: list[float] = []
        served.node.subscribe("/odom", lambda odom: speeds.append(odom.twist.twist.linear.x))
        await page.click("text=Reload")
        await page.wait(f"{field}?.value === '0.3'")
        command = served.node.advertise("/cmd_vel", "geometry_msgs/Twist")
        command.publish({"linear": {"x": 5.0}})
        await until(lambda: bool(speeds) and max(speeds) == pytest.approx(0.3))
        await set_to('"fast"')
        await page.wait(f"{text('.panel-parameters .problem')}.includes('number')")
        await set_to("-7")
        await page.wait(f"{text('.panel-parameters .problem')}.length > 5")


@DISTROS
async def test_the_log_is_filtered(browser: Browser, distro: str) -> None:
    async with panel(browser, distro, "log") as (served, page):
        await page.wait("document.querySelector('.log-entries')")
        kind, warn, info = (
            ("rcl_interfaces/Log", 30, 20) if distro == "jazzy" else ("rosgraph_msgs/Log", 4, 2)
        )
        rosout = served.node.advertise("/rosout", kind)
        # What is published before the panel has subscribed is not for it.
        while not await page.evaluate(f"{text('.log-entries')}.includes('fine')"):
            rosout.publish({"level": warn, "name": "motor", "msg": "hot <b>very</b>"})
            rosout.publish({"level": info, "name": "motor", "msg": "fine"})
            await anyio.sleep(0.1)
        await page.wait(f"{text('.log-entries')}.includes('hot <b>very</b>')")
        await page.evaluate(
            "((s) => { s.value = '2'; s.dispatchEvent(new Event('change', {bubbles: true})) })"
            "(document.querySelector('.panel-log select'))"
        )
        await page.wait(f"!{text('.log-entries')}.includes('fine') && {text('.log-entries')}.includes('hot')")


@DISTROS
@pytest.mark.parametrize(
    ("kind", "selector", "shown"),
    [
        ("diagnostics", ".diagnostics", "demo_robot: motors"),
        ("battery", ".battery", "/battery_state"),
        ("frames", ".frames", "base_link"),
        ("nodes", ".nodes-picture svg", "/demo_robot"),
        ("server", ".server", "ws://127.0.0.1"),
        ("server", ".server", "Loop lag"),
    ],
)
async def test_what_is_there_is_shown(
    browser: Browser, distro: str, kind: str, selector: str, shown: str
) -> None:
    async with panel(browser, distro, kind) as (_, page):
        await page.wait(f"{text(selector)}.includes({json.dumps(shown)})")


async def test_numbers_are_plotted_paused_and_exported(browser: Browser) -> None:
    lines = [{"topic": "/number", "path": "data"}]
    async with (
        stand("jazzy", browser.built, robot=False) as served,
        browser.page(f"{served.url}healthz", 900, 700) as page,
    ):
        number = served.node.advertise("/number", "std_msgs/Float64", latch=True)
        number.publish({"data": 0.0})
        await open_panels(page, served.url, [("plot", {"lines": lines})])
        await page.wait("document.querySelector('.plot-chart canvas')")
        await until(
            lambda: any(topic.name == "/number" and topic.subscribers for topic in served.graph.topics())
        )
        values = iter(range(10**9))
        blue = (11, 91, 211)

        def drawn(picture: Any) -> bool:
            for _ in range(20):
                number.publish({"data": float(next(values) % 37)})
            number.publish({"data": float("nan")})
            return int(picture.count(blue, 30)) > 600

        await page.picture_when("plot", drawn)
        await page.click(".plot-tools >> text=Pause")
        await page.evaluate(
            """(() => {
              globalThis.saved = null;
              const made = URL.createObjectURL;
              URL.createObjectURL = (blob) => {
                blob.text().then((text) => { globalThis.saved = text });
                return made(blob);
              };
            })()"""
        )
        await page.click(".plot-tools >> text=Export CSV")
        await page.wait("globalThis.saved")
        csv = str(await page.evaluate("globalThis.saved")).splitlines()
        assert csv[0] == 'time,"/number data"'
        assert any(line.endswith(",36") for line in csv)


async def test_a_player_is_paused_and_sped_up_through_its_services(browser: Browser) -> None:
    async with panel(browser, "jazzy", "player", robot=False) as (served, page):
        state = {"paused": False, "rate": 1.0}

        def toggle(request: Any) -> dict[str, object]:
            state["paused"] = not state["paused"]
            return {}

        def set_rate(request: Any) -> dict[str, object]:
            state["rate"] = request.rate
            return {"success": True}

        name = "/rosbag2_player"
        served.node.advertise_service(f"{name}/toggle_paused", "rosbag2_interfaces/TogglePaused", toggle)
        served.node.advertise_service(
            f"{name}/is_paused", "rosbag2_interfaces/IsPaused", lambda request: {"paused": state["paused"]}
        )
        served.node.advertise_service(
            f"{name}/get_rate", "rosbag2_interfaces/GetRate", lambda request: {"rate": state["rate"]}
        )
        served.node.advertise_service(f"{name}/set_rate", "rosbag2_interfaces/SetRate", set_rate)
        await page.click(".player >> text=Pause")
        await page.wait(f"{text('.player button')} === 'Resume'")
        assert state["paused"]
        await page.evaluate(
            "((s) => { s.value = '2'; s.dispatchEvent(new Event('change', {bubbles: true})) })"
            "(document.querySelector('.player select'))"
        )
        await until(lambda: state["rate"] == 2.0)


@DISTROS
async def test_the_device_is_a_sensor_when_it_is_asked_to_be(browser: Browser, distro: str) -> None:
    async with panel(browser, distro, "device", robot=False) as (served, page):
        imu: list[Any] = []
        pictures: list[Any] = []
        served.node.subscribe("/device/imu", imu.append, "sensor_msgs/Imu")
        served.node.subscribe(
            "/device/camera/image/compressed", pictures.append, "sensor_msgs/CompressedImage"
        )
        tilt = (
            "dispatchEvent(new DeviceMotionEvent('devicemotion', {"
            " accelerationIncludingGravity: {x: 1, y: 2, z: 9},"
            " rotationRate: {alpha: 90, beta: 45, gamma: -9} }))"
        )
        await page.wait("document.querySelector('[name=motion]:not(:disabled)')")
        await page.evaluate(tilt)
        assert imu == []
        await page.click("[name=motion]")
        await page.wait(f"{tilt} && /[1-9]/.test({text('.sensor:has([name=motion])')})")
        await until(lambda: bool(imu))
        assert (imu[0].linear_acceleration.x, imu[0].linear_acceleration.z) == (1, 9)
        rates = imu[0].angular_velocity
        # The axes that browsers use: alpha about x, beta about y, gamma about z.
        assert (rates.x, rates.y, rates.z) == pytest.approx((1.5708, 0.7854, -0.1571), abs=1e-3)
        await page.click("[name=camera]")
        await until(lambda: bool(pictures))
        with Image.open(io.BytesIO(bytes(pictures[0].data))) as picture:
            assert (picture.format, picture.width) == ("JPEG", 640)


AXES = ("x", "y", "z")
#: Axis of each angle, for rates and for the orientation (w3c/deviceorientation#43, #44).
RATE_AXES = {"alpha": "x", "beta": "y", "gamma": "z"}
ANGLE_AXES = {"alpha": "z", "beta": "x", "gamma": "y"}


async def test_each_axis_of_a_moved_device_is_an_axis_of_the_message(browser: Browser) -> None:
    async with panel(browser, "jazzy", "device", robot=False) as (served, page):
        heard: list[Any] = []
        served.node.subscribe("/device/imu", heard.append, "sensor_msgs/Imu")
        await page.click("[name=motion]:not(:disabled)")

        async def message(**moved: dict[str, float]) -> Any:
            """Return a message of a device that moves, and is turned, as given."""
            zero = dict.fromkeys(RATE_AXES, 0)
            motion = {
                "accelerationIncludingGravity": dict.fromkeys(AXES, 0) | moved.get("acceleration", {}),
                "rotationRate": zero | moved.get("rates", {}),
            }
            turned = zero | moved.get("angles", {})
            # A mark, by which the message is recognised.
            motion["accelerationIncludingGravity"]["z"] += len(heard) + 1000
            events = (
                f"dispatchEvent(new DeviceOrientationEvent('deviceorientation', {json.dumps(turned)}))"
                f" && dispatchEvent(new DeviceMotionEvent('devicemotion', {json.dumps(motion)}))"
            )
            expected = motion["accelerationIncludingGravity"]["z"]
            # Of events that follow each other closely, some are left out.
            while not heard or heard[-1].linear_acceleration.z != expected:
                await page.evaluate(events)
                await anyio.sleep(0.05)
            return heard[-1]

        for name, axis in RATE_AXES.items():
            for degrees in (90, -45):
                found = (await message(rates={name: degrees})).angular_velocity
                expected = {each: math.radians(degrees) * (each == axis) for each in AXES}
                assert {each: getattr(found, each) for each in AXES} == pytest.approx(expected, abs=1e-6)
        for axis in ("x", "y"):
            for acceleration in (3, -2):
                found = (await message(acceleration={axis: acceleration})).linear_acceleration
                assert (found.x, found.y) == (acceleration * (axis == "x"), acceleration * (axis == "y"))
        for name, axis in ANGLE_AXES.items():
            for degrees in (90, -60):
                found = (await message(angles={name: degrees})).orientation
                half = math.radians(degrees) / 2
                expected = {each: math.sin(half) * (each == axis) for each in AXES}
                assert {each: getattr(found, each) for each in AXES} == pytest.approx(expected, abs=1e-6)
                assert found.w == pytest.approx(math.cos(half), abs=1e-6)


@DISTROS
async def test_unknown_sensor_values_are_nan(browser: Browser, distro: str) -> None:
    async with panel(browser, distro, "device", robot=False) as (served, page):
        fixes: list[Any] = []
        batteries: list[Any] = []
        imu: list[Any] = []
        served.node.subscribe("/device/fix", fixes.append, "sensor_msgs/NavSatFix")
        served.node.subscribe("/device/battery", batteries.append, "sensor_msgs/BatteryState")
        served.node.subscribe("/device/imu", imu.append, "sensor_msgs/Imu")
        await page.evaluate(
            "(() => {"
            " const coords = {latitude: 50, longitude: 7, accuracy: 3, altitude: null};"
            " navigator.geolocation.watchPosition = (done) => {"
            "  done({coords, timestamp: Date.now()});"
            "  return 1;"
            " };"
            " navigator.getBattery = async () => ({level: 0.5, charging: true});"
            "})()"
        )
        # A switch is enabled if the browser has the sensor when the panel is drawn.
        await page.wait("document.querySelector('[name=position]:not(:disabled)')")
        await page.click("[name=position]")
        await until(lambda: bool(fixes))
        assert (fixes[0].latitude, fixes[0].longitude) == (50, 7)
        assert math.isnan(fixes[0].altitude)
        if os.environ.get("BROWSER") != "firefox":  # It has no battery API, so there is no switch.
            await page.click("[name=battery]")
            await until(lambda: bool(batteries))
            state = batteries[0]
            assert state.percentage == 0.5
            unknown = (state.voltage, state.temperature, state.current, state.charge, state.capacity)
            assert all(map(math.isnan, (*unknown, state.design_capacity)))
        await page.click("[name=motion]")
        await page.wait(
            "dispatchEvent(new DeviceMotionEvent('devicemotion', {"
            " accelerationIncludingGravity: {x: 1, y: 2, z: 9} }))"
            f" && /[1-9]/.test({text('.sensor:has([name=motion])')})"
        )
        await until(lambda: bool(imu))
        assert imu[0].angular_velocity_covariance[0] == -1


@pytest.mark.parametrize("sensor", ["camera", "microphone"])
async def test_a_sensor_switched_off_before_it_is_permitted_is_stopped(browser: Browser, sensor: str) -> None:
    async with panel(browser, "jazzy", "device", robot=False) as (served, page):
        await page.wait(f"document.querySelector('[name={sensor}]:not(:disabled)')")
        # The prompt is open until the test answers it.
        await page.evaluate(
            """(() => {
              const devices = navigator.mediaDevices;
              const ask = devices.getUserMedia.bind(devices);
              globalThis.prompts = [];
              globalThis.tracks = [];
              devices.getUserMedia = async (wanted) => {
                await new Promise((answer) => prompts.push(answer));
                const stream = await ask(wanted);
                tracks.push(...stream.getTracks());
                return stream;
              };
            })()"""
        )
        await page.click(f"[name={sensor}]")
        await page.wait("prompts.length === 1")
        await page.click(f"[name={sensor}]")
        await page.click(f"[name={sensor}]")
        await page.wait("prompts.length === 2")
        await page.click(f"[name={sensor}]")
        await page.evaluate("prompts.forEach((answer) => answer())")
        await page.wait("tracks.length === 2 && tracks.every(({readyState}) => readyState === 'ended')")
        await until(
            lambda: (
                not any(
                    topic.publishers for topic in served.graph.topics() if topic.name.startswith("/device/")
                )
            )
        )
        assert not await page.evaluate("document.querySelector('.sensor .problem')")


@pytest.mark.skipif(IS_MUTE, reason=MUTE)
@DISTROS
async def test_the_microphone_is_heard_when_it_is_asked_for(browser: Browser, distro: str) -> None:
    async with panel(browser, distro, "device", robot=False, namespace="/phone") as (served, page):
        sound: list[bytes] = []
        described: list[Any] = []
        served.node.subscribe(
            "/phone/audio/audio", lambda said: sound.append(bytes(said.data)), "audio_common_msgs/AudioData"
        )
        served.node.subscribe("/phone/audio/audio_info", described.append, "audio_common_msgs/AudioInfo")
        await page.wait("document.querySelector('[name=microphone]:not(:disabled)')")
        assert sound == []
        await page.click("[name=microphone]")

        def loudest() -> int:
            return max((int(np.abs(np.frombuffer(each, "<i2")).max()) for each in sound), default=0)

        # The browser's test device beeps.
        await until(lambda: bool(described) and loudest() > 1000)
        info = described[0]
        assert (info.channels, info.sample_format, info.bitrate) == (1, "S16LE", 16 * info.sample_rate)
        assert {len(each) for each in sound} == {2 * -(-info.sample_rate // 20)}
        assert await page.evaluate(f"{text('.sensor:has([name=microphone])')}.includes('sent')")
        await page.click("[name=microphone]")
        await until(
            lambda: all(
                topic.name != "/phone/audio/audio" or not topic.publishers for topic in served.graph.topics()
            )
        )


async def test_a_recording_is_begun_and_ended_from_the_page(browser: Browser, tmp_path: Path) -> None:
    async with (
        Server("ws://127.0.0.1:0", demo=True, recorder={"folder": tmp_path}) as server,
        browser.page(f"{server.urls[0].replace('ws', 'http', 1)}/healthz", 700, 500) as page,
    ):
        await open_panels(page, server.urls[0].replace("ws", "http", 1) + "/", [("player", {})])
        await page.click(".recorder input")
        for key in "run 1":
            await page.keyboard("press", key)
        await page.click("text=Start recording")
        await page.wait(f"{text('.recorder .problem')}.includes('expected up to 64 of the characters')")
        await page.evaluate(
            "((i) => { i.value = 'run'; i.dispatchEvent(new Event('input', {bubbles: true})) })"
            "(document.querySelector('.recorder input'))"
        )
        await page.click("text=Start recording")
        await page.wait(f"/run_.*: .* messages, .* of 1.1 GB/.test({text('.recorder [role=status]')})")
        assert not await page.evaluate("document.querySelector('.recorder .problem')")
        await page.click("text=Stop recording")
        await page.wait(f"{text('.recorder [role=status]')}.startsWith('Last: run_')")
        await page.evaluate(
            """globalThis.saved = [];
            HTMLAnchorElement.prototype.click = function () { saved.push(this.download); }"""
        )
        await page.click('[aria-label^="Download run_"]')
        await page.wait("globalThis.saved[0]?.startsWith('run_')")
        assert await violations(page) == []
    with open_recording(files_in(tmp_path)) as recording:
        assert "/odom" in {topic.name for topic in recording.topics}


def files_in(folder: Path) -> list[Path]:
    return list(folder.iterdir())


async def test_the_page_speaks_german_to_those_who_do(browser: Browser) -> None:
    async with (
        stand("jazzy", browser.built) as served,
        browser.page(served.url, 1300, 800, language="de-AT") as page,
    ):
        await page.wait(f"{text('.stop')} === 'Stopp'")
        await page.wait(f"{text('.drive')}.includes('Halten bewegt')")
        assert await page.evaluate("document.documentElement.lang") == "de"
        for english in ("Add panel", "Layouts", "Topics with", "Turn left"):
            assert not await page.evaluate(f"document.body.textContent.includes({english!r})"), english


def texts(language: str) -> dict[str, str]:
    """Return the texts of the page by their keys."""
    table = (WEB / "src" / "i18n" / f"{language}.ts").read_text(encoding="utf-8")
    return dict(re.findall(r'^  "([^"]+)":\s+"((?:[^"\\]|\\.)*)",$', table, re.MULTILINE))


def english_alone() -> list[str]:
    """Return the texts of several words that a German page does not have."""
    english, german = texts("en"), texts("de")
    assert english.keys() == german.keys() and len(english) > 400
    both = set(german.values())
    return [each for each in english.values() if " " in each and "{" not in each and each not in both]


#: What is read and what a screen reader says.
ALL_TEXTS = """[
  document.body.innerText,
  ...['aria-label', 'title', 'placeholder'].flatMap((name) =>
    [...document.querySelectorAll(`[${name}]`)].map((it) => it.getAttribute(name))),
].join('\\n')"""


@pytest.mark.parametrize(
    ("theme", "width", "height", "language"),
    [
        ("light", 1300, 800, "en"),
        ("dark", 1300, 800, "de-AT"),
        ("light", 390, 844, "de-AT"),
        ("dark", 390, 844, "en"),
    ],
)
async def test_axe_finds_nothing(
    browser: Browser, theme: str, width: int, height: int, language: str
) -> None:
    """In both languages; of a German page, no text is English."""
    foreign = english_alone() if language != "en" else []
    async with (
        stand("jazzy", browser.built) as served,
        browser.page(f"{served.url}healthz", width, height, language=language) as page,
    ):
        await page.evaluate(f"localStorage.setItem('rwt-theme', {theme!r})")
        page.forgive(LEFT_MESH, LEFT_STREAM)
        found: list[str] = []
        for kind in KINDS:
            configs: dict[str, dict[str, object]] = {
                "topics": {"topic": "/odom"},
                "services": {"name": "/add_two_ints"},
                "actions": {"name": "/fibonacci"},
                "values": {"fields": [{"topic": "/odom", "path": "pose.pose.position.x"}]},
            }
            config = configs.get(kind, {})
            await page.goto(f"{served.url}healthz")
            await open_panels(page, served.url, [(kind, config)])
            await page.wait(f"document.querySelector('.panel-{kind}')?.children.length")
            if kind == "joints":
                await page.wait("document.querySelector('.jog input')")
            shown = await page.evaluate(ALL_TEXTS)
            found += [f"{kind}: in English: {each}" for each in foreign if each in shown]
            found += [f"{kind}: {violation}" for violation in await violations(page)]
            if width < 400:
                found += [f"{kind}: smaller than a finger: {each}" for each in await page.evaluate(SMALL)]
        assert found == []


#: Each animation stands where a text that fades is faintest; transitions are at their ends.
HELD = """document.getAnimations().forEach((it) => {
  const { duration, iterations } = it.effect.getComputedTiming();
  if (it instanceof CSSTransition) it.finish();
  else { it.pause(); it.currentTime = iterations === 1 ? 0 : duration / 2; }
})"""
GOES_ON = "document.getAnimations().forEach((it) => it.playState === 'paused' && it.play())"


async def violations(page: Page) -> list[str]:
    """Return the violations that axe finds on a page, whose animations are held where they hide the most."""
    await page.evaluate(AXE.read_text(encoding="utf-8") + "; 1")
    await page.evaluate(HELD)
    found: list[str] = await page.evaluate(
        "axe.run({ resultTypes: ['violations'] }).then(r => r.violations.map(v =>"
        " v.id + ': ' + v.nodes.map(n => n.target.join(' ') + ' ' + n.failureSummary).join(' | ')))"
    )
    await page.evaluate(GOES_ON)
    return found


async def test_a_panel_that_waits_is_legible_at_every_moment(browser: Browser) -> None:
    async with panel(browser, "jazzy", "values", robot=False) as (served, page):
        served.node.advertise("/silent", "std_msgs/Float64")
        await open_panels(page, served.url, [("values", {"fields": [{"topic": "/silent", "path": "data"}]})])
        await page.wait(f"{text('.waiting')}.includes('/silent')")
        assert await violations(page) == []


async def test_the_first_load_is_small_and_asks_no_other_host(browser: Browser) -> None:
    async with stand("jazzy", browser.built) as served, browser.page(served.url, 1300, 800) as page:
        await page.wait("document.querySelector('.scene-view')?.robotScene?.base")
        entries = await page.evaluate(
            "performance.getEntriesByType('resource').map(r => [r.name, r.transferSize])"
        )
        foreign = [name for name, _ in entries if not name.startswith((served.url, "blob:", "data:"))]
        assert foreign == []
        page_files = [size for name, size in entries if "/web/" in name]
        assert sum(page_files) < 700 * 1024
        assert not await page.evaluate("document.querySelector('script:not([src]), style')")


async def test_a_layout_that_names_a_robot_of_another_page_is_no_way_into_it(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0") as server,
        browser.page(
            f"{server.urls[0].replace('ws', 'http', 1)}/?robot={quote('javascript:alert(1)')}"
        ) as page,
    ):
        await page.wait("document.querySelector('.state-open')")
        assert "127.0.0.1" in await page.evaluate(text("header h1"))


async def test_integers_of_64_bits_and_numbers_that_are_not_finite(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0") as server:
        heard: list[int] = []
        node = server.node("big")
        node.subscribe("/count", lambda message: heard.append(message.data), "std_msgs/Int64")
        odd = node.advertise("/odd", "std_msgs/Float64", qos=LATCHED)
        odd.publish({"data": math.inf})
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 900, 700) as page:
            await open_panels(page, url, [("topics", {"topic": "/count"})])
            await page.click(".panel-topics summary >> text=Publish")
            await page.wait("document.querySelector('.message-form input')")
            await fill(page, "data", "9007199254740993")
            await page.click(".message-form + * [type=submit], .commanding [type=submit]")
            await until(lambda: heard == [9007199254740993])
            await page.click("text=/odd")
            await page.wait(f"{text('.detail .tree')}.includes('not finite')")


async def search(page: Page, wanted: str) -> None:
    await page.evaluate(
        f"""((input) => {{
          input.value = {json.dumps(wanted)};
          input.dispatchEvent(new Event("input", {{ bubbles: true }}));
        }})(document.querySelector(".detail [type=search]"))"""
    )


async def test_fields_of_a_message_are_filtered_and_compared(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0") as server:
        place = server.node("robot").advertise("/place", "geometry_msgs/PoseStamped", qos=LATCHED)
        header = {"stamp": {"sec": 1, "nanosec": 1}, "frame_id": "map"}
        place.publish({"header": header, "pose": {"position": {"x": 1.0}}})
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 900, 700) as page:
            await open_panels(page, url, [("topics", {"topic": "/place"})])
            await page.wait("document.querySelector('.detail .tree')")
            await search(page, "Position.X")
            await page.wait(f"{text('.detail .fields')} === 'pose.position.x1'")
            await search(page, "nothing")
            await page.wait(f"{text('.detail')}.includes('No field has this name.')")
            await search(page, "")
            await page.wait("document.querySelector('.detail .tree')")
            await page.click(".detail >> text=Differences from this message")
            await page.wait(f"{text('.detail')}.includes('No differences.')")
            header["frame_id"] = "odom"
            place.publish({"header": header, "pose": {"position": {"x": 2.5, "y": math.nan}}})
            differences = (
                'header.frame_id"map" → "odom"pose.position.x1 → 2.5'
                "pose.position.y0 → not finite (NaN or infinite)"
            )
            await page.wait(f"{text('.detail .fields')} === {json.dumps(differences)}")


async def test_messages_of_a_list_are_rows_of_a_table(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0") as server:
        cloud = server.node("robot").advertise("/cloud", "sensor_msgs/PointCloud2", qos=LATCHED)
        fields = [
            {"name": name, "offset": 4 * at, "datatype": 7, "count": 1} for at, name in enumerate("xyz")
        ]
        cloud.publish({"fields": fields, "point_step": 12})
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 900, 700) as page:
            await open_panels(page, url, [("topics", {"topic": "/cloud"})])
            await page.click(".detail .tree-fold >> text=fields")
            rows = """[...document.querySelectorAll('.tree tr')].map(
              (row) => [...row.cells].map((cell) => cell.textContent))"""
            await page.wait(f"{rows}.length === 4")
            assert await page.evaluate(rows) == [
                ["name", "offset", "datatype", "count"],
                *([json.dumps(name), str(4 * at), "7", "1"] for at, name in enumerate("xyz")),
            ]


async def test_without_transforms_the_missing_frames_are_named_and_one_is_offered(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0") as server:
        node = server.node("laser")
        scan = node.advertise("/scan", "sensor_msgs/LaserScan", qos=LATCHED)
        scan.publish(
            {"header": {"frame_id": "laser"}, "angle_increment": 0.1, "range_max": 9.0, "ranges": [1.0] * 60}
        )
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 700, 500) as page:
            await open_panels(page, url, [("scene", {})])
            await page.wait(f"{text('.scene-lost')}.includes('what is in the frame laser is not drawn')")
            assert await violations(page) == []
            await page.click("text=Use laser as fixed frame")
            await page.wait("!document.querySelector('.scene-lost')")
            scene = "document.querySelector('.scene-view').robotScene"
            assert await page.evaluate(f"{scene}.frames.fixed.value") == "laser"
            assert await page.evaluate(f"{scene}.frames.place('laser').visible")


async def test_rates_of_topics_that_nothing_shows_are_measured(browser: Browser) -> None:
    async with panel(browser, "jazzy", "topics", size=(900, 600)) as (served, page):
        row = "[...document.querySelectorAll('tr')].find(it => it.textContent.startsWith({!r}))"
        rate = f"({row.format('/joint_states')}?.querySelector('.rate').textContent ?? '')"
        await page.wait(f"parseFloat({rate}) > 5")
        served.node.advertise("/silent", "std_msgs/String")
        await page.wait(f"{row.format('/silent')}?.querySelector('.rate').textContent === 'idle'")


async def test_the_robot_s_own_name_is_in_title_and_header(browser: Browser) -> None:
    for distro in ("jazzy", "noetic"):
        async with panel(browser, distro, "topics") as (_, page):
            await page.wait(f"{text('header h1')} === 'demo_robot'")
            await page.wait("document.title === 'demo_robot · Robot'")


async def test_letters_drive_from_anywhere_but_text_fields(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0", demo=True) as server:
        told: list[float] = []
        server.node("watcher").subscribe(
            "/cmd_vel", lambda twist: told.append(twist.linear.x), "geometry_msgs/Twist"
        )
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 1300, 800) as page:
            await open_panels(page, url, [("topics", {}), ("teleop", {"topic": "/cmd_vel"})])
            await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
            await page.calm()
            await page.evaluate("document.querySelector('.panel-topics input').focus()")
            await page.keyboard("press", "w")
            await anyio.sleep(0.5)
            assert not any(told)
            await page.evaluate("document.activeElement.blur()")
            await hold_until(page, "w", lambda: 0.4 in told)
            await page.keyboard("up", "w")
            await until(lambda: told[-1] == 0.0)


async def test_meshes_load_without_warnings(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0", demo=True) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 700, 500) as page:
            await open_panels(page, url, [("topics", {})])
            await page.evaluate(
                "globalThis.warned = []; console.warn = (first) => void globalThis.warned.push(String(first))"
            )
            await page.click('header .menus summary:has-text("Add panel")')
            await page.click("text=3D")
            await page.wait("document.querySelector('.scene-view')?.robotScene?.base")
            meshes = "performance.getEntriesByType('resource').filter(it => it.name.endsWith('.dae')).length"
            await page.wait(f"{meshes} > 3")
            await page.calm()
            assert [each for each in await page.evaluate("warned") if "Loader" in each] == []


async def test_fields_are_shown_as_gauges_and_states(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0") as server:
        node = server.node("arm")
        level = node.advertise("/level", "std_msgs/Float64", qos=LATCHED)
        state = node.advertise("/state", "std_msgs/String", qos=LATCHED)
        level.publish({"data": -2.5})
        state.publish({"data": "idle"})
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 700, 500) as page:
            fields = [{"topic": "/level", "path": "data"}, {"topic": "/state", "path": "data"}]
            await open_panels(page, url, [("values", {"fields": fields})])
            await page.wait(f"{text('.gauge b')} === '\u22122.5'")
            await page.wait(f"{text('.states b')} === 'idle'")
            level.publish({"data": 10.0})
            state.publish({"data": "moving"})
            await page.wait(f"{text('.gauge')}.includes('\u22122.5 \u2026 10')")
            await page.wait(f"{text('.states b')} === 'moving' && {text('.states')}.includes('1 changes')")
            assert await violations(page) == []
            await page.click('[aria-label="Remove /state data"]')
            await page.wait("!document.querySelector('.states')")


async def test_a_position_by_satellite_has_a_track(browser: Browser) -> None:
    def fix(latitude: float, longitude: float, status: int = 0) -> dict[str, Any]:
        covariance = [2.25, 0, 0, 0, 1, 0, 0, 0, 4]
        place = {"latitude": latitude, "longitude": longitude, "altitude": 34.0}
        return place | {
            "status": {"status": status},
            "position_covariance": covariance,
            "position_covariance_type": 2,
        }

    async with Server("ws://127.0.0.1:0") as server:
        receiver = server.node("gps").advertise("/fix", "sensor_msgs/NavSatFix", qos=LATCHED)
        receiver.publish(fix(-33.9, 151.2, status=-1))
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 500, 500) as page:
            await open_panels(page, url, [("position", {})])
            await page.wait(f"{text('.position')}.includes('The receiver has no position')")
            receiver.publish(fix(-33.9, 151.2))
            where = "33.900000\u00b0 S, 151.200000\u00b0 E \u00b7 altitude 34.0 m \u00b7 \u00b1 1.5 m"
            await page.wait(f"{text('.position .number')} === {where!r}")
            receiver.publish(fix(-33.899, 151.2))
            label = "document.querySelector('.plane svg')?.ariaLabel"
            await page.wait(f"{label} === 'Track of 111 m, north up'")
            # The robot went north, which is up.
            places = await page.evaluate(
                "[...document.querySelector('.plane polyline').points].map(({x, y}) => [x, y])"
            )
            assert places == [[0, 0], [0, pytest.approx(-111.19, abs=0.01)]]
            shown = "document.querySelector('.plane svg').viewBox.baseVal.height"
            assert await page.evaluate(shown) == pytest.approx(1.2 * 111.19, rel=0.001)
            await page.click('[aria-label="Zoom in"]')
            await page.wait(f"{shown} < 70")
            await page.click('[aria-label="Show the whole track"]')
            await page.wait(f"{shown} > 130")
            assert await violations(page) == []
            await page.click('[aria-label="Clear the track"]')
            await page.wait(f"{label} === 'Track of 0 m, north up'")


async def test_the_wall_shows_chosen_cameras(browser: Browser) -> None:
    async with panel(browser, "jazzy", "wall", size=(900, 600)) as (_, page):
        names = "[...document.querySelectorAll('.wall figcaption')].map((it) => it.textContent).join(' ')"
        await page.wait(f"{names} === '/camera/image_raw /camera/depth/image_raw'")
        await page.wait("[...document.querySelectorAll('.wall canvas')].every((it) => it.width > 4)")
        await page.click(".wall summary")
        await page.click(".wall label:has-text('/camera/depth/image_raw')")
        await page.wait(f"{names} === '/camera/image_raw'")


async def test_the_side_draws_topics_opens_them_and_searches(browser: Browser) -> None:
    async with stand("jazzy", browser.built) as served, browser.page(served.url, 1300, 800) as page:
        scene = "document.querySelector('.scene-view')?.robotScene"
        await page.wait(f"{scene}?.rows.value.some(({{ topic, layer }}) => topic === '/scan' && layer)")
        await page.click('[aria-label="Draw /scan in 3D"]')
        await page.wait(f"{scene}.rows.value.some(({{ topic, layer }}) => topic === '/scan' && !layer)")
        await page.evaluate(
            "dispatchEvent(new KeyboardEvent('keydown', { key: 'k', ctrlKey: true, cancelable: true }))"
        )
        await page.wait("document.activeElement === document.querySelector('.side input')")
        for key in "param":
            await page.keyboard("press", key)
        await page.wait("document.querySelectorAll('.side .topic').length < 10")
        await page.click(".side-panel >> text=Parameters")
        await page.wait("document.querySelector('.panel-parameters')?.checkVisibility()")
        await page.evaluate(
            "((i) => { i.value = '/odom'; i.dispatchEvent(new Event('input', { bubbles: true })) })"
            "(document.querySelector('.side input'))"
        )
        await page.click(".side .topic-name")
        await page.wait(f"{text('.panel-topics .detail h2')} === '/odom'")
        assert await violations(page) == []


#: A name that is read from the right from its third letter on, with what hides a letter in it.
TURNED = "/go\u202egnp.\u200b"


async def test_characters_that_turn_or_hide_text_are_shown_as_their_codes(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0") as server:
        node = server.node("robot")
        log = node.advertise("/rosout", "rcl_interfaces/Log", qos=LATCHED)
        log.publish({"level": 20, "name": TURNED, "msg": f"at {TURNED}\x1b[2J"})
        tf = node.advertise("/tf_static", "tf2_msgs/TFMessage", qos=LATCHED)
        tf.publish({"transforms": [{"header": {"frame_id": "map"}, "child_frame_id": TURNED}]})
        described = node.advertise("/robot_description", "std_msgs/String", qos=LATCHED)
        described.publish({"data": f'<robot name="{TURNED}"><link name="a"/></robot>'})
        diagnostics = node.advertise("/diagnostics", "diagnostic_msgs/DiagnosticArray", qos=LATCHED)
        diagnostics.publish({"status": [{"name": TURNED, "message": TURNED}]})
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 1300, 800) as page:
            for kind in ("log", "frames", "diagnostics", "topics"):
                await page.goto(f"{url}healthz")
                await open_panels(page, url, [(kind, {"topic": "/robot_description"})])
                await page.wait(rf"{text(f'.panel-{kind}')}.includes('go\\u202egnp.\\u200b')")
                shown = await page.evaluate(f"document.title + {ALL_TEXTS} + document.body.textContent")
                assert not re.search(r"[\u200b-\u200f\u202a-\u202e\u2066-\u2069\x1b]", shown)


async def test_an_empty_panel_says_what_it_needs(browser: Browser) -> None:
    needs = {
        "camera": "sensor_msgs/CompressedImage",
        "wall": "sensor_msgs/CompressedImage",
        "teleop": "geometry_msgs/Twist",
        "joints": "trajectory_msgs/JointTrajectory",
        "goal": "navigate_to_pose",
        "position": "sensor_msgs/NavSatFix",
        "diagnostics": "diagnostic_msgs/DiagnosticArray",
        "battery": "sensor_msgs/BatteryState",
        "player": "rosbag2",
    }
    async with (
        stand("jazzy", browser.built, robot=False) as served,
        browser.page(f"{served.url}healthz", 900, 600) as page,
    ):
        for kind, needed in needs.items():
            await page.goto(f"{served.url}healthz")
            await open_panels(page, served.url, [(kind, {})])
            await page.wait(f"/needs/.test({text(f'.panel-{kind}')})")
            assert needed in await page.evaluate(text(f".panel-{kind}")), kind


async def test_a_closed_panel_comes_back_by_undo(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0", demo=True) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 1000, 600) as page:
            await open_panels(page, url, [("topics", {"topic": "/odom"}), ("log", {})])
            await page.click('[aria-label="Close Topics"]')
            await page.wait("!document.querySelector('.panel-topics')")
            await page.click('header .menus summary:has-text("Layouts")')
            await page.click("text=Undo the last change")
            await page.wait(f"{text('.panel-topics .detail h2')} === '/odom'")
