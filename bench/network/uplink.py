"""`python -m bench.network.uplink`: a robot that reaches its hub over a slow link, full of images or files.

One client of the hub watches a camera and a laser scanner of the robot, another one drives it: it sends
commands, and presses the emergency stop. Times are between two processes of this machine, without clocks to
compare: the age of a scan or an image when the viewer has it, the age of a command when the robot has it, the
round trip of the stop. Needs Linux, root and `/dev/net/tun`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any, Final

import anyio

from bench.network.lossy_link import ADDRESSES, Line, lossy_link
from rwt import Server, connect
from rwt_participant.qos import QoS

PORT: Final = 9090
TOKEN: Final = "0123456789abcdef"
IMAGE_BYTES: Final = 50_000
FILE_BYTES: Final = 300_000
SCAN_HZ, IMAGE_HZ, COMMAND_HZ = 10, 4, 20
STOP_SECONDS: Final = 0.5
LINK: Final = Line(bits=1e6, delay=0.04, queue=1.0)
"""1 Mbit/s and 80 ms there and back, with a router that queues a second."""


async def be_the_robot(url: str) -> None:
    """Publish scans and images, and note the ages of commands."""
    gate = {"rules": {"drive": {"topics": ["/cmd_vel"], "stop": {}, "emergency": True}}}
    server = Server(dial={"urls": [url], "token": TOKEN}, gate=gate)
    node = server.node("robot")
    ages: list[float] = []

    def probe(request: Any) -> dict[str, int]:
        ages.append(time.monotonic() - request.a / 1e9)
        return {"sum": request.a}

    node.advertise_service("/probe", "example_interfaces/AddTwoInts", probe)
    scans = node.advertise("/scan", "std_msgs/String")
    images = node.advertise("/camera", "std_msgs/String")
    async with server, anyio.create_task_group() as tasks:
        tasks.start_soon(_publish, scans, SCAN_HZ, 2_000)
        tasks.start_soon(_publish, images, IMAGE_HZ, IMAGE_BYTES)
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        await anyio.to_thread.run_sync(sys.stdin.readline, abandon_on_cancel=True)
        sys.stdout.write(json.dumps(ages) + "\n")
        sys.stdout.flush()
        tasks.cancel_scope.cancel()


async def _publish(publisher: Any, hertz: float, size: int) -> None:
    while True:
        publisher.publish({"data": f"{time.monotonic():.6f} ".ljust(size, "x")})
        await anyio.sleep(1 / hertz)


async def watch(url: str, seconds: float) -> dict[str, list[float]]:
    """Return the ages of scans and images."""
    ages: dict[str, list[float]] = {"/scan": [], "/camera": []}
    async with connect(url) as robot:
        for topic in ages:
            # One message may wait: a viewer wants the newest.
            note = partial(_note, ages[topic])
            robot.subscribe(topic, note, "std_msgs/String", qos=QoS(depth=1))
        await anyio.sleep(seconds)
    return ages


def _note(ages: list[float], message: Any) -> None:
    ages.append(time.monotonic() - float(message.data.split(" ", 1)[0]))


async def drive(url: str, seconds: float) -> dict[str, list[float]]:
    """Send commands, and press and release the stop; return the round trips."""
    trips: dict[str, list[float]] = {"stop": [], "command": []}
    async with connect(url) as robot, anyio.create_task_group() as tasks:

        async def command() -> None:
            while True:
                began = time.monotonic()
                await robot.call("/probe", {"a": time.monotonic_ns(), "b": 0}, timeout=60)
                trips["command"].append(time.monotonic() - began)
                await anyio.sleep(1 / COMMAND_HZ)

        tasks.start_soon(command)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            began = time.monotonic()
            await robot.call("/gate/stop", timeout=60)
            trips["stop"].append(time.monotonic() - began)
            await robot.call("/gate/release_stop", timeout=60)
            await anyio.sleep(STOP_SECONDS)
        tasks.cancel_scope.cancel()
    return trips


async def upload(url: str, seconds: float) -> dict[str, list[float]]:
    """Send large messages without a pause."""
    async with connect(url) as robot:
        publisher = robot.advertise("/file", "std_msgs/String")
        with anyio.move_on_after(seconds):
            while True:
                publisher.publish({"data": "x" * FILE_BYTES})
                await robot.call("/rosapi/get_time", timeout=60)
    return {}


ROLES: Final = {"watch": watch, "drive": drive, "upload": upload}


@contextmanager
def _in(host: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = ["ip", "netns", "exec", host, sys.executable, *arguments]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def _line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


def measure(roles: Sequence[str], seconds: float, line: Line) -> dict[str, list[float]]:
    """Run a robot, a hub and the clients of these roles; return what they measured."""
    found: dict[str, list[float]] = {}
    with lossy_link(line) as (_, (robot_host, hub_host)), ExitStack() as stack:
        hub = stack.enter_context(
            _in(hub_host, "-m", "rwt.cli", "hub", f"ws://0.0.0.0:{PORT}", "--token", TOKEN)
        )
        assert _line(hub).startswith("listening")
        url = f"ws://{ADDRESSES[1]}:{PORT}/robots/rosie"
        robot = stack.enter_context(_in(robot_host, "-m", "bench.network.uplink", "--robot", url))
        assert _line(robot) == "ready\n"
        time.sleep(3.0)
        clients = [
            stack.enter_context(
                _in(
                    hub_host, "-m", "bench.network.uplink", "--role", role, "--seconds", str(seconds),
                    "--robot", f"ws://127.0.0.1:{PORT}/rosie",
                )
            )
            for role in roles
        ]  # fmt: skip
        for client in clients:
            found |= json.loads(_line(client))
        assert robot.stdin is not None
        robot.stdin.write("\n")
        robot.stdin.flush()
        found["command, one way"] = json.loads(_line(robot))
    return found


def _row(name: str, values: list[float]) -> str:
    values = sorted(values)
    if not values:
        return f"{name:<20} none"
    middle, late = values[len(values) // 2], values[min(len(values) * 99 // 100, len(values) - 1)]
    return f"{name:<20} {len(values):>5} {middle * 1e3:>8.0f} {late * 1e3:>8.0f} {values[-1] * 1e3:>8.0f}"


def main() -> None:
    """Measure an empty link, one full upwards, and one full both ways."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="duration of each case (default 20)")
    parser.add_argument("--robot", metavar="URL", help=argparse.SUPPRESS)
    parser.add_argument("--role", choices=sorted(ROLES), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.role is not None:
        measured = anyio.run(ROLES[arguments.role], arguments.robot, arguments.seconds)
        sys.stdout.write(json.dumps(measured) + "\n")
    elif arguments.robot is not None:
        anyio.run(be_the_robot, arguments.robot)
    else:
        for title, roles in (
            ("only the driver", ["drive"]),
            ("camera and scan above the link's capacity", ["watch", "drive"]),
            ("the same, and a file to the robot", ["watch", "drive", "upload"]),
        ):
            print(f"\n{title}\n{'':<20} {'count':>5} {'p50':>8} {'p99':>8} {'max':>8}  ms", flush=True)
            for name, values in measure(roles, arguments.seconds, LINK).items():
                print(_row(name, values), flush=True)


if __name__ == "__main__":
    main()
