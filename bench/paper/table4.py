"""Table IV: large messages of today's robots in each encoding: bytes, time, and largest error."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import zstandard

from bench.paper.lidar_scene import Cloud, by_firing, by_ring, without_order
from bench.paper.report import Report
from rwt_interfaces.point_clouds.compressed import compress, decompress
from rwt_interfaces.point_clouds.wish import DRACO, CloudWish

ROUNDS: Final = 15

_NOTES: Final = """\
KB are 1000 bytes; ms are the CPU time of the quickest of fifteen on one core. Ratios are to the raw bytes.
The LiDAR is a ray cast between boxes on a plain, 64 rings with 2 cm of noise; none of it is a recording.
Points have x, y, z and intensity, 16 bytes. The largest error is that of x, y and z, measured.
"""


@dataclass(frozen=True, slots=True)
class Way:
    """A message in one encoding.

    Attributes:
        message, name: of the row.
        raw, size: bytes of the message as the robot has it, and encoded.
        encode_ms, decode_ms: CPU time.
        error: largest error, in the message's unit; nan if the order is another.
    """

    message: str
    name: str
    raw: int
    size: int
    encode_ms: float
    decode_ms: float
    error: float

    @property
    def ratio(self) -> float:
        return self.raw / self.size


@dataclass(frozen=True, slots=True)
class Bound:
    """Smallest ratio and longest time to encode of a row."""

    ratio: float
    encode_ms: float


PROMISED: Final[Mapping[tuple[str, str], Bound]] = {
    ("LiDAR, by ring", "planes, 1 mm"): Bound(5.5, 10.0),
    ("LiDAR, by firing", "planes, 1 mm"): Bound(5.5, 10.0),
    ("LiDAR, no order", "planes, 1 mm, sorted"): Bound(3.5, 30.0),
    ("LiDAR, by ring", "Draco, 1 mm"): Bound(5.0, 45.0),
}


def measure(rounds: int = ROUNDS) -> Report:
    """The table."""
    ways = list(clouds(rounds))
    return Report(
        "Table IV: messages of today's robots",
        ("", "encoding", "raw KB", "KB", "ratio", "encode ms", "decode ms", "largest error"),
        [_row(way) for way in ways],
        (_NOTES,),
        out_of_bounds(ways),
        partial(_plot, ways),
    )


def clouds(rounds: int = ROUNDS) -> Iterator[Way]:
    """Measure the LiDAR's clouds."""
    for name, cloud in (
        ("LiDAR, by ring", by_ring()),
        ("LiDAR, by firing", by_firing()),
        ("LiDAR, no order", without_order()),
    ):
        yield _squeezed(name, cloud.data)
        yield _cloud(name, "planes, lossless", cloud, CloudWish(precision=0), rounds)
        yield _cloud(name, "planes, 1 mm", cloud, CloudWish(), rounds)
        if "no order" in name:
            yield _cloud(name, "planes, 1 mm, sorted", cloud, CloudWish(order="any"), rounds)
        yield _cloud(name, "Draco, 1 mm", cloud, CloudWish(format=DRACO), rounds)
        yield _cloud(name, "Draco, 1 mm, sorted", cloud, CloudWish(order="any", format=DRACO), rounds)


def _cloud(message: str, name: str, cloud: Cloud, wish: CloudWish, rounds: int) -> Way:
    sent, encode_ms = quickest(lambda: compress(cloud, wish), rounds)
    received = SimpleNamespace(**{**sent, "fields": [SimpleNamespace(**each) for each in sent["fields"]]})
    found, decode_ms = quickest(lambda: decompress(received), rounds)
    places = [np.frombuffer(each, "<f4").reshape(-1, 4)[:, :3] for each in (cloud.data, found["data"])]
    is_sorted = wish.order == "any"
    error = math.nan if is_sorted else float(np.abs(places[0].astype(float) - places[1]).max())
    return Way(message, name, len(cloud.data), len(sent["compressed_data"]), encode_ms, decode_ms, error)


def _squeezed(message: str, data: bytes) -> Way:
    """Measure the reference point: what is left of the raw bytes without knowing anything of them."""
    packed, encode_ms = quickest(lambda: zstandard.compress(data, 19), 1)
    _, decode_ms = quickest(lambda: zstandard.decompress(packed), 1)
    return Way(message, "zstd -19 of raw", len(data), len(packed), encode_ms, decode_ms, 0.0)


def quickest(action: Callable[[], Any], rounds: int) -> tuple[Any, float]:
    """Return the result and the least CPU time, in milliseconds."""
    best, found = math.inf, None
    for _ in range(rounds):
        started = time.thread_time()
        found = action()
        best = min(best, time.thread_time() - started)
    return found, best * 1000


def _row(way: Way) -> tuple[str, ...]:
    return (
        way.message,
        way.name,
        f"{way.raw / 1000:,.0f}",
        f"{way.size / 1000:,.1f}",
        f"{way.ratio:.2f}",
        f"{way.encode_ms:.1f}",
        f"{way.decode_ms:.1f}",
        "(sorted)" if math.isnan(way.error) else f"{way.error:.2g}",
    )


def out_of_bounds(ways: Sequence[Way]) -> list[str]:
    """Return the rows beyond their bounds, in words."""
    missed = []
    for way in ways:
        bound = PROMISED.get((way.message, way.name))
        if bound and (way.ratio < bound.ratio or way.encode_ms > bound.encode_ms):
            missed.append(f"{way.message}, {way.name}: {way.ratio:.2f}:1 in {way.encode_ms:.1f} ms")
    return missed


def _plot(ways: Sequence[Way], file: Path) -> None:
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9, 0.35 * len(ways) + 1.5), layout="constrained")
    places = range(len(ways))
    axes.barh(places, [way.ratio for way in ways])
    axes.set(xscale="log", xlabel="times smaller than raw", title="Table IV")
    axes.set_yticks(places, [f"{way.message}: {way.name}" for way in ways])
    axes.invert_yaxis()
    figure.savefig(file, dpi=120)
    pyplot.close(figure)
