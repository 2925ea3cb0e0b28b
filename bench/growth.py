"""`python -m bench --growth`: what a message costs as there is more of everything.

One curve for each thing that may grow: clients, topics, message size, encodings, rules of a role, and peers
over Zenoh. Each point is CPU time of the server's process, the median of some rounds. A curve of which a
stretch is steeper than linear fails `--check`. With `--plots FOLDER` each is drawn as an SVG, with a line
that grows in proportion beside it.
"""

from __future__ import annotations

import argparse
import base64
import itertools
import json
import math
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final

import anyio
import anyio.lowlevel

from bench.traffic import load, messages
from bench.traffic.dialects import DEFLATE, WrongAnswer
from bench.traffic.load import Throughput, Window
from bench.traffic.processes import Server
from bench.traffic.wire import Connection, Loop, masked
from bench.transport.zenoh import free_endpoint, small
from rwt.extensions.zenoh import ZenohGraph
from rwt_participant.qos import DEFAULT_QOS
from tests.waiting import until

ENCODINGS: Final = (DEFLATE, "png", "cbor", "none", "cbor-raw")
"""The dearest first, so that a curve that bends upwards says that one pays for another."""
PER_CONNECTION: Final = 500
"""Topics that one connection offers, within the quota of a client."""
BLOCK: Final = 32
"""Messages that one write of `topics` holds, each of another topic if there are so many."""
STEEPEST: Final = 1.35
"""Exponent of growth between two points above which a curve counts as steeper than linear. What is above 1 is
left to busy machines, and to caches that end somewhere."""
MICRO: Final = 1e6
READY_SECONDS: Final = 20.0

Point = Callable[[int, float], float]
"""From how much there is and for how many seconds to measure, to microseconds of CPU."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One thing that grows.

    Attributes:
        name: what it is called in `--only`, and its plot's file.
        title: of the plot.
        x: what there is more of.
        points: how much of it.
        tiny: the same for a run that only shows that it works.
        series: by name, what is measured.
        grows: whether the cost is to grow with `x` at all; otherwise it is to stay as it is.
    """

    name: str
    title: str
    x: str
    points: tuple[int, ...]
    tiny: tuple[int, ...]
    series: dict[str, Point]
    grows: bool = True


@dataclass(slots=True)
class Found:
    """The measurements of one curve: microseconds of CPU at each of its points, by series."""

    curve: Curve
    points: tuple[int, ...]
    costs: dict[str, list[float]] = field(default_factory=dict)

    def steepest(self, series: str) -> float:
        """The largest exponent of growth between a point above zero and the next that is twice as far or
        more: between nearer ones it says more about the machine than about the curve."""
        pairs = [
            (x, cost) for x, cost in zip(self.points, self.costs[series], strict=True) if x > 0 and cost > 0
        ]
        stretches = [
            (before, next((after for after in pairs if after[0] >= 2 * before[0]), None)) for before in pairs
        ]
        return max(
            (
                math.log(after[1] / before[1]) / math.log(after[0] / before[0])
                for before, after in stretches
                if after is not None
            ),
            default=0.0,
        )


@contextmanager
def serving(*arguments: str) -> Iterator[Server]:
    """`rwt serve` with these arguments, for the length of the block."""
    server = Server("rwt serve", ["-m", "rwt.cli", "serve", "ws://127.0.0.1:0", *arguments], quiet=True)
    try:
        yield server
    finally:
        server.stop()


def _cost(result: Throughput) -> float:
    """Microseconds of CPU for each of what was counted."""
    if result.lost:
        raise WrongAnswer(f"{result.lost} messages were lost")
    return result.cpu / result.count * MICRO


# -- clients ---------------------------------------------------------------------------------------------


def _clients(window: Window, count: int, seconds: float) -> float:
    with serving() as server:
        return _cost(load.fan_out(server, messages.twists(), count, window, seconds)) * count


# -- topics ----------------------------------------------------------------------------------------------


