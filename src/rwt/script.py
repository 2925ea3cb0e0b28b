"""`rwt serve --script FILE`: a robot that does what a file says, for tests of apps."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

from rwt.graphs import make_graph
from rwt_cli.errors import CommandError
from rwt_graph.memory.graph import MemoryGraph

if TYPE_CHECKING:
    from rwt.settings.models import Settings
    from rwt.workers.worker import Seat
    from rwt_interfaces.registry import Registry
    from rwt_protocol.transport import Accept

Around = Callable[["Accept"], "Accept"]


def stage(
    script: Path | None, registry: Registry, settings: Settings, seat: Seat | None = None
) -> tuple[MemoryGraph, Callable[[ExitStack], Around | None]]:
    """The graph of a server, and what starts its script once that graph runs.

    Without a script it is a plain graph, nothing is started, and no code for tests is read.

    Returns:
        The graph; and a function that starts the robot, which the given stack closes, and returns what goes
        between the transports and the bridge. It raises :exc:`CommandError` for a script that is wrong.
    """
    if script is None:
        return make_graph(settings, registry, seat), lambda nodes: None
    if settings.graph != "memory":
        raise CommandError("--script needs a graph in memory, not --graph zenoh", exit_code=2)
    from rwt_testing.errors import ScriptError
    from rwt_testing.observed_graph import ObservedGraph
    from rwt_testing.script.control import ScriptControl
    from rwt_testing.wire.observed import ObservedWire

    graph = ObservedGraph(registry)
    wire = ObservedWire(graph, bson=settings.bson_only_mode)

    def start(nodes: ExitStack) -> Around:
        try:
            nodes.enter_context(closing(ScriptControl(graph, wire, script)))
        except ScriptError as error:
            raise CommandError(f"--script {error}", exit_code=2) from error
        return wire.around

    return graph, start
