"""`python -m bench.page.commands`: how long a command waits while the page shows what is too much for it.

A robot in a process of its own publishes a load, Chromium shows it in the 3D view and by the panels that it
needs, and a key that drives is pressed again and again. Printed for each load: milliseconds from the key
event to the message that the page hands to its worker, and to the command at the server; frames a second;
memory of the renderer, at the start and at the end. A command that never came counts as the time to the next
press.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import anyio
import numpy as np

from bench.page.soak import SIZE, publish_map, spiral
from bench.paper.report import Report
from rwt import Server
from rwt_graph import Node
from rwt_participant.qos import LATCHED
from tests.browser.driver import NODE, Browser, Page, find_browser, opened_browser
from tests.browser.test_panels import open_panels

SECONDS: Final = 30.0
PRESS_SECONDS: Final = 0.25
WARM_UP: Final = 8.0
MOST_MS: Final = 100
"""The project's own bound, of the 99th percentile."""
MARKERS: Final = 100_000
TOPICS: Final = 100
"""Topics of 100 messages a second each."""

PANELS: Final[list[tuple[str, dict[str, object]]]] = [
    ("scene", {}),
    ("teleop", {"topic": "/cmd_vel"}),
    ("topics", {"topic": "/number_000"}),
    ("plot", {"lines": [{"topic": f"/number_{at:03}", "path": "data"} for at in range(4)]}),
    ("camera", {"topic": "/image"}),
]


@dataclass(frozen=True, slots=True)
class Load:
    """What a robot publishes.

    Attributes:
        hz: times a second.
        start: takes a node and returns what publishes once more.
    """

    hz: float
    start: Callable[[Node], Callable[[int], None]]


def _points(count: int) -> Callable[[Node], Callable[[int], None]]:
    def start(node: Node) -> Callable[[int], None]:
        publisher = node.advertise("/cloud", "sensor_msgs/PointCloud2")
        clouds = [spiral(count, turn) for turn in (0.0, 1.0)]
        return lambda number: publisher.publish(clouds[number % 2])

    return start


def _images(node: Node) -> Callable[[int], None]:
    publisher = node.advertise("/image", "sensor_msgs/Image")
    data = np.random.default_rng(1).integers(0, 255, 1920 * 1080 * 3, np.uint8).tobytes()
    image = {"width": 1920, "height": 1080, "encoding": "rgb8", "step": 5760, "data": data}
    return lambda _: publisher.publish(image)


def _markers(node: Node) -> Callable[[int], None]:
    publisher = node.advertise("/markers", "visualization_msgs/MarkerArray")
    places = np.random.default_rng(1).uniform(-5, 5, (MARKERS, 3))
    zero = {"sec": 0, "nanosec": 0}
    header = {"stamp": zero, "frame_id": "map"}
    marker: dict[str, Any] = {
        "header": header,
        "ns": "",
        "type": 1,
        "action": 0,
        "scale": dict.fromkeys("xyz", 0.05),
        "color": {"r": 1.0, "g": 0.0, "b": 0.0, "a": 1.0},
        "lifetime": zero,
        "frame_locked": False,
        "points": [],
        "colors": [],
        "texture_resource": "",
        "texture": {"header": header, "format": "", "data": b""},
        "uv_coordinates": [],
        "text": "",
        "mesh_resource": "",
        "mesh_file": {"filename": "", "data": b""},
        "mesh_use_embedded_materials": False,
    }
    turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    positions = [dict(zip("xyz", map(float, place), strict=True)) for place in places]
    markers = [
        {**marker, "id": at, "pose": {"position": position, "orientation": turn}}
        for at, position in enumerate(positions)
    ]
    return lambda _: publisher.publish({"markers": markers})


def _numbers(node: Node) -> Callable[[int], None]:
    publishers = [node.advertise(f"/number_{at:03}", "std_msgs/Float64") for at in range(TOPICS)]

    def publish(number: int) -> None:
        for publisher in publishers:
            publisher.publish({"data": float(number % 100)})

    return publish


