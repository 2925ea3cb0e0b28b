"""`python -m bench.page.soak`: the robot's page with all of its panels open, for ten minutes, in Chromium.

A demo robot with a cloud of 100,000 points ten times a second beside it is shown by one page. Printed are the
size of the first load and when it is of use, frames a second, the heap after a collection at the start and at
the end, and the page's longest task, by Chromium's trace. It is Chromium as it is without a
graphics card: WebGL is done in software, and so is the page, each by a program of its own.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import anyio
import numpy as np

from rwt import Server
from rwt_graph import Node
from rwt_participant.qos import LATCHED
from tests.browser.driver import NODE, Browser, Kind, Page, Size, find_browser, opened_browser

KINDS = (
    *("scene", "camera", "teleop", "goal", "approvals", "device", "topics", "plot", "services", "actions"),
    *("parameters", "log", "diagnostics", "battery", "frames", "nodes", "player", "server"),
    *("wall", "values", "joints", "position"),
)
SIZE: Size = {"width": 1400, "height": 900}
CASES = ("panels", "cloud", "map", "plots", "topics")
"""All panels, or a single load: a cloud, a large map every five seconds, plots, many topics."""
PLOTS = 20
"""Plots, of a topic of 100 messages a second each."""
TOPICS = 500
"""Topics, of ten messages a second each."""
MAP_CELLS = 4000
"""Cells of the large map along each side."""
WARM_UP = 0.1
"""Share of the time after which the heap counts."""
TRACED = 20.0
"""Seconds of the trace, at most."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Measurements.

    Attributes:
        first_paint, useful: milliseconds from the start of the navigation with an empty cache until something
            is painted, and until the robot can be driven.
        first_load, first_load_with_3d: kilobytes that were sent by then, and once the scene is drawn.
        frames: frames a second of the page, over the whole run.
        drawn: of these, frames a second in which the 3D view was drawn anew.
        clouds: messages with a cloud a second that reached the page.
        heap_start, heap_end: megabytes after a collection.
        longest_task: milliseconds, of the page's thread, in the trace.
        longest_work: milliseconds that a task of the page's thread was on a processor, in the trace: on a
            busy machine a task is long that only waits for its turn.
        long_tasks: tasks of more than 50 ms in the trace, a second of it.
        long_tasks_run: the same over the whole run, as the page itself is told.
    """

    first_paint: float
    useful: float
    first_load: float
    first_load_with_3d: float
    frames: float
    drawn: float
    clouds: float
    heap_start: float
    heap_end: float
    longest_task: float
    longest_work: float
    long_tasks: float
    long_tasks_run: float


def serve(points: int, case: str) -> None:
    """Serve the demo robot, with a cloud of a spiral that turns or the load of a case; print where."""

    async def main() -> None:
        async with Server("ws://127.0.0.1:0", demo=True) as server:
            node = server.node("load")
            match case:
                case "map":
                    await _repeat(5.0, publish_map(node), server)
                case "plots":
                    await _repeat(0.01, _publish_numbers(node, PLOTS), server)
                case "topics":
                    await _repeat(0.1, _publish_numbers(node, TOPICS), server)
                case _:
                    await _repeat(0.1, _publish_cloud(node, points), server)

    anyio.run(main)


async def _repeat(period: float, publish: Callable[[int], None], server: Server) -> None:
    """Print where the server is, and publish again and again; periods that were missed are not caught up."""
    print(server.urls[0], flush=True)
    number = 0
    due = anyio.current_time()
    while True:
        publish(number)
        number += 1
        due = max(due + period, anyio.current_time() - 0.5)
        await anyio.sleep(max(0.0, due - anyio.current_time()))


def _publish_cloud(node: Node, points: int) -> Callable[[int], None]:
    cloud = node.advertise("/cloud", "sensor_msgs/PointCloud2")
    clouds = [spiral(points, turn) for turn in np.linspace(0, 2 * math.pi, 20, endpoint=False)]
    return lambda number: cloud.publish(clouds[number % len(clouds)])


def publish_map(node: Node) -> Callable[[int], None]:
    """A map whose other half is occupied each time."""
    publisher = node.advertise("/large_map", "nav_msgs/OccupancyGrid", qos=LATCHED)
    info = {"resolution": 0.05, "width": MAP_CELLS, "height": MAP_CELLS}

    def publish(number: int) -> None:
        cells = np.zeros((MAP_CELLS, MAP_CELLS), np.int8)
        cells[number % 2 :: 2, ::50] = 100
        publisher.publish({"header": {"frame_id": "map"}, "info": info, "data": cells.ravel()})

    return publish


def _publish_numbers(node: Node, count: int) -> Callable[[int], None]:
    publishers = [node.advertise(f"/number_{at:03}", "std_msgs/Float64") for at in range(count)]

    def publish(number: int) -> None:
        for at, publisher in enumerate(publishers):
            publisher.publish({"data": math.sin(number / 20 + at)})

    return publish


def spiral(points: int, turn: float) -> dict[str, Any]:
    """Return a cloud of a spiral, in the map's frame."""
    along = np.linspace(0, 1, points, dtype=np.float32)
    places = np.zeros((points, 4), dtype=np.float32)
    places[:, 0] = 3 * along * np.cos(40 * along + turn)
    places[:, 1] = 3 * along * np.sin(40 * along + turn)
    places[:, 2] = along
    places[:, 3] = 1000 * along
    fields = [
        {"name": name, "offset": 4 * at, "datatype": 7, "count": 1}
        for at, name in enumerate(("x", "y", "z", "intensity"))
    ]
    return {
        "header": {"frame_id": "map"},
        "height": 1,
        "width": points,
        "fields": fields,
        "point_step": 16,
        "row_step": 16 * points,
        "data": places.tobytes(),
        "is_dense": True,
    }


