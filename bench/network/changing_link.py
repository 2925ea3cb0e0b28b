"""`python -m bench.network.changing_link`: a camera in Chromium over changing and lossy links.

A camera of 640x480 at 30 Hz, viewed by WebRTC (WHEP), as MJPEG and as WebM. Each case runs several times;
figures are the median, the 90th percentile and the largest of the runs. Runs are added to the file of
`--record`, so that they can be made in portions; with `--runs 0` the table and the plots are made of those in
the file. Needs Linux, root, `/dev/net/tun` and Chromium, and matplotlib for `--plots`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import anyio
import anyio.to_thread
import numpy as np

from bench.network.lossy_link import ADDRESSES, Line, lossy_link
from bench.paper.camera import mark
from rwt import Server
from rwt_graph import Node
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route
from rwt_webrtc.settings import WebRtcSettings
from tests.browser.driver import find_browser, opened_browser

HZ: Final = 30
PORT: Final = 9090
TOPIC: Final = "/camera/image_raw"
WAYS: Final = ("webrtc", "mjpeg", "webm")
WARM_UP: Final = 8.0
SAMPLE_SECONDS: Final = 0.1
BIN_SECONDS: Final = 0.5
RECORD: Final = Path(__file__).with_name("changing_link.jsonl")
"""Recorded runs, one in each line, from which the table and the plots of the documentation are made."""
_GOOD: Final = Line(bits=2e6, delay=0.02, queue=0.5)
_PAGE: Final = Path(__file__).with_suffix(".html")


@dataclass(frozen=True, slots=True)
class Case:
    """Link over time.

    Attributes:
        steps: seconds from the beginning, and the line from then on; after them the end.
        end: seconds of the measurement.
    """

    steps: tuple[tuple[float, Line], ...]
    end: float


CASES: Final = {
    "cut": Case(((0, _GOOD), (10, replace(_GOOD, bits=5e5)), (30, _GOOD)), 50),
    "unlimited": Case(((0, replace(_GOOD, bits=0)),), 60),
    "200 kbit/s": Case(((0, replace(_GOOD, bits=2e5)),), 20),
    "500 kbit/s": Case(((0, replace(_GOOD, bits=5e5)),), 20),
    "3 % lost": Case(((0, replace(_GOOD, loss=0.03)),), 20),
    "10 % lost": Case(((0, replace(_GOOD, loss=0.1)),), 20),
    "100 ms": Case(((0, replace(_GOOD, delay=0.1)),), 20),
    "300 ms": Case(((0, replace(_GOOD, delay=0.3)),), 20),
    "outage of 5 s": Case(((0, _GOOD), (5, replace(_GOOD, loss=1.0)), (10, _GOOD)), 30),
    "bursts": Case(tuple((at / 2, replace(_GOOD, bits=1e5 if at % 4 == 0 else 5e6)) for at in range(40)), 20),
}


@dataclass(frozen=True, slots=True)
class Run:
    """Result of one run.

    Attributes:
        figures: by name.
        series: for each :data:`BIN_SECONDS`, what the robot has sent in kbit/s, the number of new images, and
            the largest age of the image that was shown, in seconds.
    """

    case: str
    way: str
    seed: int
    figures: dict[str, float]
    series: list[tuple[float, int, float]]


@dataclass(frozen=True, slots=True)
class Seen:
    """Result of one run.

    Attributes:
        images: seconds from the beginning of the measurement, age in seconds and width of each image.
        rates: bits per second that the robot has sent, every :data:`SAMPLE_SECONDS`.
    """

    images: list[tuple[float, float, int]]
    rates: list[float]

    def pause(self, begin: float, end: float) -> float:
        """Return the longest time without a new image."""
        times = [begin, *(at for at, _, _ in self.images if begin <= at < end), end]
        return float(np.diff(times).max())

    def ages(self, begin: float, end: float) -> list[float]:
        return [age for at, age, _ in self.images if begin <= at < end] or [end - begin]

    def rate(self, begin: float, end: float) -> float:
        """Return the mean rate."""
        return float(np.mean(self.rates[round(begin / SAMPLE_SECONDS) : round(end / SAMPLE_SECONDS)]))

    def shown_ages(self, end: float) -> list[float]:
        """Return the largest age of the image that was shown, for each :data:`SAMPLE_SECONDS`: an image grows
        older until the next one."""
        found, taken, images = [], 0.0, iter([*self.images, (inf, 0.0, 0)])
        at, age, _ = next(images)
        for sample in range(round(end / SAMPLE_SECONDS)):
            until, oldest = (sample + 1) * SAMPLE_SECONDS, 0.0
            while at < until:
                oldest = max(oldest, at - taken)
                taken = max(taken, at - age)
                at, age, _ = next(images)
            found.append(max(oldest, until - taken))
        return found

    def series(self, end: float) -> list[tuple[float, int, float]]:
        """Return the run as :attr:`Run.series`."""
        samples, ages = round(BIN_SECONDS / SAMPLE_SECONDS), self.shown_ages(end)
        found: list[tuple[float, int, float]] = []
        for first in range(0, len(ages), samples):
            begin = first * SAMPLE_SECONDS
            count = sum(begin <= at < begin + BIN_SECONDS for at, _, _ in self.images)
            rate = self.rate(begin, begin + BIN_SECONDS) / 1000
            found.append((round(rate), count, round(max(ages[first : first + samples]), 2)))
        return found

    def below(self, begin: float, bits: float) -> float:
        """Return the seconds from `begin` until half a second at less than `bits` on average."""
        return next(at for at in np.arange(0, 60, 0.1) if self.rate(begin + at, begin + at + 0.5) < bits)

    def above(self, begin: float, bits: float) -> float:
        """Return the seconds from `begin` until a second at more than `bits` on average."""
        end = len(self.rates) * SAMPLE_SECONDS - 1
        return next(
            (at for at in np.arange(0, end - begin, 0.1) if self.rate(begin + at, begin + at + 1) > bits),
            inf,
        )


def _page(request: HttpRequest, reader: Reader) -> HttpResponse:
    return HttpResponse(_PAGE.read_bytes(), content_type="text/html; charset=utf-8")


async def play(node: Node) -> None:
    """Publish a noisy image for ever, which takes any bit rate, with the time in it."""
    images = node.advertise(TOPIC, "sensor_msgs/Image")
    rng = np.random.default_rng(1)
    scene = rng.integers(30, 220, (60, 80, 3)).repeat(8, axis=0).repeat(8, axis=1)
    drawn = [
        np.clip(np.roll(scene, 4 * at, axis=1) + rng.normal(0, 8, scene.shape), 0, 255).astype(np.uint8)
        for at in range(40)
    ]
    shape = {"height": 480, "width": 640, "encoding": "rgb8", "step": 1920}
    count, begun = 0, anyio.current_time()
    while True:
        count += 1
        await anyio.sleep_until(begun + count / HZ)
        image = drawn[count % len(drawn)]
        now = time.time_ns()
        mark(image, count % 4096, now // 1_000_000)
        stamp = {"sec": now // 10**9, "nanosec": now % 10**9}
        images.publish({**shape, "header": {"stamp": stamp}, "data": image.tobytes()})


def robot() -> None:
    """Serve the camera until standard input ends."""

    async def serve() -> None:
        extension = HttpExtension((Route("/changing_link.html", _page, Audience.ADMITTED),))
        url = f"ws://{ADDRESSES[0]}:{PORT}"
        async with (
            Server(url, http=[extension], webrtc=WebRtcSettings(enabled=True)) as server,
            anyio.create_task_group() as tasks,
        ):
            tasks.start_soon(play, server.node("camera"))
            print("up", flush=True)
            await anyio.to_thread.run_sync(sys.stdin.read)
            tasks.cancel_scope.cancel()

    anyio.run(serve)


async def operator(way: str) -> None:
    """View the camera in Chromium until standard input ends, and print what was seen as JSON."""
    kind = find_browser()
    assert kind is not None
    with TemporaryDirectory() as folder, opened_browser(kind, Path(folder)) as browser:
        url = f"http://{ADDRESSES[0]}:{PORT}/changing_link.html?{way}"
        async with browser.page(url, 640, 480) as page:
            await page.wait("seen.length > 0")
            print("up", flush=True)
            await anyio.to_thread.run_sync(sys.stdin.read)
            print(json.dumps(await page.evaluate("seen")), flush=True)


def measure(way: str, case: Case, seed: int) -> Seen:
    """Run one case once."""
    first = replace(case.steps[0][1], loss=0.0)
    with lossy_link(first, seed) as (link, hosts), _there(hosts[0], "--robot") as robot_there:
        assert robot_there.stdout is not None
        robot_there.stdout.readline()
        with _there(hosts[1], "--operator", way) as operator_there:
            assert operator_there.stdout is not None
            operator_there.stdout.readline()
            time.sleep(WARM_UP)
            began, wall = time.monotonic(), time.time()
            rates: list[float] = []
            steps, before = list(case.steps), link.offered_bytes[0]
            for sample in range(round(case.end / SAMPLE_SECONDS)):
                while steps and steps[0][0] <= sample * SAMPLE_SECONDS:
                    link.line = steps.pop(0)[1]
                time.sleep(max(0.0, began + (sample + 1) * SAMPLE_SECONDS - time.monotonic()))
                rates.append(8 * (link.offered_bytes[0] - before) / SAMPLE_SECONDS)
                before = link.offered_bytes[0]
            link.line = Line()
            found, _ = operator_there.communicate(timeout=90)
        robot_there.communicate(timeout=60)
    images = [(at / 1000 - wall, age / 1000, width) for at, age, width in json.loads(found)]
    return Seen([each for each in images if 0 <= each[0] < case.end], rates)


def _there(host: str, *arguments: str) -> subprocess.Popen[str]:
    command = ["ip", "netns", "exec", host, sys.executable, "-m", "bench.network.changing_link", *arguments]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def figures(name: str, case: Case, seen: Seen) -> dict[str, float]:
    """Return the figures of a run."""
    found = {
        "images/s": len(seen.images) / case.end,
        "median age": float(np.median(seen.ages(0, case.end))),
        "95 % age": float(np.percentile(seen.ages(0, case.end), 95)),
        "longest pause": seen.pause(0, case.end),
        "% of the time older than 1 s": 100 * float(np.mean([age > 1 for age in seen.shown_ages(case.end)])),
        "kbit/s": seen.rate(0, case.end) / 1000,
    }
    if name == "cut":
        found |= {
            "below the link after": seen.below(10, 5e5),
            "pause after the cut": seen.pause(10, 30),
            "largest age after the cut": max(seen.ages(10, 30)),
            "80 % after": seen.above(30, 1.6e6),
        }
    if name == "unlimited":
        found["least kbit/s"] = min(seen.rate(at, at + 2) for at in range(0, 58)) / 1000
    return found


def record(name: str, way: str, seed: int) -> Run:
    """Run one case once, and reduce it to what is kept."""
    case = CASES[name]
    seen = measure(way, case, seed)
    found = {figure: round(value, 3) for figure, value in figures(name, case, seen).items()}
    return Run(name, way, seed, found, seen.series(case.end))


def read_runs(path: Path) -> list[Run]:
    """Read the runs of a file; none if there is no file."""
    return [Run(**json.loads(line)) for line in path.read_text().splitlines()] if path.exists() else []


def table(runs: Sequence[Run]) -> str:
    """Return the figures of the runs as a table in Markdown."""
    lines = ["| link | by | runs | figure | median | 90 % | largest |", "|---|---|---:|---|---:|---:|---:|"]
    for name, way in dict.fromkeys((run.case, run.way) for run in runs):
        found = [run.figures for run in runs if (run.case, run.way) == (name, way)]
        for figure in found[0]:
            values = [each[figure] for each in found]
            numbers = (np.median(values), np.percentile(values, 90), max(values))
            row = " | ".join(f"{value:.2f}" for value in numbers)
            lines.append(f"| {name} | {way} | {len(found)} | {figure} | {row} |")
    return "\n".join(lines)


def draw(name: str, runs: Sequence[Run], file: Path) -> None:
    """Draw the runs of a case over time: what was sent, and the age of the image that was shown."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update({"svg.hashsalt": name, "svg.fonttype": "none"})
    from matplotlib import pyplot

    ways = list(dict.fromkeys(run.way for run in runs))
    steps = [step for step in CASES[name].steps if step[1].bits]
    figure, axes = pyplot.subplots(
        2, len(ways), figsize=(1 + 4 * len(ways), 4.4), layout="constrained", sharex=True, sharey="row",
        squeeze=False,
    )  # fmt: skip
    for (above, below), way in zip(axes.T, ways, strict=True):
        found = np.array([run.series for run in runs if run.way == way])
        at = BIN_SECONDS * np.arange(found.shape[1])
        for which, place in ((0, above), (2, below)):
            place.plot(at, found[:, :, which].T, color="tab:blue", linewidth=0.5, alpha=0.4)
            place.plot(at, np.median(found[:, :, which], axis=0), color="tab:blue")
        if steps:
            times = [*(begin for begin, _ in steps), CASES[name].end]
            above.stairs([line.bits / 1000 for _, line in steps], times, baseline=None, color="grey")
        above.set(title=f"{way}, {len(found)} runs", ylim=(0, None))
        below.set(xlabel="seconds", ylim=(0, None))
    axes[0, 0].set_ylabel("sent, kbit/s")
    axes[1, 0].set_ylabel("age of the image, s")
    figure.savefig(file, metadata={"Date": None})
    pyplot.close(figure)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m bench.network.changing_link", description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="further runs of each case (default 10)")
    parser.add_argument("--case", action="append", choices=CASES, help="only this case; repeatable")
    parser.add_argument("--way", action="append", choices=WAYS, help="only this way; repeatable")
    parser.add_argument(
        "--record", metavar="FILE", type=Path, help="add the runs to FILE, and use those in it"
    )
    parser.add_argument("--plots", metavar="FOLDER", type=Path, help="draw each case into link-CASE.svg")
    parser.add_argument("--robot", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--operator", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.robot:
        robot()
    elif options.operator:
        anyio.run(partial(operator, options.operator))
    else:
        _report(options)
    return 0


def _report(options: Any) -> None:
    chosen = [(name, way) for name in options.case or CASES for way in options.way or WAYS]
    runs = read_runs(options.record) if options.record else []
    for _ in range(options.runs):
        for name, way in chosen:
            run = record(name, way, sum((each.case, each.way) == (name, way) for each in runs))
            runs.append(run)
            print(f"{name}, {way}, run {run.seed}: {run.figures}", file=sys.stderr, flush=True)
            if options.record:
                with options.record.open("a") as file:
                    file.write(json.dumps(asdict(run)) + "\n")
    order = [pair for pair in chosen if any((run.case, run.way) == pair for run in runs)]
    runs = [run for pair in order for run in runs if (run.case, run.way) == pair]
    print(table(runs))
    if options.plots:
        options.plots.mkdir(parents=True, exist_ok=True)
        for name in dict.fromkeys(run.case for run in runs):
            file = options.plots / f"link-{name.replace(' %', '').replace(' ', '-').replace('/', '-')}.svg"
            draw(name, [run for run in runs if run.case == name], file)


if __name__ == "__main__":
    sys.exit(main())
