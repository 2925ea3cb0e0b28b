"""A graph on a simulated clock with a camera and a viewer on it."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Any

import anyio
import pytest

from rwt_graph import MemoryGraph, Node, SimulatedClock
from tests.conftest import REGISTRIES, START_NS


@dataclass
class Studio:
    """Where a node under test works."""

    graph: MemoryGraph
    clock: SimulatedClock
    camera: Node
    viewer: Node

    async def until(self, happened: Callable[[], object]) -> None:
        """Let timers tick and threads work until something has happened."""
        with anyio.fail_after(20):
            while not happened():
                self.clock.advance(0.05)
                await anyio.sleep(0.002)

    async def settle(self) -> None:
        """Let everything that is due be done; threads have the time of a breath."""
        for _ in range(10):
            self.clock.advance(0.05)
            await anyio.sleep(0.002)

    def listeners(self, topic: str) -> int:
        """Return the number of subscribers of a topic."""
        found = self.graph.topic(topic)
        return len(found.subscribers) if found is not None else 0

    def heard(self, topic: str) -> list[Any]:
        """A list that grows with each message of a topic."""
        messages: list[Any] = []
        self.viewer.subscribe(topic, messages.append)
        return messages


@pytest.fixture
async def studio(distro: str, anyio_backend: str) -> AsyncIterator[Studio]:
    clock = SimulatedClock(START_NS)
    async with MemoryGraph(registry=REGISTRIES[distro], clock=clock) as graph:
        yield Studio(graph, clock, Node(graph, "camera"), Node(graph, "viewer"))
