"""A scripted robot on virtual time, in the test's own event loop."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt.extensions.testing import ObservedGraph, ObservedWire
from rwt.extensions.testing.script.control import ScriptControl
from rwt_graph import SimulatedClock
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry


def play(graph: ObservedGraph, file: Path, text: str) -> ScriptControl:
    """Play a script on a graph."""
    file.write_text(text)
    return ScriptControl(graph, ObservedWire(graph), file)


@pytest.fixture
def clock() -> SimulatedClock:
    return SimulatedClock(1_700_000_000_000_000_000)


@pytest.fixture(params=["jazzy"])
def graph(request: pytest.FixtureRequest, clock: SimulatedClock) -> ObservedGraph:
    """Not entered."""
    return ObservedGraph(Registry(DISTROS[request.param]), clock)
