"""A republisher on a simulated clock, a robot that publishes transforms, and clients of the bridge."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable
from dataclasses import dataclass
from typing import Any

import anyio.lowlevel
import pytest

from rwt import Settings
from rwt.extensions.tf_stream import Tf2WebRepublisher
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_tf2 import StampedTransform, Transform, write_transform
from tests.conftest import REGISTRIES, START_NS
from tests.core.rosbridge.recording_client import Client


@dataclass
class Lab:
    """The republisher's surroundings."""

    graph: MemoryGraph
    clock: SimulatedClock
    robot: Node
    bridge: Bridge

    def __post_init__(self) -> None:
        self._tf = self.robot.advertise("/tf", "tf2_msgs/TFMessage")
        self._fixed = self.robot.advertise("/tf_static", "tf2_msgs/TFMessage", latch=True)

    def publish(self, parent: str, child: str, transform: Transform | float) -> None:
        """One transform of this moment; a number is a shift along x."""
        self.publish_all([(parent, child, transform)])

    def publish_all(self, transforms: Iterable[tuple[str, str, Transform | float]]) -> None:
        self._tf.publish({"transforms": [self._message(*each) for each in transforms]})

    def publish_fixed(self, parent: str, child: str, transform: Transform | float) -> None:
        self._fixed.publish({"transforms": [self._message(parent, child, transform)]})

    def _message(self, parent: str, child: str, transform: Transform | float) -> dict[str, object]:
        moved = transform if isinstance(transform, Transform) else Transform((transform, 0.0, 0.0))
        return write_transform(StampedTransform(parent, child, self.clock.time_ns(), moved))

    async def pass_time(self, seconds: float) -> None:
        """Let time pass, and everybody do what is then due."""
        await settle()
        self.clock.advance(seconds)
        await settle()

    @property
    def ticking(self) -> bool:
        """True if some goal or topic still has a timer; those of requests here tick ten times a second."""
        due = self.clock.until_next()
        return due is not None and due <= 0.1


async def settle() -> None:
    for _ in range(20):
        await anyio.lowlevel.checkpoint()


@pytest.fixture
async def lab(distro: str) -> AsyncIterator[Lab]:
    clock = SimulatedClock(START_NS)
    graph = MemoryGraph(registry=REGISTRIES[distro], clock=clock)
    async with graph:
        with Tf2WebRepublisher(graph), Node(graph, "robot") as robot:
            yield Lab(graph, clock, robot, Bridge(graph, Settings()))


class Asking:
    """A web page that asks for transforms, in any of the ways."""

    def __init__(self, lab: Lab) -> None:
        self.lab = lab
        self.client = Client(lab.bridge)

    async def send_goal(self, goal: dict[str, object], id: str = "g1", package: str = "interfaces") -> None:
        self.client.say(
            "send_action_goal",
            action="/tf2_web_republisher",
            action_type=f"tf2_web_republisher_{package}/action/TFSubscription",
            feedback=True,
            args=goal,
            id=id,
        )
        await settle()

    def cancel(self, id: str = "g1") -> None:
        self.client.say("cancel_action_goal", action="/tf2_web_republisher", id=id)

    async def call(self, request: dict[str, object]) -> Any:
        """The service's answer."""
        self.client.say("call_service", service="/republish_tfs", args=request, id="call")
        await settle()
        return next(message for message in self.client.heard() if message["op"] == "service_response")

    def heard(self) -> list[Any]:
        return self.client.heard()

    def feedback(self, id: str = "g1") -> list[Any]:
        """The transforms of each feedback since the last time."""
        return [
            message["values"]["transforms"]
            for message in self.client.heard()
            if message["op"] == "action_feedback" and message["id"] == id
        ]


@pytest.fixture
def page(lab: Lab) -> Asking:
    return Asking(lab)


def places(transforms: list[Any]) -> dict[str, float]:
    """Where each frame is along x."""
    return {each["child_frame_id"]: each["transform"]["translation"]["x"] for each in transforms}
