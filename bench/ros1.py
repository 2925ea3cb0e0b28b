"""CPU per delivered message of a ROS 1 topic: `rwt serve` beside subscribers in rospy.

    python -m bench.ros1                 # Twist at 500 Hz and Image 640x480 at 30 Hz
    python -m bench.ros1 twist --hertz 1000
    python -m bench.ros1 --against ../other/src
    python -m bench.ros1 --rosbridge ../rosbridge_suite     # a checkout of its branch `ros1`

Needs ROS 1 (`make test-ros1` installs it). One publisher in rospy sends all the time. The subscribers take
turns, alone, and all run on the Python for which Debian packages ROS 1. A figure is the CPU time (user and
system, all threads) of the subscriber's process for each message that it delivers. The work that is compared:

| subscriber | receive | deserialise | encode | send |
|---|---|---|---|---|
| rospy | yes | yes | | |
| rospy with JSON | yes | yes | `json.dumps` | |
| bare relay | yes | | | to a TCP socket, unchanged |
| rwt, JSON and cbor-raw | yes | checks (JSON only) | yes | to a WebSocket client |
| rosbridge_suite, JSON | yes | yes | yes | to a WebSocket client |

The bare relay (`bench/peers/ros1_relay.py`) is the minimum for a server on asyncio.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
import sysconfig
import tempfile
import xmlrpc.client
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Final

import websockets

from bench.traffic.processes import Server, cpu_time
from tests.extensions.ros1.live.conftest import Ros
from tests.processes import free_port

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.statements import Program

PYTHON: Final = "/usr/bin/python3"
ROOT: Final = Path(__file__).parents[1]
SETTLE_SECONDS: Final = 0.7
"""From the subscription to the measurement, which includes the connection to the publisher."""

ROSBRIDGE: Final = "rosbridge_suite"
YARDSTICKS: Final = ("rospy", "rospy with JSON", "bare relay", ROSBRIDGE)


@dataclass(frozen=True, slots=True)
class Kind:
    """Message type with a typical content.

    Attributes:
        fill: statements that set the fields of `message`.
        limit: maximum CPU time of `rwt`, relative to a subscriber in rospy.
        rosbridge_limit: the same, relative to rosbridge_suite.
    """

    package: str
    name: str
    hertz: int
    fill: str
    limit: float
    rosbridge_limit: float


KINDS: Final = {
    "twist": Kind("geometry_msgs", "Twist", 500, "message.linear.x = 0.25", 1.3, 1 / 3),
    "image": Kind(
        "sensor_msgs",
        "Image",
        30,
        "message.data = bytes(range(256)) * 3600; message.height = 480; message.width = 640;"
        " message.step = 1920; message.encoding = 'rgb8'",
        0.35,
        1 / 20,
    ),
}

PUBLISH: Final = """
import threading
from {package}.msg import {name}
publisher = rospy.Publisher('/measured', {name}, queue_size=10, tcp_nodelay=True)
message = {name}()
{fill}
def publish():
    rate = rospy.Rate({hertz})
    while not rospy.is_shutdown():
        try:
            publisher.publish(message)
            rate.sleep()
        except rospy.ROSException:
            return
threading.Thread(target=publish, daemon=True).start()
"""

SUBSCRIBE: Final = """
import json
def nested(value):
    value = plain(value)
    return {{k: nested(v) for k, v in value.items()}} if isinstance(value, dict) else value
from {package}.msg import {name}
count = 0
def received(message):
    global count
    count += 1
    {do}
