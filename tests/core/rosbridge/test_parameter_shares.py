"""Parameters are kept on the account of the client that set them, until they are deleted or set anew."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from typing import Any

import anyio
import pytest

from rwt import Settings
from rwt.access.access import Access
from rwt.rosapi import DISCLOSURES, Rosapi
from rwt.rosbridge import Bridge
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.nodes.node import Node
from tests.core.rosbridge.recording_client import Client

SHARE = 4096
LONG = "x" * 1000
REFUSED = "(limits.parameter_bytes)"

pytestmark = pytest.mark.anyio


@pytest.fixture
async def graph() -> AsyncIterator[MemoryGraph]:
    """A running robot with rosapi and a node that has parameters."""
    async with MemoryGraph(clock=SimulatedClock()) as graph:
        Rosapi(graph)
        node = Node(graph, "arm")
        for name in "abcdefgh":
            node.parameters.declare(name, "")
        yield graph


@pytest.fixture
def bridge(graph: MemoryGraph) -> Bridge:
    settings = Settings.model_validate({"limits": {"parameter_bytes": SHARE}})
    return Bridge(graph, settings, Access(graph, settings, DISCLOSURES))


async def _ask(client: Client, service: str, **args: object) -> dict[str, Any]:
    client.say("call_service", service=f"/rosapi/{service}", id="q", args=args)
    while True:
        await anyio.lowlevel.checkpoint()
        for message in client.heard():
            assert message["op"] == "service_response"
            return message


async def _set(client: Client, name: str, value: object = LONG) -> str:
    """Set a parameter; why not, if it was refused."""
    answer = await _ask(client, "set_param", name=name, value=json.dumps(value))
    if not answer["result"]:
        return str(answer["values"])
    return str(answer["values"].get("reason", ""))


def _client(bridge: Bridge, address: str = "192.0.2.1") -> Client:
    return Client(bridge, address)


async def test_a_client_has_a_share_of_the_tree(bridge: Bridge) -> None:
    one, other = _client(bridge), _client(bridge, "192.0.2.2")
    assert [await _set(one, f"/one/{number}") for number in range(2)] == ["", ""]
    assert REFUSED in await _set(one, "/one/2")
    assert [await _set(other, f"/other/{number}") for number in range(2)] == ["", ""]


async def test_what_is_set_anew_or_deleted_is_given_back(bridge: Bridge) -> None:
    client = _client(bridge)
    for number in range(10):
        assert await _set(client, "/same", f"{number}{LONG}{LONG}") == ""
    assert REFUSED in await _set(client, "/more", LONG * 2)
    assert (await _ask(client, "delete_param", name="/same"))["result"]
    assert await _set(client, "/more", LONG * 2) == ""
    assert await _set(_client(bridge, "192.0.2.2"), "/more", "") == ""
    assert await _set(client, "/again", LONG * 2) == ""


async def test_a_branch_takes_the_charges_below_it_with_it(bridge: Bridge) -> None:
    client = _client(bridge)
    for _ in range(5):
        assert await _set(client, "/branch/a/b") == ""
        assert await _set(client, "/branch/c") == ""
        assert REFUSED in await _set(client, "/other")
        assert await _set(client, "/branch", {"d": 1}) == ""
        assert await _set(client, "/branch/d/e") == ""
        assert (await _ask(client, "delete_param", name="/branch"))["result"]


async def test_what_a_client_leaves_behind_stays_on_its_address(bridge: Bridge) -> None:
    for which in range(2):
        client = _client(bridge)
        assert [await _set(client, f"/left{which}/{number}") for number in range(2)] == ["", ""]
        client.leave()
    client = _client(bridge)
    assert REFUSED in await _set(client, "/third", LONG * 2)
    assert (await _ask(client, "delete_param", name="/left0"))["result"]
    assert await _set(client, "/third", LONG * 2) == ""
    assert await _set(_client(bridge, "192.0.2.2"), "/elsewhere") == ""


async def test_parameters_of_nodes_are_charged_too(bridge: Bridge, graph: MemoryGraph) -> None:
    client = _client(bridge)
    name = "/arm:{}" if graph.distro.parameters_belong_to_nodes else "/arm/{}"
    refusals = [await _set(client, name.format(letter)) for letter in "abcdefgh"]
    assert 2 <= refusals.count("") <= 4
    assert REFUSED in refusals[-1]
    assert await _set(client, name.format("a"), "") == ""
    assert await _set(client, name.format("h")) == ""


async def test_a_node_sets_what_it_likes(bridge: Bridge, graph: MemoryGraph) -> None:
    node = Node(graph, "robot")
    client = _client(bridge)
    for number in range(10):
        await node.params.set(f"/own/{number}", LONG)
    assert await _set(client, "/own/3") == ""
