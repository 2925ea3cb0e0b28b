"""Table I: what a camera of 640x480 at 30 Hz costs. `python -m bench.paper.table1 --seconds 120`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import fmean, median
from typing import Any, Final

from bench.paper.camera import MARKED_ROWS, RATE, Picture, pictures, read_mark
from bench.paper.likeness import psnr, ssim
from bench.paper.report import Report
from bench.paper.watching import Counted, Pictures, by_parts, by_rosbridge, by_video
from bench.traffic.processes import Server

SECONDS: Final = 12.0
"""Of each column. The paper has two minutes; the camera goes round in ten seconds, so more says the same."""
WARM_UP_SECONDS: Final = 2.0
_KEEP_EVERY: Final = 29
"""Of the decoded pictures one in so many is compared with what was sent; no divisor of a round."""
_MOST_DELAY: Final = 60
"""Milliseconds."""


_NOTES: Final = (
    (
        "KB are 1000 bytes as they come to the client; CPU is the server's of one core, with the camera;\n"
        "ms are from publishing to the decoded picture in another process."
    ),
    (
        "The pictures are drawn, with the noise of a sensor; the paper's come from a real camera, so codecs\n"
        "compare in order of magnitude. PSNR and SSIM count the noise as picture."
    ),
    "The paper's raw is what reached the client; all of 640x480 at 30 Hz is 27,648 KB/s.",
)


@dataclass(frozen=True, slots=True)
class Column:
    """One way to watch.

    Attributes:
        name: for the table.
        watch: yields decoded pictures.
        paper: KB/s in the paper; None where it has no such column.
    """

    name: str
    watch: Callable[[str, int, Counted], Pictures]
    paper: int | None = None


COLUMNS: Final = (
    Column("raw, JSON", lambda host, port, counted: by_rosbridge(host, port, "none", counted)),
    Column("raw, cbor", lambda host, port, counted: by_rosbridge(host, port, "cbor", counted), 12_052),
    Column("MJPEG q90", lambda host, port, counted: by_parts(host, port, "quality=90", counted), 1_317),
    Column("MJPEG q50", lambda host, port, counted: by_parts(host, port, "quality=50", counted)),
    Column("VP8 2.7 Mbit/s", lambda h, p, c: by_video(h, p, "type=vp8&bitrate=2736000&qmin=4", c), 342),
    Column("VP8 default", lambda host, port, counted: by_video(host, port, "type=vp8", counted)),
    Column("VP9 1.3 Mbit/s", lambda h, p, c: by_video(h, p, "type=vp9&bitrate=1300000&qmin=4", c)),
    Column(
        "H.264 2.7 Mbit/s", lambda h, p, c: by_video(h, p, "type=h264&bitrate=2736000&preset=veryfast", c)
    ),
)


@dataclass(slots=True)
class Watched:
    """Measurements of one column.

    Attributes:
        seconds: how long it was measured.
        bytes: that came meanwhile.
        delays: milliseconds from publishing to the decoded picture, of each.
        kept: some of the pictures, with their numbers.
        cpu: seconds of the server's processors, of all its threads.
    """

    seconds: float = 0.0
    bytes: int = 0
    delays: list[int] = field(default_factory=list)
    kept: list[tuple[int, Picture]] = field(default_factory=list)
    cpu: float = 0.0

    @property
    def rate(self) -> float:
        """KB/s, of 1000 bytes."""
        return self.bytes / 1000 / self.seconds

    @property
    def frequency(self) -> float:
        """Pictures a second."""
        return len(self.delays) / self.seconds


def watch(server: Server, column: Column, seconds: float) -> Watched:
    """Watch for so long, after a moment in which codecs find their rate."""
    watched, counted = Watched(), Counted()
    begun = time.perf_counter()
    measuring, first_bytes, first_cpu = False, 0, 0.0
    shown = column.watch(server.host, server.port, counted)
    with closing(shown):
        for picture in shown:
            now = time.perf_counter()
            number, delay = read_mark(picture)
            if not measuring and now - begun >= WARM_UP_SECONDS:
                measuring, begun = True, now
                first_bytes, first_cpu = counted.bytes, server.cpu_time().used
            elif measuring:
                watched.delays.append(delay)
                if len(watched.delays) % _KEEP_EVERY == 0:
                    watched.kept.append((number, picture.copy()))
                if now - begun >= seconds:
                    break
    watched.seconds = now - begun
    watched.bytes = counted.bytes - first_bytes
    watched.cpu = server.cpu_time().used - first_cpu
    return watched


def measure(seconds: float = SECONDS) -> Report:
    """The table."""
    pictures()
    server = Server("camera", ["-m", "bench.paper.camera"])
    try:
        results = [(column, watch(server, column, seconds)) for column in COLUMNS]
    finally:
        server.stop()
    return Report(
        title=f"Table I: a camera of 640x480 at {RATE} Hz, {seconds:g} s of each",
        head=("", "paper KB/s", "KB/s", "of raw", "Hz", "PSNR dB", "SSIM", "CPU %", "median ms", "95 % ms"),
        rows=[_row(column, watched, results[1][1].rate) for column, watched in results],
        notes=_NOTES,
        missed=_missed(results),
        plot=partial(_plot, results),
    )


def _row(column: Column, watched: Watched, raw: float) -> Sequence[str]:
    sent = pictures()
    pairs = [(shown[MARKED_ROWS:], sent[number][MARKED_ROWS:]) for number, shown in watched.kept]
    delays = sorted(watched.delays)
    return (
        column.name,
        "" if column.paper is None else f"{column.paper:,}",
        f"{watched.rate:,.0f}",
        f"{watched.rate / raw:.1%}",
        f"{watched.frequency:.1f}",
        f"{fmean(min(psnr(*pair), 99.9) for pair in pairs):.1f}",
        f"{fmean(ssim(*pair) for pair in pairs):.3f}",
        f"{watched.cpu / watched.seconds:.0%}",
        f"{median(delays):.0f}",
        f"{delays[int(len(delays) * 0.95)]}",
    )


def _missed(results: Sequence[tuple[Column, Watched]]) -> list[str]:
    """A picture must come in time, and as many as are published."""
    return [
        f"{column.name}: {watched.frequency:.1f} Hz, median {median(watched.delays):.0f} ms"
        for column, watched in results
        if watched.frequency < 0.9 * RATE or median(watched.delays) > _MOST_DELAY
    ]


def _plot(results: Sequence[tuple[Column, Watched]], file: Path) -> None:
    import matplotlib.pyplot as plt

    figure: Any
    axes: Any
    figure, axes = plt.subplots(figsize=(8, 4))
    names = [column.name for column, _ in results]
    places = range(len(names))
    axes.bar([at - 0.2 for at in places], [column.paper or 0 for column, _ in results], 0.4, label="paper")
    axes.bar([at + 0.2 for at in places], [watched.rate for _, watched in results], 0.4, label="here")
    axes.set(yscale="log", ylabel="KB/s", title="Table I: 640x480 at 30 Hz")
    axes.set_xticks(list(places), names, rotation=30, ha="right")
    axes.legend()
    figure.tight_layout()
    figure.savefig(file, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS, help=f"of each (default {SECONDS:g})")
    print(measure(parser.parse_args().seconds).text())
