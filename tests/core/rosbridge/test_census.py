"""/client_count and /connected_clients."""

from __future__ import annotations

import pytest

from rwt.rosbridge.bridge import Bridge
from rwt_graph.api import Sample
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from tests.core.rosbridge.recording_client import Client


def test_before_the_first_client_there_are_none(bridge: Bridge, graph: MemoryGraph) -> None:
    seen: list[Sample] = []
    participant = graph.participant("/late")
    participant.subscribe("/client_count", seen.append)
    participant.subscribe("/connected_clients", seen.append)
    assert [bytes(sample.payload.json()) for sample in seen] == [b'{"data":0}', b'{"clients":[]}']


@pytest.mark.parametrize("graph", ["jazzy", "noetic"], indirect=True)
def test_connected_clients_have_an_address_and_a_time(
    bridge: Bridge, clock: SimulatedClock, graph: MemoryGraph
) -> None:
    seconds, nanoseconds = graph.distro.time_fields
    client = Client(bridge, address="10.0.0.1")
    client.say("subscribe", topic="/connected_clients")
    client.heard()
    clock.advance(2.5)
    second = Client(bridge, address="10.0.0.2")
    clock.advance(0)
    start = 1_700_000_000
    first_entry = {"ip_address": "10.0.0.1", "connection_time": {seconds: start, nanoseconds: 0}}
    second_entry = {
        "ip_address": "10.0.0.2", "connection_time": {seconds: start + 2, nanoseconds: 500_000_000},
    }  # fmt: skip
    heard = client.heard_of("/connected_clients")
    assert heard[-1] == {"clients": [first_entry, second_entry]}
    second.leave()
    clock.advance(0)
    assert client.heard_of("/connected_clients") == [{"clients": [first_entry]}]


def test_clients_that_come_together_are_told_of_together(bridge: Bridge, clock: SimulatedClock) -> None:
    client = Client(bridge)
    clock.advance(0)
    client.say("subscribe", topic="/connected_clients")
    client.heard()
    for _ in range(50):
        Client(bridge)
    clock.advance(0)
    (message,) = client.heard_of("/connected_clients")
    assert len(message["clients"]) == 51
