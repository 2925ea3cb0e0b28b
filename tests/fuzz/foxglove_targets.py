"""Frames of clients of Foxglove's protocol, and the gateway behind them."""

from __future__ import annotations

import logging

from rwt.access.access import Access
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.settings.models import Settings
from rwt_graph import MemoryGraph, Node
from rwt_graph.clock import SimulatedClock
from rwt_interfaces.registry import Registry
from tests.extensions.foxglove.viewer import Viewer
from tests.fuzz.protocol_targets import no_internal_errors

_registry = Registry()


def foxglove(data: bytes) -> None:
    """Frames from two viewers of one gateway, with a topic, a service and parameters to hit; 0x1e ends a
    frame, and 0x1f too and changes the viewer. What begins with a brace is a text."""
    no_internal_errors(logging.getLogger("rwt.bridge"))
    clock = SimulatedClock(start_ns=1_700_000_000_000_000_000)
    graph = MemoryGraph(registry=_registry, clock=clock)
    gateway = FoxgloveGateway(graph, Access(graph, Settings()))
    with Node(graph, "robot") as node:
        node.advertise_service("/add", "example_interfaces/AddTwoInts", lambda request: {"sum": request.a})
        node.advertise("/t", "std_msgs/String", latch=True).publish({"data": "latched"})
        node.parameters.declare("p", 1.0)
        viewers = [Viewer(gateway), Viewer(gateway)]
        for turn, part in enumerate(data.split(b"\x1f")):
            for each in part.split(b"\x1e"):
                viewers[turn % 2].say_raw(each, binary=not each.startswith(b"{"))
                clock.advance(0.05)
    clock.advance(1.0)
    for viewer in viewers:
        viewer.heard()  # Each frame is one that a client can read.
        viewer.leave()
    assert gateway.clients == ()
    gateway.close()
