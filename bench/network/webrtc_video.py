"""`python -m bench.network.webrtc_video`: a camera of 640x480 over a bad line, and what ten viewers cost.

How old pictures are by WebRTC (WHEP) and as MJPEG on the line of :mod:`bench.network.webrtc`, then with the
line cut to 500 kbit/s; and the processor time of the encoder for one viewer and for ten. Needs Linux, root
and `/dev/net/tun`.
"""

from __future__ import annotations

import argparse
import io
import json
import subprocess
import sys
import time
import urllib.request
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final
from unittest.mock import patch

import anyio
import anyio.to_thread
import numpy as np
from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError
from av import VideoFrame
from PIL import Image

from bench.network.lossy_link import ADDRESSES, lossy_link
from bench.network.webrtc import BAD, PORT, percentile
from bench.paper.camera import mark, read_mark
from rwt import Server
from rwt.media.encoders.video import VideoEncoder
from rwt_graph import Node
from rwt_webrtc.settings import WebRtcSettings

HZ: Final = 20
TOPIC: Final = "/camera/image_raw"
CUT_BITS: Final = 500_000
WAYS: Final = ("webrtc", "mjpeg")
MOST_AGE: Final = 250.0
"""Milliseconds that a picture by WebRTC may be old on the bad line: the median."""
MOST_PAUSE: Final = 2.0
"""Seconds until the picture goes on when the line is cut."""
MOST_CPU: Final = 1.5
"""Maximum ratio of the encoder's CPU time for ten viewers and for one."""
_NOISE: Final = np.random.default_rng(1).integers(0, 256, (120, 160, 3), np.uint8)

Seen = list[tuple[float, float]]
"""When each picture came, and how old it was; seconds."""