subscriber = rospy.Subscriber('/measured', {name}, received, tcp_nodelay=True)
"""


@dataclass(frozen=True, slots=True)
class Subscriber:
    """Subscriber that can be measured.

    Attributes:
        joined: subscribes until the end of the context, which yields the number of messages so far.
    """

    pid: int
    joined: Callable[[], AbstractAsyncContextManager[Callable[[], float]]]


@asynccontextmanager
async def in_rospy(program: Program, statements: str) -> AsyncIterator[Callable[[], float]]:
    """Subscribe in a program with rospy."""
    program.run(statements)
    try:
        yield lambda: program.run("result = count")
    finally:
        program.run("subscriber.unregister()")


@asynccontextmanager
async def over_websocket(server: Server, compression: str) -> AsyncIterator[Callable[[], float]]:
    """Subscribe with a rosbridge client."""
    count = 0

    async def receive(client: websockets.ClientConnection) -> None:
        nonlocal count
        with suppress(websockets.ConnectionClosed):
            async for _ in client:
                count += 1

    url = f"ws://{server.host}:{server.port}"
    async with websockets.connect(url, max_size=None, compression=None, ping_interval=None) as client:
        await client.send(f'{{"op": "subscribe", "topic": "/measured", "compression": "{compression}"}}')
        receiving = asyncio.create_task(receive(client))
        yield lambda: count
    await receiving


@asynccontextmanager
async def over_tcp(server: Server) -> AsyncIterator[Callable[[], float]]:
    """Read what the bare relay sends."""
    read = 0

    async def receive(reader: asyncio.StreamReader) -> None:
        nonlocal read
        while data := await reader.read(1 << 20):
            read += len(data)

    reader, writer = await asyncio.open_connection(server.host, server.port)
    frame_bytes = 4 + int.from_bytes(await reader.readexactly(4), "little")
    receiving = asyncio.create_task(receive(reader))
    try:
        yield lambda: read / frame_bytes
    finally:
        writer.close()
        await receiving


def _called(uri: str, method: str, *arguments: object) -> Any:
    """Return the value that a ROS 1 program answers to a call."""
    with xmlrpc.client.ServerProxy(uri) as proxy:
        answer: Any = getattr(proxy, method)(*arguments)
        return answer[2]


def relay_arguments(ros: Ros) -> list[str]:
    """Return the arguments of the bare relay, to which the publisher tells its port."""
    uri = _called(f"http://127.0.0.1:{ros.port}", "lookupNode", "/bench", "/robot/publisher")
    _, host, port = _called(uri, "requestTopic", "/relay", "/measured", [["TCPROS"]])
    return [str(ROOT / "bench/peers/ros1_relay.py"), host, str(port), "/measured"]


@contextmanager
def subscribers(
    kind: Kind, hertz: int, sources: Mapping[str, Path], rosbridge: Path | None
) -> Iterator[dict[str, Subscriber]]:
    """Start a publisher and all subscribers, `rwt` from each of the source folders."""
    texts = {"package": kind.package, "name": kind.name, "hertz": hertz, "fill": kind.fill}
    with tempfile.TemporaryDirectory() as folder:
        ros = Ros(Path(folder))
        servers: list[Server] = []

        def server(name: str, *arguments: str, source: Path | None = ROOT / "src") -> Server:
            folders = (source, sysconfig.get_paths()["purelib"], sysconfig.get_paths()["platlib"])
            path = {} if source is None else {"PYTHONPATH": os.pathsep.join(map(str, folders))}
            environment = {**os.environ, **ros.environment, **path}
            servers.append(Server(name, arguments, quiet=True, python=PYTHON, environment=environment))
            return servers[-1]

        try:
            ros.start_master()
            ros.program("publisher").run(PUBLISH.format(**texts))
            found: dict[str, Subscriber] = {}
            for name, node, do in (
                ("rospy", "plain", "pass"),
                ("rospy with JSON", "json", "json.dumps(nested(message))"),
            ):
                program = ros.program(node)
                statements = SUBSCRIBE.format(**texts, do=do)
                found[name] = Subscriber(program.process.pid, partial(in_rospy, program, statements))
            relay = server("bare relay", *relay_arguments(ros))
            found["bare relay"] = Subscriber(relay.pid, partial(over_tcp, relay))
            for name, source in sources.items():
                rwt = server(
                    name, "-m", "rwt.cli", "serve", "--graph", ros.uri, "ws://127.0.0.1:0", source=source
                )
                for encoding, compression in (("JSON", "none"), ("cbor-raw", "cbor-raw")):
                    found[f"{name}, {encoding}"] = Subscriber(
                        rwt.pid, partial(over_websocket, rwt, compression)
                    )
            if rosbridge is not None:
                script = str(ROOT / "bench/peers/ros1_rosbridge.py")
                peer = server(ROSBRIDGE, script, str(rosbridge), str(free_port()), source=None)
                found[ROSBRIDGE] = Subscriber(peer.pid, partial(over_websocket, peer, "none"))
            yield found
        finally:
            for each in servers:
                each.stop()
            ros.close()


async def measured(subscriber: Subscriber, seconds: float) -> float:
    """Return the microseconds of CPU time per message of one subscriber."""
    async with subscriber.joined() as count:
        await asyncio.sleep(SETTLE_SECONDS)
        used, counted = cpu_time(subscriber.pid).used, count()
        await asyncio.sleep(seconds)
        return (cpu_time(subscriber.pid).used - used) / max(1, count() - counted) * 1e6


async def measure(
    kind: Kind, hertz: int, rounds: int, seconds: float, sources: Mapping[str, Path], rosbridge: Path | None
) -> list[dict[str, float]]:
    """Return the microseconds of CPU time per message of each subscriber, for each round."""
    with subscribers(kind, hertz, sources, rosbridge) as each:
        await asyncio.sleep(1.5)  # Until the server knows the topic.
        return [
            {name: await measured(subscriber, seconds) for name, subscriber in each.items()}
            for _ in range(rounds)
        ]


def table(title: str, kind: Kind, rounds: list[dict[str, float]]) -> str:
    """Return the medians of the rounds, and of the ratios in each round, as a table in Markdown."""
    yardsticks = [name for name in YARDSTICKS if name in rounds[0]]
    heads = "".join(f" / {name} |" for name in yardsticks)
    lines = [f"| {title} | µs |{heads}", "|---|---:|" + "---:|" * len(yardsticks)]
    for name in rounds[0]:
        cells = [f"{median(each[name] for each in rounds):,.0f}"]
        for yardstick in yardsticks:
            ratios = sorted(each[name] / each[yardstick] for each in rounds)
            spread = "" if name == yardstick else f" ({ratios[0]:.2f} to {ratios[-1]:.2f})"
            cells.append(f"{median(ratios):.2f}{spread}")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    limits = f"Limits of rwt: {kind.limit:g} / rospy, {kind.rosbridge_limit:.2g} / {ROSBRIDGE}"
    return "\n".join([*lines, "", limits])


def main() -> None:
    """Measure message types and print a table of each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"default: all of {', '.join(KINDS)}")
    parser.add_argument("--hertz", type=int, help="publishing rate")
    parser.add_argument("--rounds", type=int, default=5, help="turns of each subscriber (default: 5)")
    parser.add_argument("--seconds", type=float, default=3.0, help="length of a turn (default: 3)")
    parser.add_argument("--against", type=Path, metavar="DIR", help="source folder of another version")
    parser.add_argument(
        "--rosbridge", type=Path, metavar="DIR", help="checkout of rosbridge_suite's branch ros1"
    )
    arguments = parser.parse_args()
    sources = {"rwt": ROOT / "src"}
    if arguments.against is not None:
        sources["other rwt"] = arguments.against.resolve()
    for each in arguments.kinds or KINDS:
        if each not in KINDS:
            parser.error(f"unknown kind {each!r}; known are {', '.join(KINDS)}")
        kind = KINDS[each]
        hertz = arguments.hertz or kind.hertz
        rounds = asyncio.run(
            measure(kind, hertz, arguments.rounds, arguments.seconds, sources, arguments.rosbridge)
        )
        print(table(f"{kind.name}, {hertz} Hz", kind, rounds), end="\n\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
