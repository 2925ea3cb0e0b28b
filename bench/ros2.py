"""CPU per delivered message of ROS 2 topics: `rwt serve --graph ros2` and other servers, in one run.

    make bench-ros2 SUITE=FOLDER ARGS='--other COMMAND'

FOLDER is a workspace of rosbridge_suite, with `lib/rosbridge_server/rosbridge_websocket`, built for this
Python. COMMAND starts another rosbridge server on the port that is added to it, such as rosbridge-server-rs.
All servers subscribe to the same publisher and send JSON to as many clients; so does the floor, a bare loop
that takes samples and sends a prepared frame. Only the CPU time of the server processes counts (user and
system), so that other load of the machine matters little.

After that, the latency from the stamp of a message to its arrival is measured at one client of this server,
and at a bare subscription of rclpy at the same time: p50 and p99, each the median of five parts of the run.
It counts all processes on the way, and on a busy machine mostly their waits for a CPU.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AsyncExitStack, ExitStack, closing, contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

import websockets

from bench.traffic.processes import Server, cpu_time
from tests.extensions.ros2.live.domains import free_domain
from tests.processes import free_port, running
from tests.statements import Program
from tools.upstream.ros2_workspace import ROSBRIDGE, environment


class Case(NamedTuple):
    """Traffic of one row: a topic, or calls of a service.

    Attributes:
        limit: largest accepted quotient of the CPU time of this server and that of rosbridge_suite.
    """

    title: str
    type: str
    fill: str
    hertz: int
    clients: int
    limit: float

    @property
    def is_service(self) -> bool:
        """True if clients call a service instead of subscribing; the floor has none."""
        return "/srv/" in self.type


CASES: Final = {
    "twist": Case("Twist", "geometry_msgs/msg/Twist", "message.linear.x = 0.25", 100, 1, 1 / 3),
    "scan": Case(
        "LaserScan, 720 ranges",
        "sensor_msgs/msg/LaserScan",
        "message.ranges = [1.25 + i / 100 for i in range(720)]; message.intensities = message.ranges",
        20,
        1,
        1 / 4,
    ),
    "cloud": Case(
        "PointCloud2, 320 kB",
        "sensor_msgs/msg/PointCloud2",
        "message.data = bytes(range(256)) * 1250; message.point_step = 16; message.width = 20000",
        5,
        1,
        1 / 8,
    ),
    "image": Case(
        "Image, 640 x 480 rgb8",
        "sensor_msgs/msg/Image",
        "message.data = bytes(range(256)) * 3600; message.height = 480; message.width = 640",
        3,
        1,
        1 / 15,
    ),
    "small": Case(
        "Image, 320 x 240 rgb8",
        "sensor_msgs/msg/Image",
        "message.data = bytes(range(256)) * 900; message.height = 240; message.width = 320",
        10,
        1,
        1 / 15,
    ),
    "images": Case(
        "Image, 320 x 240 rgb8, ten clients",
        "sensor_msgs/msg/Image",
        "message.data = bytes(range(256)) * 900; message.height = 240; message.width = 320",
        3,
        10,
        1 / 15,
    ),
    "calls": Case("calls of a service", "std_srvs/srv/Trigger", "", 100, 1, 1 / 3),
    "fan": Case("Twist, ten clients", "geometry_msgs/msg/Twist", "message.linear.x = 0.25", 50, 10, 1 / 10),
}

_PUBLISH: Final = """
import time
from {package}.msg import {name}
message = {name}()
{fill}
publisher = node.create_publisher({name}, '/measured', 10)

def publish():
    now = time.monotonic_ns()
    if hasattr(message, 'header'):
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
    else:
        message.linear.x = float(now)
    publisher.publish(message)

