"""`python -m bench.page.latency`: how old a camera's picture is when Chromium shows it.

A camera of 640x480 at 30 Hz in a process with the server; each picture carries the time of its publishing,
and a page in headless Chromium reads it from the pixels that it got. `catch-up` is the page's own: it plays
faster while the player holds more than a tenth of a second.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Final

import anyio

from bench.paper.camera import RATE, pictures
from bench.paper.report import Report
from bench.traffic.processes import Server
from tests.browser.driver import Browser, find_browser, opened_browser

SECONDS: Final = 10.0
_WARM_UP: Final = 6.0
MOST: Final = {"mjpeg": 60, "WebRTC": 80}
"""Milliseconds, the medians that are the project's own bounds."""

WAYS: Final = (
    "element=WebRTC",
    "type=mjpeg&quality=80",
    "type=mjpeg&quality=95",
    "type=vp8&bitrate=2736000&qmin=4",
    "type=vp9&bitrate=1300000&qmin=4",
    "type=h264&bitrate=2736000&preset=veryfast",
    "type=vp8&bitrate=2736000&qmin=4&catch-up",
    "type=h264&bitrate=2736000&preset=veryfast&catch-up",
)

_NOTES: Final = (
    "From publishing to the decoded pixel. MJPEG is looked at with each frame of the screen, at 60 Hz.",
    "element=WebRTC is <rwt-video>, as it chooses by itself.",
    "Videos are late because a <video> begins to play when it holds a stock, and keeps it.",
)


@dataclass(frozen=True, slots=True)
class Seen:
    """Measurements of a page.

    Attributes:
        way: the stream's parameters.
        ages: of each picture, from its publishing to the decoded pixel; milliseconds, sorted.
    """

    way: str
    ages: Sequence[int]

    @property
    def median(self) -> float:
        """Milliseconds."""
        return median(self.ages)


async def watch(browser: Browser, url: str, way: str, seconds: float, warm_up: float = _WARM_UP) -> Seen:
    """Look at a stream for so long, after a moment in which it finds its pace.

    Args:
        browser: opens the page.
        url: of the server, with a slash at the end; its camera is that of :mod:`bench.paper.camera`.
        way: the stream's parameters.
        seconds: of looking.
        warm_up: seconds before it.

    Raises:
        RuntimeError: no picture was seen.
    """
    async with browser.page(f"{url}latency.html?{way}", 640, 480) as page:
        await page.wait("ages.length > 0")
        await anyio.sleep(warm_up)
        await page.evaluate("void (ages.length = 0)")
        await anyio.sleep(seconds)
        ages = sorted(await page.evaluate("ages"))
    if not ages:
        raise RuntimeError(f"{way}: the page saw no new picture in {seconds:g} s")
    return Seen(way, ages)


def measure(browser: Browser, seconds: float = SECONDS, ways: Sequence[str] = WAYS) -> Report:
    """The table."""
    pictures()
    server = Server("camera", ["-m", "bench.paper.camera"])
    try:
        url = f"http://{server.host}:{server.port}/"
        seen = [anyio.run(watch, browser, url, way, seconds) for way in ways]
    finally:
        server.stop()
    return Report(
        title=f"A camera of 640x480 at {RATE} Hz in Chromium {browser.version}, {seconds:g} s of each",
        head=("", "median ms", "95 % ms", "Hz"),
        rows=[_row(each, seconds) for each in seen],
        notes=_NOTES,
        missed=missed(seen),
    )


def _row(seen: Seen, seconds: float) -> Sequence[str]:
    late = seen.ages[int(len(seen.ages) * 0.95)]
    return seen.way, f"{seen.median:.0f}", f"{late}", f"{len(seen.ages) / seconds:.1f}"


def missed(seen: Sequence[Seen]) -> list[str]:
    """Describe the values above the limit."""
    return [
        f"{each.way}: median {each.median:.0f} ms, bound {most} ms"
        for each in seen
        for way, most in MOST.items()
        if way in each.way and each.median > most
    ]


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.page.latency", description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS, help=f"of each (default {SECONDS:g})")
    parser.add_argument("--check", action="store_true", help="exit with 1 when a bound is missed")
    parser.add_argument("--only", default="", metavar="TEXT", help="only the ways that contain this")
    options = parser.parse_args(argv)
    kind = find_browser()
    if kind is None:
        parser.error("the browser is not installed; name its program in the environment variable CHROMIUM")
    with TemporaryDirectory() as folder, opened_browser(kind, Path(folder)) as opened:
        report = measure(opened, options.seconds, [way for way in WAYS if options.only in way])
    print(report.text())
    return int(bool(report.missed) and options.check)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
