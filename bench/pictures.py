"""`python -m bench.pictures`: messages as pictures, their size and their time, beside Pillow's default.

The sizes are those of Table III of "Robot Web Tools: Efficient Messaging for Cloud Robotics" (IROS 2015):
a map of 732x413 cells in 2.7 MB of JSON, and marker arrays of 42 KB and 78 KB. The other rows are what
compresses worse. Exit code 1 when a bound is missed.
"""

from __future__ import annotations

import base64
import io
import json
import math
import random
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from unittest import mock

from PIL import Image

from rwt_protocol.codecs import png
from rwt_protocol.codecs.json import publish_frame, publish_prefix
from rwt_protocol.frames import Frame

WIDTH, HEIGHT = 732, 413
ROOMS = 25
ROUNDS = 9


@dataclass(frozen=True, slots=True)
class Bound:
    """What is promised of one message: at least so many times smaller, in at most so many milliseconds."""

    ratio: float = 0.0
    milliseconds: float = math.inf


PROMISED: Mapping[str, Bound] = {
    "map, 5 decimals": Bound(ratio=70, milliseconds=40),
    "42 KB of markers": Bound(milliseconds=0.5),
    "78 KB of markers": Bound(milliseconds=0.5),
}


def cells() -> list[int]:
    """The cells of a floor with rooms: unknown, free, and walls."""
    source = random.Random(1)
    grid = [[-1] * WIDTH for _ in range(HEIGHT)]
    for _ in range(ROOMS):
        left, top = source.randrange(20, WIDTH - 120), source.randrange(20, HEIGHT - 80)
        width, height = source.randrange(30, 110), source.randrange(20, 70)
        for y in range(top, top + height):
            for x in range(left, left + width):
                is_wall = x in (left, left + width - 1) or y in (top, top + height - 1)
                grid[y][x] = 100 if is_wall else 0
    return [cell for row in grid for cell in row]


def markers(count: int) -> dict[str, object]:
    source = random.Random(2)
    return {"markers": [_marker(source, number) for number in range(count)]}


def _marker(source: random.Random, number: int) -> dict[str, object]:
    x, y = source.uniform(-5, 5), source.uniform(-5, 5)
    return {
        "header": {"stamp": {"sec": 1_700_000_000, "nanosec": 12_345}, "frame_id": "map"},
        "ns": "people",
        "id": number,
        "type": 3,
        "action": 0,
        "pose": {
            "position": {"x": x, "y": y, "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        },
        "scale": {"x": 0.5, "y": 0.5, "z": 1.8},
        "color": {"r": 0.0, "g": 1.0, "b": 0.0, "a": 0.8},
        "lifetime": {"sec": 0, "nanosec": 0},
        "frame_locked": False,
        "points": [],
        "colors": [],
        "text": "",
        "mesh_resource": "",
        "mesh_use_embedded_materials": False,
    }


def messages() -> Iterator[tuple[str, Frame]]:
    """What is compressed: a name, and the message in JSON."""
    grid = cells()
    source = random.Random(3)
    yield "map, as this server writes it", _frame({"data": grid})
    # Nine characters to a cell make the 2.7 MB of the paper.
    yield "map, 5 decimals", _frame(b'{"data":[' + b",".join(b"%.5f" % cell for cell in grid) + b"]}")
    yield "42 KB of markers", _frame(markers(90))
    yield "78 KB of markers", _frame(markers(168))
    scan = [round(3 + math.sin(n / 50) + source.gauss(0, 0.01), 4) for n in range(100_000)]
    yield "100,000 distances", _frame({"ranges": scan})
    yield "noise, 900 KB in base64", _frame({"data": base64.b64encode(source.randbytes(900_000)).decode()})


def _frame(message: object) -> Frame:
    text = message if isinstance(message, bytes) else json.dumps(message, separators=(",", ":")).encode()
    return publish_frame(publish_prefix("/topic"), text)


def by_pillow(frame: Frame) -> Frame:
    """The same picture as Pillow compresses it when it is not told otherwise."""
    text = frame.data
    width = int(math.sqrt(len(text) / 3))
    height = math.ceil(len(text) / 3 / width)
    out = io.BytesIO()
    Image.frombytes("RGB", (width, height), text.ljust(width * height * 3, b"\n")).save(out, "PNG")
    data = base64.b64encode(out.getvalue()).decode()
    return Frame(json.dumps({"op": "png", "data": data}).encode())


def without_the_fast_library(frame: Frame) -> Frame:
    with mock.patch.object(png, "_fast_library", lambda: None):
        return png.encode(frame)


def measure(encode: Callable[[Frame], Frame], frame: Frame) -> tuple[float, float]:
    """How many times smaller, and the milliseconds of the quickest of several rounds."""
    best = math.inf
    for _ in range(ROUNDS):
        start = time.perf_counter()
        picture = encode(frame)
        best = min(best, time.perf_counter() - start)
    return frame.size / picture.size, best * 1e3


def main() -> int:
    ways = {"zlib": without_the_fast_library, "installed": png.encode, "Pillow": by_pillow}
    print(f"{'':32}{'bytes':>10}" + "".join(f"{name:>22}" for name in ways))
    missed = 0
    for name, frame in messages():
        found = {way: measure(encode, frame) for way, encode in ways.items()}
        row = "".join(f"{ratio:12.1f}:1{milliseconds:6.2f} ms" for ratio, milliseconds in found.values())
        bound = PROMISED.get(name, Bound())
        ratio, milliseconds = found["zlib"]
        holds = ratio >= bound.ratio and milliseconds <= bound.milliseconds
        missed += not holds
        print(f"{name:32}{frame.size:10,}{row}{'' if holds else '  <<< below'}")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
