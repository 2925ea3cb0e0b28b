"""`python -m bench.fleet.sizing`: CPU, network and memory that browsers with cameras and a map need.

The cost of a message to one subscriber and to many is measured, and their difference is the cost of one more
browser. Rates and numbers of browsers, cameras and maps are then multiplied.
"""

from __future__ import annotations

import argparse
import base64
import random
import sys
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from typing import Final

from bench.traffic.messages import Stream
from bench.traffic.processes import Server
from bench.traffic.wire import Connection, Loop, masked

_FEW: Final = 1
_MANY: Final = 25
_SECONDS: Final = 20.0
"""Maximum time of one message to all subscribers."""

_HEADER: Final = {"stamp": {"sec": 1_700_000_000, "nanosec": 500_000_000}, "frame_id": "map"}


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one message of a topic.

    Attributes:
        fixed: CPU seconds of a message without subscribers.
        each: CPU seconds per subscriber.
        size: bytes that a subscriber receives.
    """

    fixed: float
    each: float
    size: int

    def cores(self, rate: float, browsers: int) -> float:
        """Return the CPU seconds per second."""
        return rate * (self.fixed + browsers * self.each)


def camera(size: int) -> Stream:
    """Return a camera with JPEG images of that many bytes."""
    image = base64.b64encode(random.Random(6).randbytes(size)).decode()
    message = {"header": _HEADER, "format": "jpeg", "data": image}
    return Stream("/camera/image/compressed", "sensor_msgs/CompressedImage", (message,))


def grid(side: int) -> Stream:
    """Return a map of side * side cells."""
    source = random.Random(5)
    position, orientation = dict.fromkeys("xyz", 0), {"x": 0, "y": 0, "z": 0, "w": 1}
    origin = {"position": position, "orientation": orientation}
    info = {
        "map_load_time": _HEADER["stamp"],
        "resolution": 0.0625,
        "width": side,
        "height": side,
        "origin": origin,
    }
    cells = [source.choice((-1, 0, 100)) for _ in range(side * side)]
    return Stream("/map", "nav_msgs/OccupancyGrid", ({"header": _HEADER, "info": info, "data": cells},))


def measure(server: Server, stream: Stream, messages: int) -> Cost:
    """Measure the cost of one message of a stream."""
    text = stream.publish(stream.messages[0])
    few, many = (_seconds(server, stream, masked(text), count, messages) for count in (_FEW, _MANY))
    each = max(0.0, (many - few) / (_MANY - _FEW))
    return Cost(max(0.0, few - each), each, len(text))


def _seconds(server: Server, stream: Stream, frame: bytes, subscribers: int, messages: int) -> float:
    """Return the CPU seconds of one message."""
    with ExitStack() as stack:
        loop = stack.enter_context(closing(Loop()))
        publisher, *readers = [
            stack.enter_context(closing(Connection(loop, server.host, server.port)))
            for _ in range(1 + subscribers)
        ]
        publisher.send(masked(stream.advertise()))
        for reader in readers:
            reader.send(masked(stream.subscribe()))
        loop.settle(0.2)
        before = 0.0
        for number in range(-1, messages):
            if number == 0:  # The first message warms up.
                before = server.cpu_time().used
            due = sum(reader.received for reader in readers) + subscribers
            publisher.send(frame)
            if not loop.until(partial(_have_received, readers, due), _SECONDS):
                raise TimeoutError(f"a message of {stream.topic} did not arrive within {_SECONDS:g} s")
        return (server.cpu_time().used - before) / messages


def _have_received(readers: Sequence[Connection], due: int) -> bool:
    return sum(reader.received for reader in readers) >= due


def main(argv: Sequence[str] | None = None) -> int:
    """Print a table; return 1 if the browsers need more than one core."""
    parser = argparse.ArgumentParser(prog="python -m bench.fleet.sizing", description=__doc__)
    parser.add_argument("--browsers", type=int, default=100, help="default 100")
    parser.add_argument(
        "--cameras", type=int, default=3, help="cameras that each browser watches (default 3)"
    )
    parser.add_argument("--hz", type=float, default=15.0, help="images per second and camera (default 15)")
    parser.add_argument(
        "--image-bytes", type=int, default=40_000, help="bytes of a JPEG image (default 40,000)"
    )
    parser.add_argument("--map-side", type=int, default=400, help="cells of a map's side (default 400)")
    parser.add_argument("--map-hz", type=float, default=1.0, help="maps per second (default 1)")
    parser.add_argument("--messages", type=int, default=20, help="messages per measurement (default 20)")
    given = parser.parse_args(argv)
    with ExitStack() as stack:
        server = Server("rwt serve", ["-m", "rwt.cli", "serve", "ws://127.0.0.1:0"], quiet=True)
        stack.callback(server.stop)
        idle = server.memory().now
        rows = (
            ("cameras", measure(server, camera(given.image_bytes), given.messages), given.cameras * given.hz),
            ("map", measure(server, grid(given.map_side), given.messages), given.map_hz),
        )
        peak = server.memory().peak
    print(f"{'':8} {'µs/message':>11} {'µs/browser':>11} {'bytes':>9} {'cores':>7} {'Mbit/s':>8}")
    total = 0.0
    for name, cost, rate in rows:
        cores = cost.cores(rate, given.browsers)
        total += cores
        network = rate * given.browsers * cost.size * 8 / 1e6
        fixed, each = cost.fixed * 1e6, cost.each * 1e6
        print(f"{name:8} {fixed:11.0f} {each:11.1f} {cost.size:9,} {cores:7.3f} {network:8.0f}")
    print(f"memory: {idle:.0f} MB idle, {peak:.0f} MB at most with {_MANY} browsers")
    return 1 if total > 1.0 else 0


if __name__ == "__main__":
    sys.exit(main())