def _description(node: Node) -> Callable[[int], None]:
    publisher = node.advertise("/other/robot_description", "std_msgs/String", qos=LATCHED)
    links = "".join(
        f'<link name="l{at}"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>'
        f'<joint name="j{at}" type="fixed"><parent link="base"/><child link="l{at}"/></joint>'
        for at in range(2000)
    )
    return lambda number: publisher.publish(
        {"data": f'<robot name="r{number}"><link name="base"/>{links}</robot>'}
    )


LOADS: Final = {
    "cloud of 300k points": Load(10, _points(300_000)),
    "cloud of 2M points": Load(2, _points(2_000_000)),
    "images": Load(15, _images),
    "markers": Load(0.5, _markers),
    "maps": Load(0.5, publish_map),
    "numbers": Load(100, _numbers),
    "descriptions": Load(0.2, _description),
}
ALL: Final = "all"
IDLE: Final = "idle"


def serve(case: str) -> None:
    """Publish a load; print where, and then the time of each command that begins to drive."""

    async def main() -> None:
        async with Server("ws://127.0.0.1:0", demo=True) as server, anyio.create_task_group() as tasks:
            node = server.node("load")
            before = [0.0]

            def take(twist: Any) -> None:
                if twist.linear.x and not before[0]:
                    print(time.time(), flush=True)
                before[0] = twist.linear.x

            node.subscribe("/cmd_vel", take, "geometry_msgs/Twist")
            for name, load in LOADS.items():
                if case in (name, ALL):
                    tasks.start_soon(_repeat, load, node)
            print(server.urls[0], flush=True)
            await anyio.sleep_forever()

    anyio.run(main)


async def _repeat(load: Load, node: Node) -> None:
    publish = load.start(node)
    due = anyio.current_time()
    number = 0
    while True:
        publish(number)
        number += 1
        # Periods that were missed are not caught up.
        due = max(due + 1 / load.hz, anyio.current_time())
        await anyio.sleep_until(due)


@contextmanager
def robot(case: str) -> Iterator[tuple[str, Callable[[], list[float]]]]:
    """The robot's page, and what ends the robot and returns the times of commands."""
    words = [sys.executable, "-m", "bench.page.commands", "--serve", case]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None

        def end() -> list[float]:
            process.terminate()
            return [float(line) for line in process.communicate()[0].split()]

        try:
            yield process.stdout.readline().strip().replace("ws", "http", 1) + "/", end
        finally:
            process.kill()


@dataclass(frozen=True, slots=True)
class Found:
    """Measurements of a load.

    Attributes:
        posted: milliseconds from each key event to the message to the worker.
        arrived: the same to the command at the server.
        frames: frames a second.
        start_mb, end_mb: memory of the renderer.
    """

    case: str
    posted: Sequence[float]
    arrived: Sequence[float]
    frames: float
    start_mb: float
    end_mb: float


#: Times of presses and of the first command after each.
WATCH = """(() => {
  globalThis.pressed = [];
  globalThis.posted = [];
  globalThis.frames = 0;
  const frame = () => { frames++; requestAnimationFrame(frame) };
  frame();
  addEventListener("keydown", (event) => {
    if (event.key === "w" && !event.repeat) pressed.push(performance.timeOrigin + event.timeStamp);
  }, { capture: true });
  const post = Worker.prototype.postMessage;
  let moved = false;
  Worker.prototype.postMessage = function (message, ...rest) {
    if (message?.kind === "send" && /"\\/cmd_vel".*"linear"/.test(message.text)) {
      const moves = !/"linear":\\{"x":0[,}]/.test(message.text);
      if (moves && !moved) posted.push(performance.timeOrigin + performance.now());
      moved = moves;
    }
    return post.call(this, message, ...rest);
  };
})()"""