timer = node.create_timer(1 / {hertz}, publish)
"""

_SERVE: Final = """
from std_srvs.srv import Trigger
service = node.create_service(Trigger, '/measured', lambda request, response: response)
"""

_COLUMNS: Final = ("rwt", "floor", "other", "suite")

HEAD: Final = (
    "| messages | Hz | rwt, µs | floor, µs | other, µs | rosbridge_suite, µs | quotient | limit"
    " | rwt p50, ms | p99 | rclpy p50, ms | p99 |\n"
    "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n"
)

#: Parts of a run of which the median counts.
_PARTS: Final = 5

#: Seconds before the measurement, in which both servers discover the publisher.
_SETTLE_SECONDS: Final = 3.0


@contextmanager
def rosbridge_suite(workspace: Path) -> Iterator[tuple[int, str]]:
    """rosbridge_websocket of a workspace: its process, and its address."""
    port = free_port()
    parameters = ("--ros-args", "-p", f"port:={port}", "-p", "address:=127.0.0.1")
    with _process([sys.executable, str(workspace / ROSBRIDGE), *parameters], environment(workspace)) as pid:
        yield pid, f"ws://127.0.0.1:{port}"


@contextmanager
def other_server(command: str) -> Iterator[tuple[int, str]]:
    """A server that a command with a port starts: its process, and its address."""
    port = free_port()
    with _process([*shlex.split(command), str(port)], dict(os.environ)) as pid:
        yield pid, f"ws://127.0.0.1:{port}"


@contextmanager
def _process(command: list[str], environment: dict[str, str]) -> Iterator[int]:
    process = subprocess.Popen(command, env=environment)
    try:
        yield process.pid
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def _floor(case: Case) -> Iterator[tuple[int, str]]:
    server = Server("floor", ["-m", "bench.peers.ros2_floor", "/measured", case.type])
    try:
        yield server.pid, f"ws://{server.host}:{server.port}"
    finally:
        server.stop()


async def _connect(url: str) -> websockets.ClientConnection:
    for _ in range(300):
        try:
            return await websockets.connect(url, max_size=None, compression=None)
        except OSError:
            await asyncio.sleep(0.1)
    raise TimeoutError(f"{url} does not accept connections")


class _Client:
    """Client that counts what it receives of a topic, or the answers to its calls, one after the other."""

    def __init__(self, connection: websockets.ClientConnection, case: Case) -> None:
        self.count = 0
        self._connection = connection
        self._reading = asyncio.ensure_future(self._call(case) if case.is_service else self._read(case))

    async def _read(self, case: Case) -> None:
        await self._connection.send(json.dumps({"op": "subscribe", "topic": "/measured", "type": case.type}))
        async for _ in self._connection:
            self.count += 1

    async def _call(self, case: Case) -> None:
        request = json.dumps({"op": "call_service", "service": "/measured", "type": case.type})
        while True:
            await self._connection.send(request)
            with suppress(TimeoutError):  # A server may not answer while it does not see the service.
                async with asyncio.timeout(1):
                    self.count += json.loads(await self._connection.recv())["result"]
            await asyncio.sleep(1 / case.hertz)

    async def close(self) -> None:
        self._reading.cancel()
        await self._connection.close()


async def measure(case: Case, servers: dict[str, tuple[int, str]], seconds: float) -> dict[str, float]:
    """Return the microseconds of CPU time per delivered message of each server that delivers."""
    package, _, name = case.type.split("/")
    with closing(
        Program(sys.executable, "tests.extensions.ros2.live.program", environment=dict(os.environ))
    ) as program:
        publish = _PUBLISH.format(package=package, name=name, fill=case.fill, hertz=case.hertz)
        program.run(_SERVE if case.is_service else publish)
        async with AsyncExitStack() as stack:
            clients: dict[str, list[_Client]] = {}
            for server, (_, url) in servers.items():
                clients[server] = []
                for _ in range(case.clients):
                    clients[server].append(_Client(await _connect(url), case))
                    stack.push_async_callback(clients[server][-1].close)
            await asyncio.sleep(_SETTLE_SECONDS)
            before = {
                server: (cpu_time(pid).used, sum(client.count for client in clients[server]))
                for server, (pid, _) in servers.items()
            }
            await asyncio.sleep(seconds)
            found = {}
            for server, (pid, _) in servers.items():
                used = cpu_time(pid).used - before[server][0]
                received = sum(client.count for client in clients[server]) - before[server][1]
                if received:
                    found[server] = used / received * 1e6
                elif server == "rwt":
                    raise RuntimeError(f"no message of {case.title} has arrived")
    return found


def measure_latency(case: Case, url: str, seconds: float) -> list[tuple[float, float]]:
    """Return p50 and p99 of the latency in milliseconds, of this server and of a bare subscription."""
    package, _, name = case.type.split("/")
    with ExitStack() as stack:
        program = stack.enter_context(
            closing(
                Program(sys.executable, "tests.extensions.ros2.live.program", environment=dict(os.environ))
            )
        )
        program.run(_PUBLISH.format(package=package, name=name, fill=case.fill, hertz=case.hertz))
        readers = [
            stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-m", "bench.peers.latencies", source, case.type],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    text=True,
                )
            )
            for source in (url, "rclpy")
        ]
        time.sleep(_SETTLE_SECONDS)
        for reader in readers:
            assert reader.stdin is not None
            reader.stdin.write("begin\n")
            reader.stdin.flush()
        time.sleep(seconds)
        return [_quantiles(json.loads(reader.communicate()[0])) for reader in readers]


def _quantiles(latencies: list[int]) -> tuple[float, float]:
    """Return the medians of p50 and p99 of the parts of a run, in milliseconds."""
    size = len(latencies) // _PARTS
    if not size:
        raise RuntimeError("too few messages have arrived")
    parts = [sorted(latencies[i * size : (i + 1) * size]) for i in range(_PARTS)]
    return (
        median(part[size // 2] for part in parts) / 1e6,
        median(part[size * 99 // 100] for part in parts) / 1e6,
    )


async def run(cases: list[str], workspace: Path | None, other: str, seconds: float) -> str:
    """Return the figures of all cases as a table."""
    rows = []
    for each in cases:
        case = CASES[each]
        # New servers for every row: rosbridge_suite slows down with the topics that it has had.
        with ExitStack() as stack:
            environment = {"PYTHONPATH": os.environ.get("PYTHONPATH", "")}
            arguments = ("serve", "--graph", "ros2", "ws://127.0.0.1:0")
            process, url = stack.enter_context(
                running(*arguments, environment=environment, real=True, stderr=subprocess.DEVNULL)
            )
            servers = {"rwt": (process.pid, url)}
            if not case.is_service:
                servers["floor"] = stack.enter_context(_floor(case))
            if workspace is not None:
                servers["suite"] = stack.enter_context(rosbridge_suite(workspace))
            if other:
                servers["other"] = stack.enter_context(other_server(other))
            found = await measure(case, servers, seconds)
            delays = [] if case.is_service else measure_latency(case, url, seconds)
        row = [case.title, f"{case.hertz}"]
        row += [f"{found[server]:,.0f}" if server in found else "" for server in _COLUMNS]
        if "suite" in found:
            row += [f"1/{found['suite'] / found['rwt']:.1f}", f"1/{1 / case.limit:.0f}"]
        row += [""] * (len(_COLUMNS) + 4 - len(row))
        rows.append(row + ([f"{each:.1f}" for pair in delays for each in pair] or [""] * 4))
        print(" | ".join(rows[-1]), flush=True)
    return HEAD + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("suite", type=Path, nargs="?", help="workspace of rosbridge_suite")
    parser.add_argument("--other", default="", help="command that starts another server on a port")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of each measurement")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=[*CASES])
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_DOMAIN_ID", str(free_domain()))
    suite = arguments.suite.resolve() if arguments.suite else None
    print(asyncio.run(run(arguments.cases, suite, arguments.other, arguments.seconds)))


if __name__ == "__main__":
    main()
