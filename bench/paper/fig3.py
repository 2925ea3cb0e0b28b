"""Fig. 3: what a minute of transforms costs on the wire, plain and republished."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import anyio
import anyio.lowlevel

from bench.paper.arm_robot import DRIVES, LINKS, MINUTE, ROOT
from bench.paper.counting import CountingClient
from bench.paper.report import Report
from rwt import Settings
from rwt.extensions.tf_stream import Tf2WebRepublisher
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph, Node, SimulatedClock, TopicPublisher
from rwt_tf2 import IDENTITY, Buffer, StampedTransform, Transform, write_transform

RATE, LINEAR, ANGULAR = 10.0, 0.01, 0.01
ODOMETRY_HZ, STATE_HZ = 30, 15
PAPER_PLAIN, PAPER_REPUBLISHED = 208.5, 96.0
PAPER_SAVED: Final = 1 - PAPER_REPUBLISHED / PAPER_PLAIN
START_NS: Final = 1_440_000_000_000_000_000
STEP: Final = 1 / 60
"""Seconds; every rate is a whole number of steps."""


_NOTES = f"""\
{len(LINKS) + 1} frames, {{seconds:g}} s of teleoperation on a simulated clock, \
the base driving in {{driving:g}} s of 60;
odometry at {ODOMETRY_HZ} Hz, joints and fixed frames at {STATE_HZ} Hz: plain /tf is \
about as heavy as in the paper.
Republished at {RATE:g} Hz, {LINEAR} m, {ANGULAR} rad, seen from {ROOT}, or as changes of the tree.
Bytes with WebSocket headers, no deflate.
Off: the largest difference of any frame's pose, seen from the root, from what a page on plain /tf holds then.
Seen from a target, poses are of the latest time \
that all transforms on the way have, as tf2 has it: they lag.
"""


@dataclass(slots=True)
class Viewer:
    """One way to get the transforms, and what a page holds that does.

    Attributes:
        name: for the table.
        sent: bytes at the end of each second.
        off_after: the largest difference from plain `/tf` right after a message was due, metres and radians.
        off_ever: the same at any moment.
    """

    name: str
    compression: str
    target: str | None
    buffer: Buffer = field(default_factory=Buffer)
    client: CountingClient | None = None
    sent: list[int] = field(default_factory=list)
    off_after: tuple[float, float] = (0.0, 0.0)
    off_ever: tuple[float, float] = (0.0, 0.0)

    def take(self, message: Any) -> None:
        """Keep what a message says; it holds until it is said anew."""
        if message["op"] == "service_response":
            self.subscribe(message["values"]["topic_name"], "tf2_web_republisher/TFArray")
        elif message["op"] == "publish":
            for each in message["msg"]["transforms"]:
                self.buffer.set_transform(_read(each), static=True)

    def subscribe(self, topic: str, type_name: str) -> None:
        assert self.client is not None
        self.client.received = 0
        self.client.say(op="subscribe", topic=topic, type=type_name, compression=self.compression)

    def begin(self, bridge: Bridge) -> None:
        self.client = CountingClient(bridge, self.take)
        if self.target is None:
            self.subscribe("/tf", "tf2_msgs/TFMessage")
            return
        request = {
            "source_frames": list(LINKS) if self.target else [],
            "target_frame": self.target,
            "angular_thres": ANGULAR,
            "trans_thres": LINEAR,
            "rate": RATE,
            "timeout": {"sec": 10},
        }
        self.client.say(op="call_service", service="/republish_tfs", args=request)

    def compare(self, plain: Buffer, after: bool) -> None:
        off = _largest_difference(plain, self.buffer)
        self.off_ever = _worse(self.off_ever, off)
        if after:
            self.off_after = _worse(self.off_after, off)

    def rate(self) -> float:
        """Kilobytes a second."""
        return self.sent[-1] / 1000 / len(self.sent)


def viewers() -> list[Viewer]:
    ways = (("plain /tf", None), ("republished", ROOT), ("only changes", ""))
    return [
        Viewer(f"{name}, {'cbor' if compression == 'cbor' else 'json'}", compression, target)
        for name, target in ways
        for compression in ("none", "cbor")
    ]


def _read(message: Any) -> StampedTransform:
    moved, turned = message["transform"]["translation"], message["transform"]["rotation"]
    transform = Transform(
        (moved["x"], moved["y"], moved["z"]), (turned["x"], turned["y"], turned["z"], turned["w"])
    )
    return StampedTransform(message["header"]["frame_id"], message["child_frame_id"], 0, transform)


def _worse(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return max(a[0], b[0]), max(a[1], b[1])


def _largest_difference(plain: Buffer, other: Buffer) -> tuple[float, float]:
    """Metres and radians, over all frames as seen from the root."""
    ours, theirs = _poses(plain), _poses(other)
    distance = max(ours[frame].distance_to(theirs[frame]) for frame in LINKS)
    return distance, max(ours[frame].angle_to(theirs[frame]) for frame in LINKS)


def _poses(buffer: Buffer) -> dict[str, Transform]:
    """Every frame in its root, by the latest transforms."""
    poses: dict[str, Transform] = {}
    for frame in LINKS:
        edge = buffer.latest(frame)
        assert edge is not None  # Every frame but the root has a parent.
        poses[frame] = poses.get(edge.parent, IDENTITY) @ edge.transform
    return poses


class Broadcasters:
    """Publishers of `/tf`: odometry, and a state publisher that also repeats fixed joints.

    In 2015 nearly all robots did so; `/tf_static` was new.
    """

    def __init__(self, node: Node) -> None:
        self._clock = node.clock
        self._tf: TopicPublisher = node.advertise("/tf", "tf2_msgs/TFMessage")
        self._odometry = ["base_footprint"]
        self._state = [frame for frame in LINKS if frame not in self._odometry]

    def publish(self, step: int) -> None:
        """Publish what is due at a step."""
        if step % round(1 / STEP / ODOMETRY_HZ) == 0:
            self._publish(self._odometry)
        if step % round(1 / STEP / STATE_HZ) == 0:
            self._publish(self._state)

    def _publish(self, frames: Sequence[str]) -> None:
        now = self._clock.time_ns()
        second = (now - START_NS) / 1e9
        stamped = (
            StampedTransform(LINKS[frame].parent, frame, now, LINKS[frame].at(second)) for frame in frames
        )
        self._tf.publish({"transforms": [write_transform(each) for each in stamped]})


async def play(watching: Sequence[Viewer], seconds: float) -> None:
    """Play the minute for all of them at once, on a simulated clock."""
    clock = SimulatedClock(START_NS)
    async with MemoryGraph(clock=clock) as graph:
        with Tf2WebRepublisher(graph), Node(graph, "robot") as node:
            bridge, robot = Bridge(graph, Settings()), Broadcasters(node)
            for viewer in watching:
                viewer.begin(bridge)
            await anyio.lowlevel.checkpoint()
            for step in range(round(seconds / STEP)):
                robot.publish(step)
                # A tick of the republisher falls on every sixth step.
                due = step % round(1 / STEP / RATE) == 0
                if step > 6 and due:
                    _compare(watching, after=False)
                clock.advance(STEP / 2)
                if step > 6 and due:
                    _compare(watching, after=True)
                clock.advance(STEP / 2)
                if (step + 1) % round(1 / STEP) == 0:
                    _count(watching)


def _compare(watching: Sequence[Viewer], after: bool) -> None:
    plain = watching[0].buffer
    for viewer in watching[1:]:
        viewer.compare(plain, after)


def _count(watching: Sequence[Viewer]) -> None:
    for viewer in watching:
        assert viewer.client is not None
        viewer.sent.append(viewer.client.received)


def measure(seconds: float = MINUTE) -> Report:
    watching = viewers()
    anyio.run(play, watching, seconds)
    plain = watching[0].rate()
    rows = [
        ("paper: plain /tf", f"{PAPER_PLAIN:.1f}", "", "", ""),
        ("paper: republished", f"{PAPER_REPUBLISHED:.1f}", f"{PAPER_SAVED:.0%}", "", ""),
        *(_row(viewer, plain) for viewer in watching),
    ]
    driving = sum(phase.end - phase.begin for phase in DRIVES)
    return Report(
        "Fig. 3: transforms of a mobile robot with a 6-DOF arm",
        ("", "KB/s", "less", "off after a message", "off at any moment"),
        rows,
        (_NOTES.format(seconds=seconds, driving=driving),),
        _missed(watching, plain),
        partial(draw, watching),
    )


def _row(viewer: Viewer, plain: float) -> tuple[str, ...]:
    return (
        viewer.name,
        f"{viewer.rate():.1f}",
        f"{1 - viewer.rate() / plain:.0%}",
        _off(viewer.off_after),
        _off(viewer.off_ever),
    )


def _off(off: tuple[float, float]) -> str:
    return f"{off[0] * 1000:.1f} mm, {off[1]:.4f} rad"


def _missed(watching: Sequence[Viewer], plain: float) -> list[str]:
    """Each way must save clearly more than the paper's did."""
    return [
        f"{viewer.name} saves {1 - viewer.rate() / plain:.0%}, the paper {PAPER_SAVED:.0%}"
        for viewer in watching
        if viewer.target is not None and 1 - viewer.rate() / plain < PAPER_SAVED + 0.05
    ]


def draw(watching: Sequence[Viewer], file: Path) -> None:
    """Write the figure."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9, 4.5), layout="constrained")
    for viewer in watching:
        kilobytes = [
            (now - before) / 1000 for before, now in zip([0, *viewer.sent], viewer.sent, strict=False)
        ]
        axes.plot(range(1, len(kilobytes) + 1), kilobytes, label=viewer.name)
    for value, name in ((PAPER_PLAIN, "paper, plain"), (PAPER_REPUBLISHED, "paper, republished")):
        axes.axhline(value, color="grey", linestyle="--")
        right = axes.get_yaxis_transform()
        axes.text(0.99, value, name, transform=right, ha="right", va="bottom", color="grey")
    axes.set(xlabel="s", ylabel="KB/s", title="Transforms, a minute of teleoperation", ylim=(0, None))
    figure.legend(loc="outside right upper")
    figure.savefig(file, dpi=120)
    pyplot.close(figure)