class ManyTopics:
    """So many topics, each with a publisher and a subscriber, a share of them on each pair of connections."""

    def __init__(self, server: Server, loop: Loop, count: int) -> None:
        self._server = server
        self._loop = loop
        self.shares: list[tuple[Connection, Connection, list[bytes]]] = []

        for start in range(0, count, PER_CONNECTION):
            streams = [
                messages.twists(f"/robot_{n}/cmd_vel")
                for n in range(start, min(start + PER_CONNECTION, count))
            ]
            publisher = Connection(loop, server.host, server.port)
            subscriber = Connection(loop, server.host, server.port)
            publisher.send(b"".join(masked(each.advertise()) for each in streams))
            loop.settle()
            subscriber.send(b"".join(masked(each.subscribe()) for each in streams))
            loop.settle()
            frames = [masked(each.publish(each.messages[0])) for each in streams]
            self.shares.append((publisher, subscriber, frames))

    def close(self) -> None:
        for publisher, subscriber, _ in self.shares:
            publisher.drop(reset=False)
            subscriber.drop(reset=False)

    @property
    def received(self) -> int:
        return sum(subscriber.received for _, subscriber, _ in self.shares)

    def publish(self, seconds: float, window: int = 64) -> float:
        """Microseconds of CPU for a message, while messages go to one topic after the other."""
        # Blocks of topics of one connection: it is topics that grow here, and not connections.
        turns = itertools.cycle(
            [
                (publisher, [frames[n % len(frames)] for n in range(first, first + BLOCK)])
                for publisher, _, frames in self.shares
                for first in range(0, len(frames), BLOCK)
            ]
        )
        start, sent = self.received, 0
        begin = self._server.cpu_time().used
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            while window - (sent - (self.received - start)) >= BLOCK:
                publisher, block = next(turns)
                publisher.send(b"".join(block))
                sent += BLOCK
            self._loop.turn(1.0)
        if not self._loop.until(lambda: self.received - start >= sent, READY_SECONDS):
            raise WrongAnswer(f"{sent - (self.received - start)} of {sent} messages never came")
        return (self._server.cpu_time().used - begin) / sent * MICRO


@contextmanager
def _many_topics(server: Server, count: int) -> Iterator[ManyTopics]:
    with closing(Loop()) as loop, closing(ManyTopics(server, loop, count)) as many:
        yield many


def _message_of_many(count: int, seconds: float) -> float:
    with serving() as server, _many_topics(server, count) as many:
        return many.publish(seconds)


def _new_topic(count: int, _seconds: float) -> float:
    """For each of so many topics: to advertise and to subscribe it."""
    with serving() as server:
        begin = server.cpu_time().used
        with _many_topics(server, count):
            return (server.cpu_time().used - begin) / count * MICRO


# -- message size ----------------------------------------------------------------------------------------


def _text(size: int, seconds: float) -> float:
    letters = base64.b64encode(random.Random(5).randbytes(size)).decode()[: max(1, size - 12)]
    return _one_to_one("/text", "std_msgs/String", {"data": letters}, size, seconds)


