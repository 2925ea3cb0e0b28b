"""`python -m bench.network.webrtc`: how old `/cmd_vel` and `/odom` are when they arrive over a bad line.

A robot and an operator on hosts of their own, between them a line that loses 2 % of the packets and takes
40 ± 20 ms each way. Both topics go at 50 Hz, by a WebSocket, by an ordered data channel between rwt_client
and the server, and by an unordered one without retransmission. Needs Linux, root and `/dev/net/tun`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
import urllib.request
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import replace
from typing import Final

import anyio
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from websockets.asyncio.client import connect

from bench.network.lossy_link import ADDRESSES, Line, lossy_link
from rwt import Server
from rwt_client import connect as connect_robot
from rwt_webrtc.settings import WebRtcSettings

HZ: Final = 50
PORT: Final = 9090
BAD: Final = Line(loss=0.02, delay=0.04, jitter=0.02)
WAYS: Final = ("WebSocket", "ordered channel", "lossy channel")
MOST: Final = 0.5
"""Maximum ratio of the 99th percentiles of lossy channel and WebSocket."""
_SUBSCRIBE: Final = (
    '{"op":"subscribe","id":"odom","topic":"/odom","type":"nav_msgs/Odometry","queue_length":1}'
)


async def robot() -> None:
    """Publish /odom and hear /cmd_vel until standard input ends, and print how old each command was."""
    ages: list[float] = []
    async with Server(f"ws://{ADDRESSES[0]}:{PORT}", webrtc=WebRtcSettings(enabled=True)) as server:
        node = server.node("base")
        node.subscribe(
            "/cmd_vel", lambda twist: ages.append(time.time() - twist.linear.z), "geometry_msgs/Twist"
        )
        odom = node.advertise("/odom", "nav_msgs/Odometry")
        print("up", flush=True)
        async with anyio.create_task_group() as tasks:

            async def publish() -> None:
                while True:
                    now = time.time_ns()
                    odom.publish({"header": {"stamp": {"sec": now // 10**9, "nanosec": now % 10**9}}})
                    await anyio.sleep(1 / HZ)

            tasks.start_soon(publish)
            await anyio.to_thread.run_sync(sys.stdin.read)
            tasks.cancel_scope.cancel()
    print(json.dumps(ages), flush=True)


async def operator(way: str, seconds: float) -> None:
    """Publish /cmd_vel and hear /odom, and print how old each position was, as JSON."""
    ages: list[float] = []

    def hear(seconds: int, nanoseconds: int) -> None:
        ages.append(time.time() - seconds - nanoseconds / 1e9)

    await _OPERATORS[way](hear, seconds)
    print(json.dumps(ages), flush=True)


def _stamp(text: str | bytes) -> tuple[int, int]:
    stamp = json.loads(text)["msg"]["header"]["stamp"]
    return stamp["sec"], stamp["nanosec"]


async def _drive(send: Callable[[str], Awaitable[None]], seconds: float) -> None:
    await send('{"op":"advertise","topic":"/cmd_vel","type":"geometry_msgs/Twist"}')
    await send(_SUBSCRIBE)
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        now = time.time()
        msg = {"linear": {"x": 0.1, "y": 0.0, "z": now}}
        command = {"op": "publish", "topic": "/cmd_vel", "type": "geometry_msgs/Twist", "msg": msg}
        await send(json.dumps(command))
        await anyio.sleep(1 / HZ)


async def _by_websocket(hear: Callable[[int, int], None], seconds: float) -> None:
    async with connect(f"ws://{ADDRESSES[0]}:{PORT}") as socket, anyio.create_task_group() as tasks:

        async def listen() -> None:
            async for message in socket:
                hear(*_stamp(message))

        tasks.start_soon(listen)
        await _drive(socket.send, seconds)
        tasks.cancel_scope.cancel()


async def _by_ordered_channel(hear: Callable[[int, int], None], seconds: float) -> None:
    async with connect_robot(f"webrtc+http://{ADDRESSES[0]}:{PORT}") as robot:
        commands = robot.advertise("/cmd_vel", "geometry_msgs/Twist")
        robot.subscribe(
            "/odom", lambda odom: hear(odom.header.stamp.sec, odom.header.stamp.nanosec), "nav_msgs/Odometry"
        )
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            commands.publish({"linear": {"x": 0.1, "y": 0.0, "z": time.time()}})
            await anyio.sleep(1 / HZ)


async def _by_lossy_channel(hear: Callable[[int, int], None], seconds: float) -> None:
    peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    channel = peer.createDataChannel("fresh", ordered=False, maxRetransmits=0)
    channel.on("message", lambda text: hear(*_stamp(text)))
    opened = anyio.Event()
    channel.on("open", opened.set)
    await peer.setLocalDescription()
    request = urllib.request.Request(
        f"http://{ADDRESSES[0]}:{PORT}/webrtc",
        peer.localDescription.sdp.encode(),
        {"Content-Type": "application/sdp"},
    )
    answer = await anyio.to_thread.run_sync(
        lambda: urllib.request.urlopen(request, timeout=20).read().decode()
    )
    await peer.setRemoteDescription(RTCSessionDescription(answer, "answer"))
    await opened.wait()

    async def send(text: str) -> None:
        channel.send(text)

    await send('{"op":"advertise","topic":"/cmd_vel","type":"geometry_msgs/Twist"}')
    # What is asked once may be lost, like everything on this channel: asked again it costs nothing.
    for _ in range(3):
        await send(
            '{"op":"subscribe","id":"odom","topic":"/odom","type":"nav_msgs/Odometry","queue_length":1}'
        )
        await anyio.sleep(0.2)
    await _drive(send, seconds)
    await peer.close()


_OPERATORS: Final = {
    "WebSocket": _by_websocket,
    "ordered channel": _by_ordered_channel,
    "lossy channel": _by_lossy_channel,
}


def _fetch(request: urllib.request.Request) -> str:
    with urllib.request.urlopen(request, timeout=20) as answer:
        text: str = answer.read().decode()
    return text


def measure(way: str, seconds: float, line: Line) -> dict[str, list[float]]:
    """The ages of both topics by one way, seconds."""
    with lossy_link(line) as (_, hosts):
        robot_there = _there(hosts[0], "--robot")
        assert robot_there.stdout is not None
        robot_there.stdout.readline()  # It is up.
        operator_there = _there(hosts[1], "--operator", way, str(seconds))
        odom, _ = operator_there.communicate(timeout=seconds + 60)
        commands, _ = robot_there.communicate(timeout=60)
    return {"/cmd_vel": json.loads(commands), "/odom": json.loads(odom)}


def _there(host: str, *arguments: str) -> subprocess.Popen[str]:
    command = ["ip", "netns", "exec", host, sys.executable, "-m", "bench.network.webrtc", *arguments]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def percentile(ages: Sequence[float], part: float) -> float:
    """The age, in milliseconds, that this part of them does not exceed."""
    ordered = sorted(ages)
    return 1000 * ordered[min(len(ordered) - 1, int(part * len(ordered)))]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure both ways; the exit code is 1 where the channel is not as fresh as it has to be."""
    parser = argparse.ArgumentParser(prog="python -m bench.network.webrtc", description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="how long each way is measured")
    parser.add_argument("--loss", type=float, default=BAD.loss, help="part of the packets that is lost")
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=WAYS, help="which ways are measured")
    parser.add_argument("--robot", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--operator", nargs=2, metavar=("WAY", "SECONDS"), help=argparse.SUPPRESS)
    arguments = parser.parse_args(argv)
    if arguments.robot:
        anyio.run(robot)
        return 0
    if arguments.operator is not None:
        anyio.run(operator, arguments.operator[0], float(arguments.operator[1]))
        return 0
    line = replace(BAD, loss=arguments.loss)
    found = {way: measure(way, arguments.seconds, line) for way in arguments.ways}
    print("| topic | by | messages | median | p99 | largest |")
    print("|---|---|---|---|---|---|")
    fresh = True
    for topic in ("/cmd_vel", "/odom"):
        p99 = {way: percentile(ages[topic], 0.99) for way, ages in found.items()}
        for way, ages in found.items():
            row = (f"{percentile(ages[topic], part):.0f} ms" for part in (0.5, 0.99, 1.0))
            print(f"| `{topic}` | {way} | {len(ages[topic])} | {' | '.join(row)} |")
        if {"WebSocket", "lossy channel"} <= p99.keys():
            fresh = fresh and p99["lossy channel"] <= MOST * p99["WebSocket"]
    return 0 if fresh else 1


if __name__ == "__main__":
    sys.exit(main())
