"""A server of interactive markers on a simulated clock, and a node that watches it as viewers do."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any

import anyio.lowlevel
import pytest

from rwt.extensions.markers import Event, InteractiveMarkerServer
from rwt.extensions.markers.feedback import OnFeedback
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_participant.messages import MessageLike
from tests.conftest import REGISTRIES, START_NS


@dataclass
class Lab:
    """Messages are what ROS payloads are, so they are not typed."""

    graph: MemoryGraph
    clock: SimulatedClock
    viewer: Node
    server: InteractiveMarkerServer

    def watch(self, topic: str = "update") -> list[Any]:
        """A list that grows with each message of a topic of the markers."""
        heard: list[Any] = []
        self.viewer.subscribe(f"/marks/{topic}", heard.append)
        return heard

    def show(self, *markers: MessageLike, on_feedback: OnFeedback | None = None) -> list[Any]:
        """Show markers. Return a list that grows with each later change."""
        for marker in markers:
            self.server.insert(marker, on_feedback)
        self.server.apply_changes()
        return self.watch()

    async def init(self) -> Any:
        """Send the first request of ros3djs."""
        return (await self.viewer.call("/marks/tunneled/get_init")).msg

    def send(self, event: int, marker: str = "goal", **fields: object) -> None:
        """Feedback of a viewer."""
        feedback = self.viewer.advertise("/marks/feedback", "visualization_msgs/InteractiveMarkerFeedback")
        feedback.publish({"marker_name": marker, "event_type": event, **fields})
        feedback.close()

    def drag(self, x: float, marker: str = "goal", **fields: object) -> None:
        """Feedback that moves the marker to `x`."""
        self.send(Event.POSE_UPDATE, marker, pose=pose(x), header={"frame_id": "map"}, **fields)

    async def settle(self) -> None:
        """Let every coroutine run until it waits again."""
        for _ in range(20):
            await anyio.lowlevel.checkpoint()


def pose(x: float) -> dict[str, object]:
    """`geometry_msgs/Pose` on the x axis."""
    return {"position": {"x": x}, "orientation": {"w": 1.0}}


@pytest.fixture
async def lab(distro: str, anyio_backend: str) -> AsyncIterator[Lab]:
    clock = SimulatedClock(START_NS)
    async with MemoryGraph(registry=REGISTRIES[distro], clock=clock) as graph:
        server = InteractiveMarkerServer(Node(graph, "robot"), "/marks")
        yield Lab(graph, clock, Node(graph, "viewer"), server)
        server.close()
