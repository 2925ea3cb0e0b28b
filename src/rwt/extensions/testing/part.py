"""Declaration of robots scripted in a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from pathlib import Path

from rwt.access.settings import SettingsError
from rwt.declarations import ScriptPart
from rwt_graph.api import Graph
from rwt_graph.clock import Clock
from rwt_interfaces.registry import Registry
from rwt_transports.endpoint import Accept


def _make_graph(registry: Registry, clock: Clock | None, only: Sequence[str]) -> Graph:
    from rwt.extensions.testing.journal import ObservedGraph

    return ObservedGraph(registry, clock, only=tuple(only))


def _start(graph: Graph, file: Path, bson: bool, stack: ExitStack) -> Callable[[Accept], Accept]:
    """Start the scripted robot of a file, until `stack` is closed.

    Raises:
        SettingsError: the script is invalid, or the graph does not record messages.
    """
    from rwt.extensions.testing.errors import ScriptError
    from rwt.extensions.testing.journal import ObservedGraph
    from rwt.extensions.testing.script.control import ScriptControl
    from rwt.extensions.testing.wire.observed import ObservedWire

    if not isinstance(graph, ObservedGraph):
        raise SettingsError(
            "script: needs a graph in memory that notes its messages: leave out the setting `graph`, or give"
            " `graph=rwt.extensions.testing.ObservedGraph`"
        )
    wire = ObservedWire(graph, bson=bson)
    try:
        stack.enter_context(closing(ScriptControl(graph, wire, file)))
    except ScriptError as error:
        raise SettingsError(f"script: {error}") from error
    return wire.middleware


PART = ScriptPart(summary="robots scripted in a file, for tests", make_graph=_make_graph, start=_start)
