"""Frames of clients of Foxglove's protocol, and the gateway behind them."""

from __future__ import annotations

import json
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


def conversations() -> list[bytes]:
    """First inputs: every message once."""
    ids = range(1, 40)
    texts: tuple[dict[str, object], ...] = (
        {"op": "subscribe", "subscriptions": [{"id": id, "channelId": id} for id in ids]},
        {"op": "unsubscribe", "subscriptionIds": [1, 2, 3]},
        {"op": "advertise", "channels": [
            {"id": 1, "topic": "/t", "encoding": "cdr", "schemaName": "std_msgs/msg/String"},
            {"id": 2, "topic": "/u", "encoding": "json", "schemaName": "geometry_msgs/Twist"},
        ]},
        {"op": "unadvertise", "channelIds": [1]},
        {"op": "getParameters", "parameterNames": ["/robot.p"], "id": "a"},
        {"op": "setParameters", "parameters": [{"name": "/robot.p", "value": 2, "type": "float64"}]},
        {"op": "subscribeParameterUpdates", "parameterNames": []},
        {"op": "unsubscribeParameterUpdates", "parameterNames": ["/robot.p"]},
        {"op": "subscribeConnectionGraph"},
        {"op": "unsubscribeConnectionGraph"},
        {"op": "fetchAsset", "uri": "package://a/b.stl", "requestId": 1},
    )  # fmt: skip
    said = [json.dumps(each).encode() for each in texts]
    hello = b"\x01\1\0\0\0" + bytes.fromhex("0001000006000000") + b"hello\0"
    twist = b"\x01\2\0\0\0" + b'{"linear":{"x":1}}'
    calls = [b"\x02" + bytes((id, 0, 0, 0, 1, 0, 0, 0, 4, 0, 0, 0)) + b'json{"a":1}' for id in (3, 9, 12)]
    control = b"\x03\0\0\0\x80\x3f\0" + bytes(8) + b"\1\0\0\0r"
    return [
        *said,
        control,
        b"\x1e".join((said[0], said[2], hello, twist, said[3], hello)),
        b"\x1f".join((said[6], said[5], said[8], said[2], hello)),
        b"\x1e".join(calls),
    ]
