"""A graph on simulated time, and the Foxglove gateway in front of it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from rwt import Settings
from rwt.access.access import Access
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.rosapi import DISCLOSURES
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.nodes.node import Node
from rwt_participant.handles import Publisher
from tests.conftest import START_NS
from tests.extensions.foxglove.viewer import Viewer

MakeGateway = Callable[..., FoxgloveGateway]


@pytest.fixture
def clock() -> SimulatedClock:
    return SimulatedClock(START_NS)


@pytest.fixture
def graph(clock: SimulatedClock) -> MemoryGraph:
    return MemoryGraph(clock=clock)


def gateway_of(graph: MemoryGraph, *, pages: Any = None, **settings: object) -> FoxgloveGateway:
    """Return a gateway in front of a graph, with settings by name."""
    access = Access(graph, Settings.model_validate(settings), DISCLOSURES)
    return FoxgloveGateway(graph, access, pages=pages)


@pytest.fixture
def make(graph: MemoryGraph) -> MakeGateway:
    """Makes a gateway in front of the graph."""
    return partial(gateway_of, graph)


@pytest.fixture
def talker(graph: MemoryGraph) -> Publisher:
    """Publisher of `/t`, which a viewer is told of on connecting if it is requested after this."""
    return Node(graph, "robot").advertise("/t", "std_msgs/String")


@pytest.fixture
def gateway(make: MakeGateway) -> FoxgloveGateway:
    return make()


@pytest.fixture
def viewer(gateway: FoxgloveGateway) -> Viewer:
    return Viewer(gateway)


GUEST = {"auth": {"default_role": "guest"}}


def guest(**globs: list[str]) -> dict[str, Any]:
    """Settings with one role for everybody."""
    return {**GUEST, "roles": {"guest": globs}}
