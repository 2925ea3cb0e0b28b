"""`python -m bench.network.hub`: what viewers of a robot behind a hub cost its uplink, the robot and the hub.

A robot publishes odometry, a scan and transforms at 10 Hz, and a camera at 20 Hz. All viewers have all of
them; twenty have the camera at its full rate, the others once a second. Then all viewers want one message a
second of a topic at 100 Hz. Then a Twist at 20 Hz goes to all viewers, from the hub and from the robot.
Robot, hub and viewers are processes of their own. What counts is bytes and CPU time. With `--nodes N`, the
hub has so many, and the viewers are spread over them.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import selectors
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack
from itertools import cycle
from typing import Any, Final

import anyio
import anyio.to_thread

from bench.traffic.wire import masked
from rwt import Server
from rwt.extensions.hub.hub import open_hub
from rwt_transports import Limits
from tests.processes import free_port

FULL: Final = 20
"""Viewers of the camera's full rate."""
MOST: Final = 4000
WIDE: Final = Limits(connections=MOST, connections_per_address=MOST)
RATES: Final[Mapping[str, tuple[float, int]]] = {
    "/odom": (10, 700),
    "/scan": (10, 3000),
    "/tf": (10, 400),
    "/camera": (20, 20_000),
    "/fast": (100, 100),
    "/twist": (20, 120),
}
"""Rate in hertz and bytes of each topic."""


async def be_the_robot(url: str) -> None:
    """Publish, and print CPU time when asked."""
    limits = {"connections": MOST, "connections_per_address": MOST}
    server = Server("ws://127.0.0.1:0", dial={"urls": [url]}, limits=limits, nodes=())
    node = server.node("robot")
    async with server, anyio.create_task_group() as tasks:
        for topic, (hertz, size) in RATES.items():
            tasks.start_soon(_publish, node.advertise(topic, "std_msgs/String"), hertz, size)
        await _report(server.urls[0], lambda: 0)
        tasks.cancel_scope.cancel()


async def _publish(publisher: Any, hertz: float, size: int) -> None:
    due = anyio.current_time()
    while True:
        publisher.publish({"data": "x" * size})
        due += 1 / hertz
        await anyio.sleep_until(due)


async def be_the_hub(listen: str, connect: str) -> None:
    """Serve as a node, and print CPU time and the robot's bytes when asked.

    Args:
        listen: Zenoh endpoint for other nodes; empty for none.
        connect: that of another node; empty for none.
    """

    def received() -> int:
        carriers = [robot.carrier for robot in hub.robots if robot.carrier is not None]
        return sum(carrier.sink.received for carrier in carriers)

    async with open_hub("ws://127.0.0.1:0", limits=WIDE) as hub, AsyncExitStack() as stack:
        if listen or connect:
            from rwt.extensions.hub.nodes.directory import open_directory

            ends = tuple(filter(None, (listen,))), tuple(filter(None, (connect,)))
            cluster = open_directory(hub, hub.url, listen=ends[0], connect=ends[1], limits=WIDE)
            await stack.enter_async_context(cluster)
        await _report(hub.url, received)


async def _report(first: str, count: Any) -> None:
    said: object = first
    while True:
        sys.stdout.write(json.dumps(said) + "\n")
        sys.stdout.flush()
        if not await anyio.to_thread.run_sync(sys.stdin.readline, abandon_on_cancel=True):
            return
        said = [time.process_time(), count()]


class Part:
    """Process of the robot or the hub."""

    def __init__(self, *arguments: str) -> None:
        command = [sys.executable, "-m", "bench.network.hub", *arguments]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.url: str = self._line()
        self.pid = self._process.pid

    def _line(self) -> Any:
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())

    def ask(self) -> tuple[float, int]:
        """Return its CPU time in seconds, and the bytes that it has received from a robot."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        cpu, received = self._line()
        return cpu, received

    def stop(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(timeout=20)


class Viewers:
    """Clients that read everything, and count it."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._sockets: list[socket.socket] = []
        self._buffer = bytearray(1 << 20)
        self.bytes: list[int] = []

    def open(self, url: str, subscriptions: Sequence[Mapping[str, object]]) -> None:
        """Open a connection, and subscribe."""
        host, _, rest = url.removeprefix("ws://").partition(":")
        port, _, path = rest.partition("/")
        link = socket.create_connection((host, int(port)), timeout=20)
        key = base64.b64encode(os.urandom(16)).decode()
        link.sendall(
            f"GET /{path} HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n".encode()
        )
        answer = link.recv(4096)
        assert b" 101 " in answer, answer
        for subscription in subscriptions:
            link.sendall(masked(json.dumps({"op": "subscribe", **subscription}).encode()))
        link.setblocking(False)
        self._selector.register(link, selectors.EVENT_READ, len(self._sockets))
        self._sockets.append(link)
        self.bytes.append(0)
        self.read(0.0)

    def read(self, seconds: float) -> None:
        """Read for so long."""
        until = time.monotonic() + seconds
        while True:
            for key, _ in self._selector.select(max(0.0, min(0.1, until - time.monotonic()))):
                assert isinstance(key.fileobj, socket.socket)
                count = key.fileobj.recv_into(self._buffer)
                if not count:
                    raise ConnectionError(f"viewer {key.data} was cut off")
                self.bytes[key.data] += count
            if time.monotonic() >= until:
                return

    def close(self) -> None:
        for link in self._sockets:
            link.close()
        self._selector.close()