@contextmanager
def robot(points: int, case: str = "panels") -> Iterator[str]:
    """The robot in a process of its own; its page's address."""
    words = [sys.executable, "-m", "bench.page.soak", "--serve", "--points", str(points), "--case", case]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().strip().replace("ws", "http", 1) + "/"
        finally:
            process.terminate()


@contextmanager
def measured_browser(kind: Kind) -> Iterator[Browser]:
    """Chromium as it is without a graphics card, and without what else watches the page in tests."""
    bare = replace(kind, driver=NODE / "bare.mjs")
    with tempfile.TemporaryDirectory() as folder, opened_browser(bare, Path(folder)) as opened:
        yield opened


async def measure(browser: Browser, url: str, seconds: float, case: str = "panels") -> Figures:
    """Open the page afresh, then with the panels of a case, and look at it for so long."""
    async with browser.page(f"{url}healthz", **SIZE) as page:
        page.forgive("")  # It is a measurement; what is left while it loads is no fault of it.
        await page.goto(url)
        await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
        useful = await page.evaluate("performance.now()")
        paint = await page.evaluate(
            "performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? 0"
        )
        first_load = await _loaded(page)
        await page.wait("document.querySelector('.scene-view')?.robotScene?.base")
        with_3d = await _loaded(page)
        await open_case(page, url, case)
        await anyio.sleep(seconds * WARM_UP)
        start = await _heap(page)
        before = await _counts(page)
        began = time.monotonic()
        traced = min(TRACED, seconds / 2)
        await anyio.sleep(max(0.0, seconds - traced) / 2)
        tasks = await _tasks(page, traced)
        await anyio.sleep(max(0.0, seconds - traced) / 2)
        after = await _counts(page)
        span = time.monotonic() - began
        frames, drawn, clouds, long_tasks = (
            (late - early) / span for early, late in zip(before, after, strict=True)
        )
        end = await _heap(page)
        await page.picture("page soak")
    return Figures(
        first_paint=paint,
        useful=useful,
        first_load=first_load,
        first_load_with_3d=with_3d,
        frames=frames,
        drawn=drawn,
        clouds=clouds,
        heap_start=start,
        heap_end=end,
        longest_task=max((task for task, _ in tasks), default=0.0),
        longest_work=max((work for _, work in tasks), default=0.0),
        long_tasks=sum(task > 50 for task, _ in tasks) / traced,
        long_tasks_run=long_tasks,
    )


async def open_case(page: Page, url: str, case: str) -> None:
    """Have the page show the panels of a case, and count its frames."""
    configs: dict[str, dict[str, object]] = {
        "topics": {"topic": "/odom"},
        "plot": {"lines": [{"topic": "/odom", "path": "twist.twist.linear.x"}]},
        "services": {"name": "/add_two_ints"},
        "actions": {"name": "/fibonacci"},
    }
    kinds = {"panels": KINDS, "topics": ("scene", "topics")}.get(case, ("scene",))
    panels = [{"id": kind, "kind": kind, "config": configs.get(kind, {})} for kind in kinds]
    layout = json.dumps({"version": 1, "panels": panels, "dock": None} if case != "plots" else _plots())
    key = f"rwt-last-layout{url.replace('http', 'ws', 1)}"
    await page.goto(f"{url}healthz")
    await page.evaluate(f"localStorage.setItem({json.dumps(key)}, {json.dumps(layout)})")
    await page.goto(url)
    if case == "plots":
        await page.wait(f"document.querySelectorAll('.plot-chart canvas').length === {PLOTS}")
    else:
        await page.wait("document.querySelector('.scene-view')?.robotScene?.base")
    await page.evaluate(
        """(() => {
          globalThis.seen = { frames: 0, long: 0, clouds: 0 };
          const frame = () => { seen.frames++; requestAnimationFrame(frame) };
          frame();
          const watch = new PerformanceObserver((list) => { seen.long += list.getEntries().length });
          watch.observe({ type: "longtask" });
          document.querySelector(".scene-view")?.robotScene.session.traffic.subscribe((topics) => {
            seen.clouds += topics.get("/cloud")?.messages ?? 0;
          });
        })()"""
    )


