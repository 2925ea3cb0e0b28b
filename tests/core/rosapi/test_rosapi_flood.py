"""Listings of the graph are made once for each change of it, so that a flood of questions costs little."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import pytest

from rwt import Settings
from rwt.access.access import Access
from rwt.rosapi import DISCLOSURES, Rosapi
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph, Node
from tests.call_counts import count_calls
from tests.core.rosbridge.recording_client import Client

LISTINGS = ("topics", "topics_and_raw_types", "services", "nodes", "action_servers")
ROLES: Mapping[str, Mapping[str, object]] = {
    "viewer": {"auth": {"default_role": "viewer"}},
    "admin": {},
    "guest": {"auth": {"default_role": "guest"}, "roles": {"guest": {"subscribe": ["/n1*"]}}},
}


def _client(nodes: int, role: str) -> Client:
    graph = MemoryGraph()
    Rosapi(graph)
    for number in range(nodes):
        node = Node(graph, f"n{number}")
        node.advertise(f"/n{number}/out", "std_msgs/String")
        node.subscribe(f"/n{number}/in", lambda _: None, "std_msgs/String")
    settings = Settings.model_validate(ROLES[role])
    return Client(Bridge(graph, settings, Access(graph, settings, DISCLOSURES)))


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("listing", LISTINGS)
def test_a_listing_that_was_asked_for_before_costs_no_more_in_a_large_graph(listing: str, role: str) -> None:
    costs: list[int] = []
    for nodes in (2, 100):
        client = _client(nodes, role)
        ask = partial(client.say, "call_service", service=f"/rosapi/{listing}")
        ask()
        answer = client.heard()
        costs.append(count_calls(ask))
        assert client.heard() == answer
        assert answer[0]["result"] is True
    assert costs[1] <= costs[0] * 1.2 + 20


@pytest.mark.parametrize("listing", LISTINGS)
def test_the_first_listing_after_a_change_grows_with_the_graph_and_no_faster(listing: str) -> None:
    costs: list[int] = []
    for nodes in (50, 200):
        _client(nodes, "viewer").say("call_service", service=f"/rosapi/{listing}")  # compiles the types
        ask = partial(_client(nodes, "viewer").say, "call_service", service=f"/rosapi/{listing}")
        costs.append(count_calls(ask))
    assert costs[1] < costs[0] * 5
