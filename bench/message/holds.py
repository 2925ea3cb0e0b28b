"""Longest time for which one message blocks the event loop of a server.

Covers the worst messages of up to 4 MB, in each encoding and both directions.

The server runs in this process, and a thread is its clients. What counts is CPU time of the loop's thread
between two looks at the sockets, in proportion to what a fixed piece of work takes at the time, so that other
programs on the machine hardly matter. Each figure is the least of some runs; the first, in which types are
compiled, is left out. Garbage is collected as `rwt serve` does it.

Example: python -m bench.message.holds --only Path
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import json
import math
import random
import selectors
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any
from urllib.parse import urlsplit

import anyio.to_thread

from bench.traffic.messages import Stream
from bench.traffic.wire import BINARY, TEXT, Connection, ConnectionLost, Loop, masked
from rwt import Server
from rwt.cli.commands.serve import BoundedGarbageCollection
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_protocol.codecs import bson_codec
from rwt_protocol.codecs.cbor import publish_prefix
from rwt_protocol.ops import Publish
from rwt_protocol.payloads import Decoded

RUNS = 3
PATIENCE_SECONDS = 5.0
BOUND_MS = 5.0
LISTS_BOUND_MS = 50.0
"""Of what a robot's program publishes as lists of Python's objects, checked before `publish` returns."""
QUIET_YARDSTICK = 0.010
"""CPU seconds that the fixed piece of work takes a quiet machine."""
HEADER = {"stamp": {"sec": 1_700_000_000, "nanosec": 500_000_000}, "frame_id": "map"}
Message = Mapping[str, Any]


class TimedSelector(selectors.DefaultSelector):
    """Notes the longest time between two looks at the sockets.

    Attributes:
        longest: CPU seconds of the thread.
    """

    def __init__(self) -> None:
        super().__init__()
        self.longest = 0.0
        self._returned = time.thread_time()

    def select(self, timeout: float | None = None) -> Any:
        self.longest = max(self.longest, time.thread_time() - self._returned)
        ready = super().select(timeout)
        self._returned = time.thread_time()
        return ready


@dataclass(frozen=True)
class Case:
    """One message: what is worst about it, its type, and how clients write it.

    Attributes:
        fitting: what of it fits into other encodings (`limits.structure_bytes`).
        are_objects: whether a program has it as a list of objects that have to be looked at one by one.
    """

    label: str
    type: str
    message: Message
    fitting: Mapping[str, Message] = field(default_factory=dict)
    are_objects: bool = False


def cases() -> Iterator[Case]:
    """Messages of 3 to 4 MB in JSON."""
    source = random.Random(1)
    pose = [
        {
            "position": {"x": source.random(), "y": source.random(), "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": source.random(), "w": 1.0},
        }
        for _ in range(18_000)
    ]
    poses = [{"header": HEADER, "pose": each} for each in pose]
    some: Message = {"header": HEADER, "poses": poses[:1300]}
    whole: Message = {"header": HEADER, "poses": poses}
    yield Case("Path", "nav_msgs/Path", whole, {"CBOR": some, "BSON": some}, are_objects=True)
    some = {"poses": [{"pose": each} for each in pose[:1300]]}
    whole = {"poses": [{"pose": each} for each in pose[:9000]]}
    yield Case("Path, no headers", "nav_msgs/Path", whole, {"CBOR": some, "BSON": some}, are_objects=True)
    layout = {"dim": [], "data_offset": 0}
    doubles = [source.random() * 100 for _ in range(210_000)]
    whole, some = ({"layout": layout, "data": each} for each in (doubles, doubles[:100_000]))
    yield Case("float64 array", "std_msgs/Float64MultiArray", whole, {"BSON": some})
    singles = [round(source.random() * 100, 3) for _ in range(500_000)]
    whole, some = ({"layout": layout, "data": each} for each in (singles, singles[:100_000]))
    yield Case(
        "float32 array, not exact", "std_msgs/Float32MultiArray", whole, {"BSON": some}, are_objects=True
    )
    cells = source.choices((-1, 0, 100), k=1_300_000)
    meta = {"resolution": 0.5, "width": 1300, "height": 1000}
    whole, some = ({"info": meta, "data": each} for each in (cells, cells[:120_000]))
    yield Case("OccupancyGrid, no stamp", "nav_msgs/OccupancyGrid", whole, {"BSON": some}, are_objects=True)
    pixels = {"height": 1000, "width": 1000, "encoding": "rgb8", "step": 3000}
    octets = base64.b64encode(source.randbytes(3_000_000)).decode()
    yield Case("Image, no stamp", "sensor_msgs/Image", {**pixels, "data": octets})
    numbers = [source.randrange(256) for _ in range(1_000_000)]
    yield Case("Image, octets as numbers", "sensor_msgs/Image", {**pixels, "data": numbers})
    text = "".join(source.choices('abcdefghij\n"é', k=2_500_000))
    yield Case("String with escapes", "std_msgs/String", {"data": text})


class Clients:
    """A publisher and a subscriber, driven by a thread of their own."""

    def __init__(self, url: str, selector: TimedSelector) -> None:
        self._url = urlsplit(url)
        self._selector = selector

    def hold(
        self, stream: Stream, compression: str, frames: list[bytes], publish: Callable[[], object] | None
    ) -> float:
        """CPU milliseconds for which a message held the loop on its way to the subscriber.

        Args:
            stream: its topic.
            compression: what the subscriber asks for.
            frames: the subscription, the advertisement and the message, as they are sent.
            publish: else makes the robot publish it.
        """
        loop = Loop()
        subscriber, publisher = (
            Connection(loop, str(self._url.hostname), self._url.port or 0) for _ in range(2)
        )
        try:
            subscriber.send(frames[0])
            publisher.send(frames[1])
            loop.settle()
            least = float("inf")
            for run in range(RUNS + 1):
                expected = subscriber.received + 1
                self._selector.longest = 0.0
                if publish is None:
                    publisher.send(frames[2])
                else:
                    publish()
                try:
                    if not loop.until(partial(subscriber.has, expected), PATIENCE_SECONDS):
                        return float("nan")
                except ConnectionLost:
                    return float("nan")
                if run:
                    least = min(least, self._selector.longest)
            return least * 1e3
        finally:
            subscriber.close()
            publisher.close()
            loop.close()


@dataclass(frozen=True)
class Row:
    """One way of one message.

    Attributes:
        held: milliseconds; no number where nothing came.
        bound: milliseconds, at most.
    """

    label: str
    held: float
    bound: float

    @property
    def is_over(self) -> bool:
        """True if the loop was blocked for longer than allowed, or the message did not arrive."""
        return not self.held <= self.bound

    def __str__(self) -> str:
        remark = "nothing came" if math.isnan(self.held) else "too long" if self.is_over else ""
        return f"{self.label:52}{self.held:9.2f}{self.bound:7.0f}  {remark}"


def yardstick() -> float:
    """CPU seconds that a fixed piece of work takes this thread now."""
    begin, found = time.thread_time(), 0
    for number in range(200_000):
        found += number & 7
    assert found == 700_000
    return time.thread_time() - begin


async def measure(only: str, selector: TimedSelector) -> list[Row]:
    """Every case and way."""
    rows: list[Row] = []
    registry = Registry()
    loop = asyncio.get_running_loop()
    collections = BoundedGarbageCollection(loop.call_soon)
    collections.begin()
    for bson in (False, True):
        async with Server("ws://127.0.0.1:0", bson_only_mode=bson) as server:
            clients = Clients(server.urls[0], selector)
            node = server.node("robot")
            for number, case in enumerate(case for case in cases() if only in case.label):
                type = registry.message(case.type)
                robot = node.advertise(f"/held_{number}", case.type)
                for way_in, compression in ways(bson):
                    message = case.fitting.get(way_in, case.message)
                    stream = Stream(f"/held_{number}", case.type, (message,))
                    made: Any = Payload.from_value(type, message).value()
                    frames = [
                        framed(stream.subscribe(compression), bson),
                        framed(stream.advertise(), bson),
                        published(stream, message, made, way_in),
                    ]
                    publish = partial(loop.call_soon_threadsafe, robot.publish, made)
                    slow = yardstick()
                    took = await anyio.to_thread.run_sync(
                        clients.hold, stream, compression, frames, publish if way_in == "robot" else None
                    )
                    slow = min(slow, yardstick())
                    output = "BSON" if bson else compression.replace("none", "JSON")
                    label = f"{case.label}: {way_in} → {output}"
                    bound = LISTS_BOUND_MS if way_in == "robot" and case.are_objects else BOUND_MS
                    rows.append(Row(label, took / max(1.0, slow / QUIET_YARDSTICK), bound))
                    print(rows[-1], flush=True)
    collections.end()
    return rows


def ways(bson: bool) -> list[tuple[str, str]]:
    """From whom a message comes, and what its subscriber asks for."""
    if bson:
        return [("BSON", "none"), ("robot", "none")]
    outputs = ("none", "cbor", "cbor-raw", "png")
    return [
        *(("JSON", output) for output in outputs),
        ("CBOR", "none"),
        *(("robot", output) for output in outputs),
    ]


def framed(text: bytes, bson: bool) -> bytes:
    """A message in JSON as the server takes it."""
    if not bson:
        return masked(text, TEXT)
    import bson as library

    return masked(library.encode(json.loads(text)), BINARY)


def published(stream: Stream, message: Message, made: Any, way_in: str) -> bytes:
    """The message as a frame."""
    if way_in == "JSON":
        return masked(stream.publish(message), TEXT)
    if way_in == "robot":
        return b""
    payload = Payload.from_value(Registry().message(stream.type), made)
    if way_in == "CBOR":
        return masked(publish_prefix(stream.topic) + payload.cbor(), BINARY)
    return masked(bson_codec().encode(Publish(topic=stream.topic, msg=Decoded(payload.plain()))).data, BINARY)


def main() -> int:
    """Print the table."""
    summary, _, example = (__doc__ or "").partition("Example: ")
    parser = argparse.ArgumentParser(
        prog="python -m bench.message.holds", description=summary, epilog=example
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="only messages whose label has this in it")
    parser.add_argument("--check", action="store_true", help=f"exit with 1 when one takes over {BOUND_MS} ms")
    options = parser.parse_args()
    selector = TimedSelector()
    print(f"{'':52}{'ms held':>9}{'limit':>7}")
    with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(selector)) as runner:
        rows = runner.run(measure(options.only, selector))
    return int(options.check and any(row.is_over for row in rows))


if __name__ == "__main__":
    sys.exit(main())