async def measure(browser: Browser, case: str, seconds: float) -> Found:
    """Drive a robot whose page shows a load."""
    with robot(case) as (url, end):
        async with browser.page(f"{url}healthz", **SIZE) as page:
            page.forgive("")  # It is a measurement; what the page complains of is no fault of it.
            await open_panels(page, url, PANELS)
            await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
            await page.wait("document.querySelector('.scene-view')?.robotScene?.base")
            await anyio.sleep(WARM_UP)
            await page.evaluate(WATCH)
            start = browser.renderer_bytes()
            frames, span = await _press(page, seconds)
            end_bytes = browser.renderer_bytes()
            pressed = await page.evaluate("pressed")
            posted = await page.evaluate("posted.map((it) => it / 1000)")
        commands = end()
    times = [each / 1000 for each in pressed]
    return Found(
        case,
        _delays(times, posted),
        _delays(times, commands),
        frames / span,
        start / 1e6,
        end_bytes / 1e6,
    )


async def _press(page: Page, seconds: float) -> tuple[int, float]:
    """Press the key that drives for so long; returns the drawn frames, and the seconds that it took."""
    before = await page.evaluate("frames")
    began = time.monotonic()
    while time.monotonic() - began < seconds:
        await page.keyboard("down", "w")
        await anyio.sleep(PRESS_SECONDS)
        await page.keyboard("up", "w")
        await anyio.sleep(PRESS_SECONDS)
    return await page.evaluate("frames") - before, time.monotonic() - began


def _delays(pressed: Sequence[float], happened: Sequence[float]) -> list[float]:
    """Return the milliseconds from each press to what came of it, or else to the next press; sorted."""
    delays = []
    for at, until in zip(pressed, [*pressed[1:], pressed[-1] + 2 * PRESS_SECONDS], strict=True):
        came = next((each for each in happened if at <= each < until), until)
        delays.append((came - at) * 1000)
    return sorted(delays)


def _percentile(values: Sequence[float], share: float) -> float:
    return values[min(len(values) - 1, int(len(values) * share))]


def report(found: Sequence[Found], seconds: float, version: str) -> Report:
    """The table."""
    rows = [
        (
            each.case,
            f"{len(each.posted)}",
            *(f"{_percentile(each.posted, share):.0f}" for share in (0.5, 0.99)),
            *(f"{_percentile(each.arrived, share):.0f}" for share in (0.5, 0.99)),
            f"{each.frames:.0f}",
            f"{each.start_mb:.0f}",
            f"{each.end_mb:.0f}",
        )
        for each in found
    ]
    missed = [
        f"{each.case}: p99 {_percentile(each.posted, 0.99):.0f} ms, bound {MOST_MS} ms"
        for each in found
        if _percentile(each.posted, 0.99) > MOST_MS
    ]
    return Report(
        title=f"A key that drives in Chromium {version}, {seconds:g} s of each load",
        head=(
            "",
            "presses",
            "to worker p50 ms",
            "p99 ms",
            "at the server p50 ms",
            "p99 ms",
            "frames/s",
            "MB",
            "MB at the end",
        ),
        rows=rows,
        notes=("The server publishes the load in the process that receives the command.",),
        missed=missed,
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.page.commands", description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS, help=f"of each (default {SECONDS:g})")
    parser.add_argument("--check", action="store_true", help="exit with 1 when a bound is missed")
    parser.add_argument("--only", default="", metavar="TEXT", help="only the loads whose name contains this")
    parser.add_argument("--serve", default="", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.serve:
        serve(options.serve)
        return 0
    kind = find_browser()
    if kind is None or kind.driver.parent != NODE:
        parser.error("Chromium is not installed; name its program in the environment variable CHROMIUM")
    cases = [each for each in (IDLE, *LOADS, ALL) if options.only in each]
    found = []
    for case in cases:
        with TemporaryDirectory() as folder, opened_browser(kind, Path(folder)) as browser:
            found.append(anyio.run(measure, browser, case, options.seconds))
            version = browser.version
    table = report(found, options.seconds, version)
    print(table.text())
    return int(bool(table.missed) and options.check)


if __name__ == "__main__":
    sys.exit(main())
