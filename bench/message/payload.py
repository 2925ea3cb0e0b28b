"""Cost of one message in microseconds, for each way in and each form out, as one table.

Run it with ``python -m bench.message.payload``. Each figure is the best of several runs, in one process, for
messages as clients send them.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry

STAMP = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "base"}


def samples() -> dict[str, tuple[str, Any]]:
    """By label: a type and a value of it."""
    ranges = np.random.default_rng(1).random(10_000).astype(np.float32).round(4).tolist()
    cells = np.random.default_rng(2).choice([-1, 0, 100], 300_000).tolist()
    image = {"height": 480, "width": 640, "encoding": "rgb8", "step": 1920, "data": os.urandom(921_600)}
    return {
        "Twist": ("geometry_msgs/Twist", {"linear": {"x": 0.5}, "angular": {"z": -0.25}}),
        "Odometry": ("nav_msgs/Odometry", {"header": STAMP, "child_frame_id": "base_link"}),
        "LaserScan 10k": ("sensor_msgs/LaserScan", {"header": STAMP, "ranges": ranges}),
        "LaserScan 10k numpy, inf": (
            "sensor_msgs/LaserScan",
            {"header": STAMP, "ranges": np.array([*ranges[1:], math.inf], np.float32)},
        ),
        "OccupancyGrid 300k": ("nav_msgs/OccupancyGrid", {"header": STAMP, "data": cells}),
        "String 1 MB": ("std_msgs/String", {"data": "x" * 1_000_000}),
        "Image 640x480": ("sensor_msgs/Image", {"header": STAMP, **image}),
    }


def best(action: Callable[[], object]) -> float:
    """Microseconds of the fastest of about 0.2 s of runs."""
    fastest = math.inf
    ends = time.perf_counter() + 0.2
    while time.perf_counter() < ends:
        started = time.perf_counter()
        for _ in range(5):
            action()
        fastest = min(fastest, (time.perf_counter() - started) / 5)
    return fastest * 1e6


def measure(registry: Registry, name: str, value: Any) -> dict[str, float]:
    """Every way in and out of one message."""
    kind = registry.message(name)
    made = Payload.from_value(kind, value)
    struct: Any = made.value()
    raw = memoryview(bytes(made.json()))
    partial = (
        memoryview(json.dumps({**json.loads(bytes(raw)), "header": {}}).encode())
        if "header" in dir(struct)
        else raw
    )
    cdr, ros1 = made.cdr(), kind.to_ros1(struct)
    actions: dict[str, Callable[[], object]] = {
        "json in": lambda: Payload.from_json(kind, raw),
        "stamped": lambda: Payload.from_json(kind, partial).json(),
        "in, value": lambda: Payload.from_json(kind, raw).value(),
        "struct in": lambda: Payload.from_value(kind, struct),
        "dict in": lambda: Payload.from_value(kind, value),
        "json out": lambda: kind.json.encode(struct),
        "cbor out": lambda: kind.to_cbor(struct),
        "cdr out": lambda: kind.to_cdr(struct),
        "ros1 out": lambda: kind.to_ros1(struct),
        "cdr in": lambda: Payload.from_cdr(kind, cdr),
        "ros1 in": lambda: Payload.from_ros1(kind, ros1),
    }
    return {label: best(action) for label, action in actions.items()}


def main() -> None:
    """Print the table."""
    registry = Registry()
    header_printed = False
    for label, (name, value) in samples().items():
        row = measure(registry, name, value)
        if not header_printed:
            print(f"{'µs':26}" + "".join(f"{column:>11}" for column in row))
            header_printed = True
        print(f"{label:26}" + "".join(f"{figure:11.4g}" for figure in row.values()))


if __name__ == "__main__":
    main()
