"""Services of the graph for clients, and services of clients for the graph."""

from __future__ import annotations

import gc
import tracemalloc

import pytest

from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from tests.core.rosbridge.recording_client import Client

ADD = {"service": "/add_two_ints", "type": "example_interfaces/AddTwoInts"}


def _request(provider: Client) -> dict[str, object]:
    (request,) = provider.heard()
    assert request["op"] == "call_service"
    return request


@pytest.mark.parametrize("address", ["192.0.2.7", "127.0.0.1"])
def test_only_the_provider_may_answer_and_over_any_of_its_connections(
    bridge: Bridge, client: Client, other: Client, address: str
) -> None:
    other.say("advertise_service", **ADD)
    client.say("call_service", id="x", service="/add_two_ints")
    answer = {"service": "/add_two_ints", "id": _request(other)["id"], "values": {"sum": 9}, "result": True}
    another = Client(bridge, address)
    another.say("service_response", **{**answer, "service": "/other"})
    another.say("service_response", **{**answer, "id": "service_request:/add_two_ints:2"})
    another.say("unadvertise_service", service="/add_two_ints")
    assert client.heard() == []
    another.say("service_response", **answer)
    if address != "127.0.0.1":
        assert client.heard() == []
        other.say("service_response", **answer)
    (reply,) = client.heard()
    assert reply["values"] == {"sum": 9}


@pytest.mark.parametrize(
    ("first", "second", "takes"),
    [("operator", "operator", True), ("operator", "admin", False), ("operator", "watcher", False)],
)
def test_an_answer_over_another_connection_needs_the_same_role_which_may_provide(
    graph: MemoryGraph, first: str, second: str, takes: bool
) -> None:
    roles = {
        "operator": {"provide": ["/add_*"]},
        "watcher": {"subscribe": ["*"]},
        "driver": {"call": ["*"]},
    }
    tokens = {role: {"token": f"{role}-0123456789abcdef", "role": role} for role in (*roles, "admin")}
    bridge = Bridge(graph, Settings.model_validate({"roles": roles, "auth": {"tokens": tokens}}))

    def connect(role: str) -> Client:
        return Client(bridge, headers={"authorization": f"Bearer {role}-0123456789abcdef"})

    caller, provider, answering = connect("driver"), connect(first), connect(second)
    provider.say("advertise_service", **ADD)
    caller.say("call_service", id="x", service="/add_two_ints")
    answer = {
        "service": "/add_two_ints",
        "id": _request(provider)["id"],
        "values": {"sum": 9},
        "result": True,
    }
    answering.say("service_response", **answer)
    assert [reply["values"] for reply in caller.heard()] == ([{"sum": 9}] if takes else [])


def test_a_malformed_answer_ends_the_call_if_it_is_the_providers(
    bridge: Bridge, client: Client, other: Client
) -> None:
    other.say("advertise_service", **ADD)
    client.say("call_service", id="x", service="/add_two_ints")
    stranger = Client(bridge, "192.0.2.7")
    answer = {"service": "/add_two_ints", "id": _request(other)["id"], "result": "yes"}
    stranger.say("service_response", **answer)
    assert client.heard() == []
    other.say("service_response", **answer)
    (reply,) = client.heard()
    assert (reply["id"], reply["result"], "malformed" in reply["values"]) == ("x", False, True)


@pytest.mark.parametrize(("timeout", "after"), [({"timeout": 0.5}, 0.6), ({}, 6.5)])
def test_a_call_times_out(
    client: Client, other: Client, clock: SimulatedClock, timeout: dict[str, float], after: float
) -> None:
    other.say("advertise_service", **ADD)
    client.say("call_service", id="x", service="/add_two_ints", **timeout)
    request = _request(other)
    clock.advance(after / 2)
    assert client.heard() == []
    clock.advance(after / 2 + 0.1)
    (reply,) = client.heard()
    assert (reply["result"], reply["values"]) == (
        False,
        "Timeout exceeded while waiting for service response",
    )
    other.say("service_response", service="/add_two_ints", id=request["id"], values={"sum": 1}, result=True)
    assert client.heard() == []


def _held(before: int) -> float:
    """Megabytes more than before."""
    gc.collect()
    return (tracemalloc.get_traced_memory()[0] - before) / 1e6


@pytest.mark.parametrize("how", ["disconnects", "times out"])
def test_a_call_that_nobody_answers_is_forgotten_with_its_caller(
    graph: MemoryGraph, client: Client, other: Client, clock: SimulatedClock, how: str
) -> None:
    other.say("set_level", level="warning")
    other.say("advertise_service", service="/slow", type="rosapi_msgs/SetParam")
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(100):
            args = {"name": "/a", "value": "x" * 100_000}
            client.say("call_service", service="/slow", args=args, timeout=5)
            (asked,) = other.heard()
        assert _held(before) > 8
        if how == "disconnects":
            client.leave()
        else:
            clock.advance(10)
            assert len(client.heard()) == 100
        asked["args"].clear()
        assert _held(before) < 2
    finally:
        tracemalloc.stop()
    other.say("service_response", service="/slow", id=asked["id"], values={}, result=True)
    (status,) = other.heard()
    assert "waits under id" in status["msg"]