def _image(size: int, seconds: float) -> float:
    octets = max(1, size * 3 // 4)
    image = {
        "header": {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "camera"},
        "height": 1,
        "width": octets,
        "encoding": "mono8",
        "is_bigendian": 0,
        "step": octets,
        "data": base64.b64encode(random.Random(6).randbytes(octets)).decode(),
    }
    return _one_to_one("/camera/image_raw", "sensor_msgs/Image", image, size, seconds)


def _one_to_one(topic: str, type: str, message: dict[str, object], size: int, seconds: float) -> float:
    window = Window(64, 8) if size < 20_000 else Window(2, 1)
    stream = messages.Stream(topic, type, (message,) * window.batch)
    with serving("--set", "max_message_size=67108864", "--set", "limits.data_bytes=268435456") as server:
        return _cost(load.fan_out(server, stream, 1, window, seconds))


# -- encodings -------------------------------------------------------------------------------------------


def _encodings(per_encoding: int, count: int, seconds: float) -> float:
    wanted = ENCODINGS[:count]
    with serving("--set", "deflate=shared") as server:
        result = load.fan_out(
            server, messages.scans(), per_encoding * count, Window(16, 2, nap=0.002), seconds, wanted
        )
        return _cost(result) * per_encoding * count


# -- rules -----------------------------------------------------------------------------------------------


def _role(count: int) -> tuple[str, ...]:
    """Settings that give clients a role of so many rules for each act; with none they may do everything."""
    if not count:
        return ()
    globs = ",".join([f"/robot_{number}/*" for number in range(count - 1)] + ["/*"])
    settings = [f"roles.worker.{act}={globs}" for act in ("publish", "subscribe", "call", "provide")]
    return tuple(
        itertools.chain.from_iterable(("--set", each) for each in (*settings, "auth.default_role=worker"))
    )


def _publish_by_role(count: int, seconds: float) -> float:
    with serving(*_role(count)) as server:
        return _cost(load.fan_out(server, messages.twists(), 1, Window(64, 8), seconds))


def _first_sight(count: int, seconds: float) -> float:
    """Subscribing to a name that no decision is remembered for, and unsubscribing again."""
    with serving(*_role(count)) as server, closing(Loop()) as loop:
        client = Connection(loop, server.host, server.port)
        with closing(client):
            answers = client.keep_messages()
            names = itertools.count()
            begin, done = server.cpu_time().used, 0
            until = time.monotonic() + seconds
            while time.monotonic() < until:
                answers.clear()
                client.send(b"".join(_ask_once(f"/robot_{n % 1000}/topic_{n}") for n in _some(names, 100)))
                client.send(
                    masked(json.dumps({"op": "call_service", "service": "/rosapi/get_time"}).encode())
                )
                if not loop.until(lambda: bool(answers), READY_SECONDS):
                    raise WrongAnswer("no answer came")
                done += 100
            return (server.cpu_time().used - begin) / done * MICRO


def _some(names: Iterator[int], count: int) -> Iterator[int]:
    return itertools.islice(names, count)


def _ask_once(topic: str) -> bytes:
    stream = messages.Stream(topic, "geometry_msgs/Twist", ())
    return masked(stream.subscribe()) + masked(json.dumps({"op": "unsubscribe", "topic": topic}).encode())


# -- peers over Zenoh ------------------------------------------------------------------------------------


def _zenoh(count: int, seconds: float) -> float:
    endpoint = free_endpoint()
    command = [sys.executable, "-m", "bench.growth", "--zenoh-peer", endpoint]
    peers: list[subprocess.Popen[bytes]] = []
    try:
        return anyio.run(_publish_to_peers, endpoint, count, seconds, partial(_start, command, peers))
    finally:
        for peer in peers:
            peer.kill()
            peer.wait()


def _start(command: list[str], peers: list[subprocess.Popen[bytes]]) -> None:
    peers.append(subprocess.Popen(command))


async def _publish_to_peers(endpoint: str, count: int, seconds: float, start: Callable[[], None]) -> float:
    async with ZenohGraph(listen=[endpoint]) as graph:
        payload = small(graph)
        publisher = graph.participant("/sender").advertise("/small", payload.type)
        for _ in range(count):
            start()
        await until(lambda: publisher.subscriber_count >= count, seconds=READY_SECONDS + 5 * count)
        begin, sent = time.process_time(), 0
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for _ in range(16):
                publisher.publish(payload)
            sent += 16
            await anyio.sleep(0.002)
        return (time.process_time() - begin) / sent * MICRO


async def _peer(endpoint: str) -> None:
    async with ZenohGraph(connect=[endpoint]) as graph:
        node = graph.participant(f"/receiver_{random.randrange(1 << 30)}")
        node.subscribe("/small", lambda _: None, graph.registry.message("std_msgs/String"), DEFAULT_QOS)
        await anyio.sleep_forever()


# -- all of them -----------------------------------------------------------------------------------------

CURVES: Final = (
    Curve(
        "clients",
        "A small message to more clients",
        "clients",
        (1, 10, 100, 1000),
        (2,),
        {
            "8 messages on their way": partial(_clients, Window(8, 8, nap=0.002)),
            "1 message on its way": partial(_clients, Window(1, 1, nap=0.002)),
        },
    ),
    Curve(
        "topics",
        "A small message among more topics, and one topic more",
        "topics",
        (10, 100, 1000, 10_000),
        (3,),
        {"message": _message_of_many, "advertise and subscribe": _new_topic},
        grows=False,
    ),
    Curve(
        "size",
        "A larger message",
        "bytes",
        (100, 1000, 10_000, 100_000, 1_000_000, 16_000_000),
        (100,),
        {"String": _text, "Image": _image},
    ),
    Curve(
        "encodings",
        "A laser scan to clients in more encodings",
        "encodings: JSON with deflate, PNG, CBOR, JSON, cbor-raw",
        (1, 2, 3, 4, 5),
        (5,),
        {"one client each": partial(_encodings, 1), "10 clients each": partial(_encodings, 10)},
    ),
    Curve(
        "rules",
        "A client whose role has more rules",
        "rules for each act",
        (0, 1, 10, 100),
        (3,),
        {"publish": _publish_by_role, "subscribe and unsubscribe a new name": _first_sight},
        grows=False,
    ),
    Curve(
        "zenoh",
        "A small message to more processes over Zenoh",
        "peers",
        (1, 2, 4),
        (1,),
        {"message": _zenoh},
    ),
)


def measure(curve: Curve, points: Sequence[int], rounds: int, seconds: float) -> Found:
    """Every point of one curve, round by round, so that what disturbs the machine disturbs all of them."""
    found = Found(curve, tuple(points))
    for series, point in curve.series.items():
        taken: list[list[float]] = [[] for _ in points]
        for _ in range(rounds):
            for costs, count in zip(taken, points, strict=True):
                if sys.stderr.isatty():
                    print(f"\r\033[K{curve.name}: {series}, {count}", end="", file=sys.stderr, flush=True)
                costs.append(point(count, seconds))
        found.costs[series] = [median(costs) for costs in taken]
    return found


def table(found: Found) -> str:
    """The measurements of a curve as a table in Markdown."""
    heads = " | ".join(f"{point:,}" for point in found.points)
    lines = [f"| {found.curve.x} | {heads} |", "|---|" + "---:|" * len(found.points)]
    for series, costs in found.costs.items():
        lines.append(f"| {series}, µs | " + " | ".join(map(_figure, costs)) + " |")
    return "\n".join(lines)


def _figure(cost: float) -> str:
    return f"{cost:,.0f}" if cost >= 100 else f"{cost:.3g}"


def draw(found: Found, file: Path) -> None:
    """The curve with a line beside it that grows in proportion."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update({"svg.hashsalt": found.curve.name, "svg.fonttype": "none"})
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 3.6), layout="constrained")
    for series, costs in found.costs.items():
        axes.plot(found.points, costs, marker="o", label=series)
    positive = [point for point in found.points if point > 0]
    ratio = positive[-1] / positive[0]
    if found.curve.grows:
        first = max(costs[found.points.index(positive[0])] for costs in found.costs.values())
        axes.plot(
            [positive[0], positive[-1]], [first, first * ratio], "--", color="grey", label="in proportion"
        )
    wide = ratio > 10
    if wide and found.points[0] == 0:
        axes.set_xscale("symlog", linthresh=1)
    elif wide:
        axes.set_xscale("log")
    if wide and found.curve.grows:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, None)
    axes.set(xlabel=found.curve.x, ylabel="µs of CPU", title=found.curve.title)
    axes.legend(fontsize="small")
    figure.savefig(file, metadata={"Date": None})
    pyplot.close(figure)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench --growth", description=__doc__)
    parser.add_argument("--only", metavar="NAME", help=f"one of {', '.join(curve.name for curve in CURVES)}")
    parser.add_argument("--rounds", type=int, default=3, help="of each point (default 3)")
    parser.add_argument("--seconds", type=float, default=0.5, help="for each point (default 0.5)")
    parser.add_argument("--tiny", action="store_true", help="one small point each: to see that it works")
    parser.add_argument("--plots", metavar="FOLDER", type=Path, help="draw each curve into growth-NAME.svg")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to FILE")
    parser.add_argument("--check", action="store_true", help="exit with 1 if a curve is steeper than linear")
    parser.add_argument("--zenoh-peer", metavar="ENDPOINT", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.zenoh_peer:
        anyio.run(_peer, options.zenoh_peer)
        return 0
    steep: list[str] = []
    figures: dict[str, object] = {}
    for curve in CURVES:
        if options.only not in (None, curve.name):
            continue
        found = measure(curve, curve.tiny if options.tiny else curve.points, options.rounds, options.seconds)
        print(f"## {curve.title}\n\n{table(found)}\n", flush=True)
        steep += [
            f"{curve.name}, {series}: exponent {found.steepest(series):.2f}"
            for series in found.costs
            if found.steepest(series) > STEEPEST
        ]
        figures[curve.name] = {"points": found.points, "costs": found.costs}
        if options.plots:
            options.plots.mkdir(parents=True, exist_ok=True)
            draw(found, options.plots / f"growth-{curve.name}.svg")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    for each in steep:
        print(f"<<< steeper than linear: {each}")
    return int(options.check and bool(steep))


if __name__ == "__main__":
    sys.exit(main())
