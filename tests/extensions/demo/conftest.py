"""A demo robot on a simulated clock, and a second node that watches and commands it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any

import anyio.lowlevel
import pytest

from rwt.extensions.demo import DemoRobot
from rwt_graph import MemoryGraph, Node, SimulatedClock
from tests.conftest import REGISTRIES, START_NS


@dataclass
class Lab:
    """The robot's surroundings; messages are what ROS payloads are, so they are not typed."""

    graph: MemoryGraph
    clock: SimulatedClock
    robot: DemoRobot
    user: Node

    def watch(self, topic: str) -> list[Any]:
        """A list that grows with each message of a topic."""
        heard: list[Any] = []
        self.user.subscribe(topic, heard.append)
        return heard

    def latest(self, topic: str) -> Any:
        """The next message of a topic, or the one that is kept."""
        heard: list[Any] = []
        subscription = self.user.subscribe(topic, heard.append)
        if not heard:
            self.clock.advance(1.0)
        subscription.close()
        return heard[-1]

    def command(self, linear: float = 0.0, angular: float = 0.0, seconds: float = 1.0) -> None:
        """Hold a stick for a while, sending ten times a second."""
        stick = self.user.advertise("/cmd_vel", "geometry_msgs/Twist")
        for _ in range(round(seconds * 10)):
            stick.publish({"linear": {"x": linear}, "angular": {"z": angular}})
            self.clock.advance(0.1)
        stick.close()

    async def settle(self) -> None:
        """Let every coroutine run until it waits again."""
        for _ in range(20):
            await anyio.lowlevel.checkpoint()

    async def pass_time(self, seconds: float) -> None:
        """Advance in short steps, between which coroutines run."""
        for _ in range(round(seconds * 20)):
            self.clock.advance(0.05)
            await self.settle()

    def parameter(self, name: str) -> str:
        """Return the name of a parameter of the robot in this distribution."""
        separator = ":" if self.graph.distro.parameters_belong_to_nodes else "/"
        return f"/demo_robot{separator}{name}"

    def nanoseconds(self, time: Any) -> int:
        """A time or a duration of this distribution."""
        seconds, rest = (getattr(time, name) for name in self.graph.distro.time_fields)
        return int(seconds) * 1_000_000_000 + int(rest)


@pytest.fixture
async def lab(distro: str, anyio_backend: str) -> AsyncIterator[Lab]:
    clock = SimulatedClock(START_NS)
    async with MemoryGraph(registry=REGISTRIES[distro], clock=clock) as graph:
        robot = DemoRobot(graph)
        yield Lab(graph, clock, robot, Node(graph, "user"))
        robot.close()
