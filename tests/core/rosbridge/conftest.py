"""A bridge in front of an in-memory graph on a simulated clock; clients are sinks that keep what they get."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from tests.core.rosbridge.recording_client import Client


@pytest.fixture
def clock() -> SimulatedClock:
    return SimulatedClock(start_ns=1_700_000_000_000_000_000)


@pytest.fixture(params=["jazzy"])
def graph(request: pytest.FixtureRequest, clock: SimulatedClock) -> MemoryGraph:
    return MemoryGraph(registry=Registry(DISTROS[request.param]), clock=clock)


@pytest.fixture
def bridge(graph: MemoryGraph) -> Bridge:
    return Bridge(graph, Settings())


@pytest.fixture
def connect(bridge: Bridge) -> Callable[[], Client]:
    return lambda: Client(bridge)


@pytest.fixture
def client(bridge: Bridge) -> Client:
    return Client(bridge)


@pytest.fixture
def other(bridge: Bridge) -> Client:
    return Client(bridge)
