"""A scripted robot on virtual time, in the test's own event loop."""

from __future__ import annotations

import pytest

from rwt.extensions.testing import ObservedGraph
from rwt_graph import SimulatedClock
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry


@pytest.fixture
def clock() -> SimulatedClock:
    return SimulatedClock(1_700_000_000_000_000_000)


@pytest.fixture(params=["jazzy"])
def graph(request: pytest.FixtureRequest, clock: SimulatedClock) -> ObservedGraph:
    """Not entered."""
    return ObservedGraph(Registry(DISTROS[request.param]), clock)
