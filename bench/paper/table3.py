"""Table III: messages as pictures, their size and their time, beside CBOR and beside Pillow's default."""

from __future__ import annotations

import base64
import io
import math
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final
from unittest import mock

import msgspec
from PIL import Image

from bench.paper.report import Report
from bench.paper.text_messages import Sample, samples
from rwt_protocol.codecs import cbor, png
from rwt_protocol.codecs.json import publish_frame, publish_prefix
from rwt_protocol.frames import Frame

ROUNDS: Final = 9
PAPER_MAP: Final = (2725, 39, 40)
"""KB of JSON, KB as png, milliseconds."""

_NOTES: Final = """\
KB are 1000 bytes of a whole message, without a WebSocket header; ms are the quickest of nine on one core: of
png from the JSON text that is there already, of cbor from the message. zlib is png without the extra `fast`;
Pillow's default does the same work in other servers. Deflate is as this server does it where a client agrees
on it, with an empty context.
Of the paper's other rows only the sizes of two are known here, 42 KB and 78 KB; the messages here come near
one or the other. All are made up.
"""


@dataclass(frozen=True, slots=True)
class Bound:
    """Limits for one message as png with zlib: compression ratio and milliseconds."""

    ratio: float = 0.0
    milliseconds: float = math.inf


PROMISED: Final[Mapping[str, Bound]] = {
    "map, 9 characters a cell": Bound(ratio=PAPER_MAP[0] / PAPER_MAP[1], milliseconds=PAPER_MAP[2]),
    "42 KB of markers": Bound(milliseconds=0.5),
    "78 KB of markers": Bound(milliseconds=0.5),
}


@dataclass(frozen=True, slots=True)
class Taken:
    """Cost of one encoding: bytes and milliseconds."""

    size: int
    milliseconds: float


@dataclass(frozen=True, slots=True)
class Measured:
    """One message: bytes of JSON, and what each way takes."""

    name: str
    size: int
    ways: Mapping[str, Taken]


def picture_without_library(frame: Frame) -> Frame:
    """As png with zlib alone."""
    with mock.patch.object(png, "fast_library", lambda: None):
        return png.encode(frame)


def picture_by_pillow(frame: Frame) -> Frame:
    """The same picture as Pillow compresses it when it is not told otherwise."""
    text = frame.data
    width = int(math.sqrt(len(text) / 3))
    height = math.ceil(len(text) / 3 / width)
    out = io.BytesIO()
    Image.frombytes("RGB", (width, height), bytes(text).ljust(width * height * 3, b"\n")).save(out, "PNG")
    return Frame(msgspec.json.encode({"op": "png", "data": base64.b64encode(out.getvalue()).decode()}))


def deflated(frame: Frame) -> Frame:
    """As a compressed WebSocket message (RFC 7692), with the server's level and window."""
    packer = zlib.compressobj(3, zlib.DEFLATED, -12, 5)
    packed = b"".join((*map(packer.compress, frame.parts), packer.flush(zlib.Z_SYNC_FLUSH)))
    return Frame(packed[:-4], binary=True)


def take(sample: Sample, rounds: int = ROUNDS) -> Measured:
    """Send one message every way."""
    text = publish_frame(publish_prefix("/topic"), sample.json)
    message, to_cbor = sample.payload.value(), sample.payload.type.to_cbor

    def by_cbor() -> Frame:
        return cbor.publish_frame(cbor.publish_prefix("/topic"), to_cbor(message))

    ways: Mapping[str, Callable[[], Frame]] = {
        "zlib": lambda: picture_without_library(text),
        "png": lambda: png.encode(text),
        "Pillow": lambda: picture_by_pillow(text),
        "cbor": by_cbor,
        "cbor, deflate": lambda: deflated(by_cbor()),
    }
    return Measured(sample.name, text.size, {name: _quickest(way, rounds) for name, way in ways.items()})


def _quickest(way: Callable[[], Frame], rounds: int) -> Taken:
    best, size = math.inf, 0
    for _ in range(rounds):
        start = time.perf_counter()
        size = way().size
        best = min(best, time.perf_counter() - start)
    return Taken(size, best * 1000)


def measure(rounds: int = ROUNDS) -> Report:
    """The table."""
    results = [take(sample, rounds) for sample in samples()]
    before, after, milliseconds = PAPER_MAP
    names = list(results[0].ways)
    return Report(
        "Table III: messages as pictures (png), and as CBOR",
        ("", "JSON KB", *(column for name in names for column in (f"{name} KB", "ratio", "ms"))),
        [
            ("paper: map", f"{before:,}", f"{after}", f"{before / after:.0f}", f"{milliseconds}", *[""] * 12),
            *(_row(result) for result in results),
        ],
        (_NOTES,),
        out_of_bounds(results),
        partial(_plot, results),
    )


def _row(result: Measured) -> tuple[str, ...]:
    cells = [result.name, f"{result.size / 1000:,.0f}"]
    for taken in result.ways.values():
        cells += [
            f"{taken.size / 1000:,.1f}",
            f"{result.size / taken.size:.1f}",
            f"{taken.milliseconds:.2f}",
        ]
    return tuple(cells)


def out_of_bounds(results: Sequence[Measured]) -> list[str]:
    missed = []
    for result in results:
        bound, taken = PROMISED.get(result.name, Bound()), result.ways["zlib"]
        ratio = result.size / taken.size
        if ratio < bound.ratio or taken.milliseconds > bound.milliseconds:
            missed.append(f"{result.name}: {ratio:.1f}:1 in {taken.milliseconds:.2f} ms")
    return missed


def _plot(results: Sequence[Measured], file: Path) -> None:
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9, 4.5), layout="constrained")
    ways = [name for name in results[0].ways if name != "zlib"]
    for number, name in enumerate(ways):
        places = [place + 0.2 * (number - 1.5) for place in range(len(results))]
        axes.bar(places, [result.size / result.ways[name].size for result in results], 0.2, label=name)
    axes.set(yscale="log", ylabel="times smaller than JSON", title="Table III")
    axes.set_xticks(range(len(results)), [result.name for result in results], rotation=25, ha="right")
    axes.legend()
    figure.savefig(file, dpi=120)
    pyplot.close(figure)
