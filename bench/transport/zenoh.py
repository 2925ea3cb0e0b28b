"""`python -m bench.transport.zenoh`: the graph over Zenoh between two processes, and the graph in memory.

One process publishes, the other subscribes; both are whole graphs, connected over TCP on loopback. Small
messages are `std_msgs/String` of 32 characters, large ones `sensor_msgs/Image` of 1 MB. Payloads are made
once and sent again and again: it is the way of a message that is measured, not its encoding. Latency is half
of a round trip.
"""

from __future__ import annotations

import argparse
import json
import socket
import statistics
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import anyio
import anyio.lowlevel

from rwt.extensions.zenoh import ZenohGraph
from rwt_graph import MemoryGraph
from rwt_graph.api import Participant, Publisher, Sample
from rwt_interfaces.payload import Payload
from rwt_participant.qos import DEFAULT_QOS, History, QoS
from tests.waiting import until

SMALL, LARGE = "std_msgs/String", "sensor_msgs/Image"
#: Messages between two looks at the event loop.
BURST = 64
ROUND_TRIPS = 2000
#: Every message is to arrive, so a sender waits for its receiver.
EVERY = QoS(history=History.KEEP_ALL)


@dataclass(frozen=True, slots=True)
class Figures:
    """Measurements; rates are those of the subscriber."""

    small_per_second: float
    small_lost: int
    large_gb_per_second: float
    large_lost: int
    latency_p50_us: float
    latency_p99_us: float


class Counter:
    """A subscriber that counts until it hears the last message."""

    def __init__(self) -> None:
        self.received = 0
        self.first = self.last = 0.0
        self.done = anyio.Event()

    def take(self, _sample: Sample) -> None:
        """One message came."""
        self.received += 1
        if self.received == 1:
            self.first = time.perf_counter()

    def end(self, _sample: Sample) -> None:
        """The sender has sent all."""
        self.last = time.perf_counter()
        self.done.set()

    @property
    def rate(self) -> float:
        """Messages a second between the first and the end."""
        return self.received / max(1e-9, self.last - self.first)


def payload_of(graph: MemoryGraph, name: str, value: object) -> Payload:
    payload = Payload.from_value(graph.registry.message(name), value)
    payload.cdr()
    return payload


def small(graph: MemoryGraph) -> Payload:
    return payload_of(graph, SMALL, {"data": "x" * 32})


def large(graph: MemoryGraph) -> Payload:
    return payload_of(graph, LARGE, {"height": 500, "width": 2000, "step": 2000, "data": bytes(1_000_000)})


async def ready(publisher: Publisher) -> None:
    await until(lambda: publisher.subscriber_count, "no subscriber has connected")


async def flood(graph: MemoryGraph, node: Participant, kind: str, seconds: float) -> int:
    """Publish as fast as it goes, then say how many were sent."""
    payload, burst = (small(graph), BURST) if kind == "small" else (large(graph), 4)
    publisher = node.advertise(f"/{kind}", payload.type, EVERY)
    end = node.advertise(f"/{kind}/end", graph.registry.message(SMALL), EVERY)
    await ready(publisher)
    await ready(end)
    sent, until = 0, time.perf_counter() + seconds
    while time.perf_counter() < until:
        for _ in range(burst):
            publisher.publish(payload)
        sent += burst
        await anyio.lowlevel.checkpoint()
    # Each topic has a way of its own: the end must not overtake what it ends.
    await anyio.sleep(0.3)
    end.publish(payload_of(graph, SMALL, {"data": str(sent)}))
    return sent


async def count(graph: MemoryGraph, node: Participant, kind: str) -> tuple[Counter, int]:
    """Receive a flood; the counter and how many were sent."""
    counter, said = Counter(), []
    type = graph.registry.message(SMALL if kind == "small" else LARGE)

    def take(sample: Sample) -> None:
        counter.take(sample)
        counter.last = time.perf_counter()

    def end(sample: Sample) -> None:
        said.append(json.loads(bytes(sample.payload.json()))["data"])
        counter.done.set()

    subscriptions = [
        node.subscribe(f"/{kind}", take, type, DEFAULT_QOS),
        node.subscribe(f"/{kind}/end", end, graph.registry.message(SMALL), DEFAULT_QOS),
    ]
    await counter.done.wait()
    for subscription in subscriptions:
        subscription.close()
    return counter, int(said[0])