async def play(node: Node) -> None:
    """Publish a moving picture for ever, with the time in it."""
    images = node.advertise(TOPIC, "sensor_msgs/Image")
    count = 0
    while True:
        count += 1
        picture = np.roll(_NOISE, count % 160, axis=1).repeat(4, axis=1).repeat(4, axis=0)
        mark(picture, count % 4096, time.time_ns() // 1_000_000)
        shape = {"height": 480, "width": 640, "encoding": "rgb8", "step": 1920}
        images.publish({**shape, "data": picture.tobytes()})
        await anyio.sleep(1 / HZ)


async def robot() -> None:
    """Serve the camera until standard input ends."""
    peers = WebRtcSettings(enabled=True)
    async with (
        Server(f"ws://{ADDRESSES[0]}:{PORT}", webrtc=peers) as server,
        anyio.create_task_group() as tasks,
    ):
        tasks.start_soon(play, server.node("camera"))
        print("up", flush=True)
        await anyio.to_thread.run_sync(sys.stdin.read)
        tasks.cancel_scope.cancel()


class Viewer:
    """One viewer by WHEP.

    Attributes:
        seen: its pictures, where it reads them.
        has_track: is set when it has been told of the video.
        has_picture: is set when the first picture has come.
    """

    def __init__(self, base: str, *, reads: bool) -> None:
        self.seen: Seen = []
        self.has_track = anyio.Event()
        self.has_picture = anyio.Event()
        self._base = base
        self._reads = reads
        self._track: MediaStreamTrack | None = None
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.connection.addTransceiver("video", "recvonly")
        self.connection.on("track", self._take)

    def _take(self, track: MediaStreamTrack) -> None:
        self._track = track
        self.has_track.set()

    async def begin(self) -> None:
        """Ask for the video."""
        await self.connection.setLocalDescription()
        url = f"{self._base}/whep?topic={TOPIC}"
        body, kind = self.connection.localDescription.sdp.encode(), {"Content-Type": "application/sdp"}

        def ask() -> str:
            with urllib.request.urlopen(urllib.request.Request(url, body, kind), timeout=20) as answer:
                return str(answer.read().decode())

        answer = await anyio.to_thread.run_sync(ask)
        await self.connection.setRemoteDescription(RTCSessionDescription(answer, "answer"))

    async def watch(self) -> None:
        """Take pictures until there are none."""
        assert self._track is not None
        try:
            while True:
                frame = await self._track.recv()
                self.has_picture.set()
                if self._reads:
                    assert isinstance(frame, VideoFrame)
                    count_colour(self.seen, np.asarray(frame.to_ndarray(format="rgb24"), np.uint8))
        except MediaStreamError:
            return


def count_colour(seen: Seen, picture: Any) -> None:
    height, width = picture.shape[:2]  # Less than 640x480 on a slow line.
    picture = picture[np.arange(480) * height // 480][:, np.arange(640) * width // 640]
    age = read_mark(picture)[1] / 1000
    if age < 60:  # Else the squares were not readable.
        if not seen:
            print("it sees something", flush=True)
        seen.append((time.time(), age))


async def operator(way: str, seconds: float) -> None:
    """Look at the camera for so long, and print what was seen as JSON."""
    base = f"http://{ADDRESSES[0]}:{PORT}"
    if way == "webrtc":
        viewer = Viewer(base, reads=True)
        await viewer.begin()
        await viewer.has_track.wait()
        with anyio.move_on_after(seconds):
            await viewer.watch()
        print(json.dumps(viewer.seen), flush=True)
        await viewer.connection.close()
    else:
        print(json.dumps(await anyio.to_thread.run_sync(_by_mjpeg, base, seconds)), flush=True)


def _by_mjpeg(base: str, seconds: float) -> Seen:
    seen: Seen = []
    until = time.monotonic() + seconds
    with urllib.request.urlopen(f"{base}/stream?topic={TOPIC}&type=mjpeg&quality=50", timeout=20) as stream:
        while time.monotonic() < until:
            length = 0
            while (line := stream.readline().strip()) or not length:
                if line.lower().startswith(b"content-length:"):
                    length = int(line.partition(b":")[2])
            with Image.open(io.BytesIO(stream.read(length))) as image:
                count_colour(seen, np.asarray(image.convert("RGB")))
    return seen


def measure(way: str, seconds: float) -> tuple[Seen, float]:
    """Return what was seen in two periods of `seconds`, and when the line was cut."""
    with lossy_link(BAD) as (link, hosts), _there(hosts[0], "--robot") as robot_there:
        assert robot_there.stdout is not None
        robot_there.stdout.readline()
        with _there(hosts[1], "--operator", way, str(2 * seconds)) as operator_there:
            assert operator_there.stdout is not None
            operator_there.stdout.readline()  # It sees something.
            time.sleep(seconds)
            cut = time.time()
            link.line = replace(BAD, bits=CUT_BITS)
            seen, _ = operator_there.communicate(timeout=2 * seconds + 60)
        robot_there.communicate(timeout=60)
    return [(at, age) for at, age in json.loads(seen)], cut


def _there(host: str, *arguments: str) -> subprocess.Popen[str]:
    command = ["ip", "netns", "exec", host, sys.executable, "-m", "bench.network.webrtc_video", *arguments]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


# -- viewers -------------------------------------------------------------------------------------------------


async def encoder_seconds(viewers: int, seconds: float) -> float:
    """Processor time of the encoder for a picture, with so many viewers on loopback."""
    spent: list[float] = []
    encode = VideoEncoder.encode

    def timed(self: VideoEncoder, payload: Any, at_ms: int, *, key: bool) -> Any:
        began = time.thread_time()
        try:
            return encode(self, payload, at_ms, key=key)
        finally:
            spent.append(time.thread_time() - began)

    async with (
        Server("ws://127.0.0.1:0", webrtc=WebRtcSettings(enabled=True)) as server,
        anyio.create_task_group() as tasks,
    ):
        with patch.object(VideoEncoder, "encode", timed):
            tasks.start_soon(play, server.node("camera"))
            url = server.urls[0].replace("ws", "http", 1)
            command = [sys.executable, "-m", "bench.network.webrtc_video", "--watch", str(viewers), url]
            process = await anyio.open_process([*command, str(seconds)])
            assert process.stdout is not None
            await process.stdout.receive()
            spent.clear()
            began = server.graph.clock.monotonic()
            await process.wait()
            lasted = server.graph.clock.monotonic() - began
            tasks.cancel_scope.cancel()
    # What a second of the camera costs, however many pictures of it this machine has had the time for.
    return sum(spent) / lasted


async def watch(viewers: int, url: str, seconds: float) -> None:
    """Be so many viewers, and say when all of them see something."""
    made = [Viewer(url, reads=False) for _ in range(viewers)]
    for each in made:
        await each.begin()
    async with anyio.create_task_group() as tasks:
        for each in made:
            tasks.start_soon(each.watch)
        for each in made:
            await each.has_picture.wait()
        print("all see it", flush=True)
        await anyio.sleep(seconds)
        tasks.cancel_scope.cancel()
    for each in made:
        await each.connection.close()


# -- the report ----------------------------------------------------------------------------------------------


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; the exit code is 1 where a bound is missed."""
    parser = argparse.ArgumentParser(prog="python -m bench.network.webrtc_video", description=__doc__)
    parser.add_argument("--seconds", type=float, default=15.0, help="on each line, and of each number")
    parser.add_argument("--robot", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--operator", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--watch", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.robot:
        anyio.run(robot)
    elif options.operator:
        anyio.run(operator, options.operator[0], float(options.operator[1]))
    elif options.watch:
        count, url, seconds = options.watch
        anyio.run(watch, int(count), url, float(seconds))
    else:
        return _report(options.seconds)
    return 0


def _report(seconds: float) -> int:
    missed: list[str] = []
    print("| by | line | pictures a second | median age | 95 % | longest pause |")
    print("|---|---|---|---|---|---|")
    for way in WAYS:
        seen, cut = measure(way, seconds)
        before = [each for each in seen if each[0] < cut]
        after = [each for each in seen if each[0] >= cut]
        for line, part, begin in (("bad", before, cut - seconds), ("500 kbit/s", after, cut)):
            times = [at for at, _ in part]
            ages = [age for _, age in part]
            if not ages:
                print(f"| {way} | {line} | 0 | | | |")
                missed.append(f"{way}: no picture on the line {line}")
                continue
            start = begin if line != "bad" else times[0]
            pauses = np.diff([start, *times])
            rate = len(times) / max(times[-1] - start, 1e-3)
            row = f"{percentile(ages, 0.5):.0f} ms | {percentile(ages, 0.95):.0f} ms | {max(pauses):.2f} s"
            print(f"| {way} | {line} | {rate:.1f} | {row} |", flush=True)
            if way == "webrtc" and line == "bad" and percentile(ages, 0.5) > MOST_AGE:
                missed.append(
                    f"median age {percentile(ages, 0.5):.0f} ms on the bad line, bound {MOST_AGE:g} ms"
                )
            if way == "webrtc" and line != "bad" and max(pauses) > MOST_PAUSE:
                missed.append(f"a pause of {max(pauses):.1f} s on the cut line, bound {MOST_PAUSE:g} s")
    one, ten = (anyio.run(encoder_seconds, viewers, seconds / 3) for viewers in (1, 10))
    print(f"\nencoder: {1000 * one:.0f} ms a second for one viewer, {1000 * ten:.0f} ms for ten")
    if ten > MOST_CPU * one:
        missed.append(f"ten viewers cost {ten / one:.2f} times the encoder of one, bound {MOST_CPU:g}")
    for each in missed:
        print(f"<<< {each}")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
