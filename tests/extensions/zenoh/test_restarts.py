"""What a restarted graph offers over Zenoh comes back at every restart."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import anyio
import pytest

from rwt.extensions.zenoh import ZenohGraph
from rwt_graph.nodes.node import Node
from tests.waiting import until
from tests.zenoh_links import QUICK, free_endpoint

pytestmark = pytest.mark.anyio

RESTARTS: Final = 20


def _offer(graph: ZenohGraph, name: str) -> None:
    """One endpoint of each kind."""
    node = Node(graph, name)
    node.advertise("/out", "std_msgs/String")
    node.subscribe("/in", lambda _: None, "std_msgs/String")
    node.advertise_service("/fast", "std_srvs/Trigger", lambda _: {"success": True, "message": name})

    async def execute(goal: Any) -> None:
        await anyio.sleep_forever()

    node.advertise_action("/count", "example_interfaces/Fibonacci", execute)


def _is_back(graph: ZenohGraph, node: str) -> bool:
    out, heard, service = graph.topic("/out"), graph.topic("/in"), graph.service("/fast")
    return (
        out is not None
        and [each.node for each in out.publishers] == [node]
        and heard is not None
        and [each.node for each in heard.subscribers] == [node]
        and service is not None
        and service.node == node
        and graph.action("/count") is not None
    )


def _is_gone(graph: ZenohGraph) -> bool:
    return (graph.service("/fast"), graph.action("/count"), graph.topic("/out")) == (None, None, None)


async def test_every_kind_of_endpoint_comes_back() -> None:
    endpoint = free_endpoint()
    async with ZenohGraph(listen=[endpoint], config=QUICK) as graph:
        caller = Node(graph, "caller")
        for number in range(RESTARTS):
            name = ("first", "second")[number % 3 % 2]  # Also the same one twice in a row.
            async with ZenohGraph(connect=[endpoint], config=QUICK) as robot:
                _offer(robot, name)
                await until(partial(_is_back, graph, f"/{name}"))
                assert (await caller.call("/fast", {})).message == name
            await until(lambda: _is_gone(graph))