async def echo(graph: MemoryGraph, node: Participant) -> None:
    """Send back what comes, until cancelled."""
    pong = node.advertise("/pong", graph.registry.message(SMALL))
    node.subscribe(
        "/ping", lambda sample: pong.publish(sample.payload), graph.registry.message(SMALL), DEFAULT_QOS
    )
    await anyio.sleep_forever()


async def round_trips(graph: MemoryGraph, node: Participant) -> list[float]:
    """Half round trips in microseconds, sorted."""
    arrived = [anyio.Event()]
    node.subscribe("/pong", lambda _: arrived[0].set(), graph.registry.message(SMALL), DEFAULT_QOS)
    ping, payload = node.advertise("/ping", graph.registry.message(SMALL)), small(graph)
    await ready(ping)
    await anyio.sleep(0.2)
    taken = []
    for _ in range(ROUND_TRIPS):
        arrived[0] = anyio.Event()
        begun = time.perf_counter()
        ping.publish(payload)
        await arrived[0].wait()
        taken.append((time.perf_counter() - begun) / 2 * 1e6)
    return sorted(taken)


async def measure(graph: MemoryGraph) -> Figures:
    """The receiving half."""
    node = graph.participant("/receiver")
    latencies = await round_trips(graph, node)
    smalls, small_sent = await count(graph, node, "small")
    larges, large_sent = await count(graph, node, "large")
    return Figures(
        smalls.rate,
        small_sent - smalls.received,
        larges.rate * 1e6 / 1e9,
        large_sent - larges.received,
        statistics.median(latencies),
        latencies[len(latencies) * 99 // 100],
    )


async def send(graph: MemoryGraph, seconds: float) -> None:
    """The sending half."""
    node = graph.participant("/sender")
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(echo, graph, node)
        for kind in ("small", "large"):
            await flood(graph, node, kind, seconds)
        await anyio.sleep(0.5)
        tasks.cancel_scope.cancel()


async def in_memory(seconds: float) -> Figures:
    """Both halves in one graph in memory."""
    async with MemoryGraph() as graph, anyio.create_task_group() as tasks:
        tasks.start_soon(send, graph, seconds)
        figures = await measure(graph)
        tasks.cancel_scope.cancel()
    return figures


async def receiver(endpoint: str) -> Figures:
    async with ZenohGraph(listen=[endpoint]) as graph:
        return await measure(graph)


async def sender(endpoint: str, seconds: float) -> None:
    async with ZenohGraph(connect=[endpoint]) as graph:
        await send(graph, seconds)


def free_endpoint() -> str:
    """Where a process may listen."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def over_zenoh(seconds: float) -> Figures:
    """Each half in a process of its own."""
    endpoint = free_endpoint()
    command = [
        sys.executable,
        "-m",
        "bench.transport.zenoh",
        "--send-to",
        endpoint,
        "--seconds",
        str(seconds),
    ]
    child = subprocess.Popen(command)
    try:
        return anyio.run(receiver, endpoint)
    finally:
        child.wait(timeout=30)


def table(memory: Figures, zenoh: Figures) -> str:
    lines = [f"{'':28}{'memory':>14}{'over Zenoh':>14}"]
    lines += [
        f"{name:28}{getattr(memory, name):>14,.2f}{getattr(zenoh, name):>14,.2f}" for name in asdict(memory)
    ]
    lines.append(f"{'added_latency_p50_us':28}{'':14}{zenoh.latency_p50_us - memory.latency_p50_us:>14,.2f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.transport.zenoh", description=__doc__)
    parser.add_argument("--seconds", type=float, default=3.0, help="per flood (default 3)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE")
    parser.add_argument("--send-to", metavar="ENDPOINT", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.send_to:
        anyio.run(sender, options.send_to, options.seconds)
        return
    zenoh = over_zenoh(options.seconds)
    memory = anyio.run(partial(in_memory, options.seconds))
    print(table(memory, zenoh))
    if options.json:
        figures = {"memory": asdict(memory), "zenoh": asdict(zenoh)}
        options.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
