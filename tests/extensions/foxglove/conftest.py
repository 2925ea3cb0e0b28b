"""A graph on simulated time, and the Foxglove gateway in front of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from rwt import Settings
from rwt.access.access import Access
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.rosapi import DISCLOSURES
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from tests.conftest import START_NS
from tests.extensions.foxglove.viewer import Viewer

MakeGateway = Callable[..., FoxgloveGateway]


@pytest.fixture
def clock() -> SimulatedClock:
    return SimulatedClock(START_NS)


@pytest.fixture
def graph(clock: SimulatedClock) -> MemoryGraph:
    return MemoryGraph(clock=clock)


@pytest.fixture
def make(graph: MemoryGraph) -> MakeGateway:
    """Makes a gateway in front of the graph, with settings by name."""

    def make(*, pages: Any = None, **settings: object) -> FoxgloveGateway:
        given = Settings.model_validate(settings)
        access = Access(graph, given, DISCLOSURES)
        return FoxgloveGateway(graph, access, pages=pages)

    return make


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