def _plots() -> dict[str, Any]:
    """A layout of plots in rows and columns, in the page's own form."""
    names = [f"plot {at}" for at in range(PLOTS)]
    width, height = SIZE["width"], SIZE["height"] - 100
    columns = [
        {
            "type": "branch",
            "size": width / 4,
            "data": [
                {
                    "type": "leaf",
                    "size": height / len(names[at::4]),
                    "data": {"id": name, "views": [name], "activeView": name},
                }
                for name in names[at::4]
            ],
        }
        for at in range(4)
    ]
    return {
        "version": 1,
        "panels": [
            {"id": name, "kind": "plot", "config": {"lines": [{"topic": f"/number_{at:03}", "path": "data"}]}}
            for at, name in enumerate(names)
        ],
        "dock": {
            "grid": {
                "root": {"type": "branch", "size": height, "data": columns},
                **{"width": width, "height": height, "orientation": "HORIZONTAL"},
            },
            "panels": {name: {"id": name, "contentComponent": "plot", "title": "Plot"} for name in names},
            "activeGroup": names[0],
        },
    }


async def _loaded(page: Page) -> float:
    """Kilobytes of the page's own files that have come over the network."""
    octets: float = await page.evaluate(
        "performance.getEntriesByType('navigation').concat(performance.getEntriesByType('resource'))"
        ".filter(r => r.entryType === 'navigation' || r.name.includes('/web/'))"
        ".reduce((sum, r) => sum + r.transferSize, 0)"
    )
    return octets / 1024


async def _counts(page: Page) -> list[float]:
    counts: list[float] = await page.evaluate(
        "[seen.frames, document.querySelector('.scene-view')?.robotScene.view.drawn ?? 0,"
        " seen.clouds, seen.long]"
    )
    return counts


async def _heap(page: Page) -> float:
    await page.inspect("Performance.enable")
    await page.inspect("HeapProfiler.collectGarbage")
    metrics = (await page.inspect("Performance.getMetrics"))["metrics"]
    octets: float = next(each["value"] for each in metrics if each["name"] == "JSHeapUsedSize")
    return octets / 1e6


async def _tasks(page: Page, seconds: float) -> list[tuple[float, float]]:
    """Milliseconds of each task of the page's thread in a trace, and of these the ones on a processor."""
    trace = json.loads((await page.trace(seconds)).read_text(encoding="utf-8"))["traceEvents"]
    names = {
        (each["pid"], each["tid"])
        for each in trace
        if each["name"] == "thread_name" and each["args"]["name"] == "CrRendererMain"
    }
    tasks: dict[tuple[int, int], list[tuple[float, float]]] = {name: [] for name in names}
    for each in trace:
        thread = (each["pid"], each["tid"])
        # The outer one of the two that each task is written as.
        if thread in names and each["name"] == "RunTask":
            tasks[thread].append((each.get("dur", 0) / 1000, each.get("tdur", 0) / 1000))
    # There may be other processes that draw pages; this page's is the one that works.
    return max(tasks.values(), key=lambda each: sum(work for _, work in each), default=[])


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and print a line for each figure."""
    parser = argparse.ArgumentParser(prog="python -m bench.page.soak", description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=600.0, help="how long (default 600)")
    parser.add_argument("--case", choices=CASES, default="panels", help="what is shown (default panels: all)")
    parser.add_argument("--points", type=int, default=100_000, help="of a cloud (default 100000)")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.serve:
        serve(given.points, given.case)
        return 0
    kind = find_browser()
    if kind is None or kind.driver.parent != NODE:
        print("Chromium is not installed: `apt-get install chromium` on Debian", file=sys.stderr)
        return 1
    with measured_browser(kind) as browser, robot(given.points, given.case) as url:
        figures = anyio.run(measure, browser, url, given.seconds, given.case)
    for key, value in asdict(figures).items():
        print(f"{key:20} {value:10.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