def watched(
    parts: Sequence[Part],
    urls: Sequence[str],
    asked: Sequence[Sequence[Mapping[str, object]]],
    seconds: float,
) -> tuple[list[tuple[float, int]], list[int]]:
    """Return CPU seconds and received bytes per second of each process, and the bytes of each viewer.

    Args:
        urls: where the viewers connect in turn.
        asked: subscriptions of each viewer.
    """
    viewers = Viewers()
    try:
        for subscriptions, url in zip(asked, cycle(urls)):
            viewers.open(url, subscriptions)
        viewers.read(2.0)
        before, bytes_before, began = [part.ask() for part in parts], list(viewers.bytes), time.monotonic()
        viewers.read(seconds)
        after, lasted = [part.ask() for part in parts], time.monotonic() - began
        used = [
            ((cpu - old_cpu) / lasted, round((received - old) / lasted))
            for (cpu, received), (old_cpu, old) in zip(after, before, strict=True)
        ]
        return used, [round((n - old) / lasted) for n, old in zip(viewers.bytes, bytes_before, strict=True)]
    finally:
        viewers.close()


def of_viewer(number: int) -> list[dict[str, object]]:
    """Return the subscriptions of a viewer."""
    kind = "std_msgs/String"
    plain: list[dict[str, object]] = [{"topic": topic, "type": kind} for topic in ("/odom", "/scan", "/tf")]
    throttle = 0 if number < FULL else 1000
    return [*plain, {"topic": "/camera", "type": kind, "throttle_rate": throttle}]


def size_of(topic: str) -> int:
    """Return the bytes of a sample on the wire of a viewer, without its WebSocket header."""
    return RATES[topic][1] + len(f'{{"op":"publish","topic":"{topic}","msg":{{"data":""}}}}')


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.network.hub", description=__doc__)
    parser.add_argument("--viewers", type=int, nargs="+", default=[1, 10, 100, 1000], metavar="N")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each row (default 10)")
    parser.add_argument("--nodes", type=int, default=1, metavar="N", help="nodes of the hub (default 1)")
    parser.add_argument("part", nargs="*", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.part:
        if options.part[0] == "hub":
            anyio.run(be_the_hub, *options.part[1:])
        else:
            anyio.run(be_the_robot, options.part[1])
        return 0
    with ExitStack() as stack:
        nodes = started(options.nodes, stack)
        robot = Part("robot", f"{nodes[0].url}/robots/rosie")
        stack.callback(robot.stop)
        time.sleep(2.0)
        _measure(nodes, robot, options.viewers, options.seconds)
    return 0


def started(count: int, stack: ExitStack) -> list[Part]:
    """Return the nodes of a hub, which are stopped with the stack."""
    endpoint = f"tcp/127.0.0.1:{free_port()}" if count > 1 else ""
    nodes: list[Part] = []
    for _ in range(count):
        node = Part("hub", "" if nodes else endpoint, endpoint if nodes else "")
        stack.callback(node.stop)
        nodes.append(node)
    return nodes


def _measure(nodes: Sequence[Part], robot: Part, counts: Sequence[int], seconds: float) -> None:
    home, parts = nodes[0], (robot, *nodes)
    urls = [f"{node.url}/rosie" for node in nodes]
    print("| viewers | uplink kB/s | robot CPU ms/s | hub CPU ms/s |\n|---:|---:|---:|---:|")
    for count in counts:
        (of_robot, *of_nodes), _ = watched(parts, urls, [of_viewer(n) for n in range(count)], seconds)
        used = ", ".join(f"{seconds * 1e3:.0f}" for seconds, _ in of_nodes)
        print(f"| {count} | {of_nodes[0][1] / 1e3:.1f} | {of_robot[0] * 1e3:.0f} | {used} |")
    most = max(counts)
    slow = [{"topic": "/fast", "type": "std_msgs/String", "throttle_rate": 1000}]
    (_, of_home, *_), got = watched(parts, urls, [slow] * most, seconds)
    sizes = [each / size_of("/fast") for each in got]
    rate = of_home[1] / size_of("/fast")
    print(f"\n{most} viewers at 1 Hz of 100 Hz: {rate:.2f} messages/s on the uplink, ", end="")
    print(f"{min(sizes):.2f} to {max(sizes):.2f} Hz each")
    twist = [{"topic": "/twist", "type": "std_msgs/String"}]
    costs = []
    for part, at in ((home, urls[0]), (robot, robot.url)):
        ((cpu, _),), got = watched((part,), (at,), [twist] * most, seconds)
        costs.append(cpu / (sum(got) / size_of("/twist")) * 1e6)
    print(
        f"Twist to {most}: {costs[0]:.2f} µs of CPU per delivery at the hub, {costs[1]:.2f} directly: ",
        end="",
    )
    print(f"{costs[0] / costs[1]:.2f}")


if __name__ == "__main__":
    sys.exit(main())
