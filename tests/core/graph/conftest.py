from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from typing import TypeAlias

import anyio
import pytest

from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.registry import Registry

Advance: TypeAlias = Callable[[float], Awaitable[None]]


@pytest.fixture
def clock() -> SimulatedClock:
    return SimulatedClock(start_ns=1_000_000_000)


@pytest.fixture
def graph(clock: SimulatedClock) -> MemoryGraph:
    """A jazzy graph in simulated time, not entered."""
    return MemoryGraph(Registry(), clock)


@pytest.fixture
async def node(graph: MemoryGraph) -> AsyncIterator[Node]:
    """A node of the jazzy graph, which is entered."""
    async with graph:
        yield Node(graph, "n")


@pytest.fixture
def noetic(clock: SimulatedClock) -> MemoryGraph:
    """A noetic graph in simulated time, not entered."""
    return MemoryGraph(Registry(NOETIC), clock)


@pytest.fixture
def advance(clock: SimulatedClock) -> Advance:
    """Let time go by in small steps, with everything settled between them."""

    async def go(seconds: float) -> None:
        await anyio.wait_all_tasks_blocked()
        for _ in range(max(1, round(seconds / 0.05))):
            clock.advance(min(seconds, 0.05))
            await anyio.wait_all_tasks_blocked()

    return go
