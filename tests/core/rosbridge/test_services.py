"""Services of the graph for clients, and services of clients for the graph."""

from __future__ import annotations

import gc
import tracemalloc
from typing import Any

import pytest

from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_participant.errors import ServiceFailed
from tests.core.rosbridge.recording_client import Client

ADD = {"service": "/add_two_ints", "type": "example_interfaces/AddTwoInts"}


@pytest.fixture
def adder(graph: MemoryGraph) -> None:
    def add(request: Any) -> dict[str, object]:
        a, b = request.a, request.b
        if b < 0:
            raise ServiceFailed("b is negative")
        return {"sum": a + b}

    graph.node("adder").advertise_service("/add_two_ints", "example_interfaces/AddTwoInts", add)


@pytest.mark.usefixtures("adder")
class TestCalls:
    @pytest.mark.parametrize("call_id", ["call:1", 7, 0])
    def test_reply_has_the_callers_id(self, client: Client, call_id: str | int) -> None:
        client.say("call_service", id=call_id, service="/add_two_ints", args={"a": 1, "b": 2})
        assert client.heard() == [
            {
                "op": "service_response",
                "service": "/add_two_ints",
                "values": {"sum": 3},
                "result": True,
                "id": call_id,
            }
        ]

    def test_no_id_no_id(self, client: Client) -> None:
        client.say("call_service", service="/add_two_ints", args={"a": 1, "b": 2})
        (reply,) = client.heard()
        assert "id" not in reply

    @pytest.mark.parametrize(
        ("args", "total"),
        [([1, 2], 3), ([5], 5), ([1, 2, 3], 3), ({}, 0), (None, 0), ("text", 0), (4, 0), ({"b": 9}, 9)],
    )
    def test_arguments_by_name_and_by_position(self, client: Client, args: object, total: int) -> None:
        client.say("call_service", service="/add_two_ints", args=args)
        (reply,) = client.heard()
        assert reply["values"] == {"sum": total}

    def test_a_relative_name_is_echoed_as_written(self, client: Client) -> None:
        client.say("call_service", service="add_two_ints", args=[1, 2])
        (reply,) = client.heard()
        assert (reply["service"], reply["values"]) == ("add_two_ints", {"sum": 3})

    def test_the_legacy_suffix_is_the_id(self, client: Client) -> None:
        client.say("call_service", service="/add_two_ints#33", args=[1, 2])
        (reply,) = client.heard()
        assert (reply["service"], reply["id"]) == ("/add_two_ints#33", "33")

    def test_int64_is_exact(self, client: Client) -> None:
        client.say("call_service", service="/add_two_ints", args={"a": 2**62, "b": 2**62 - 1})
        (reply,) = client.heard()
        assert reply["values"]["sum"] == 2**63 - 1

    @pytest.mark.parametrize(
        ("args", "text"),
        [
            ({"c": 1}, 'has no field "c"'),
            ({"a": "one"}, 'call_service.args.a: expected int64, got "one"'),
            ({"a": 1.0}, "call_service.args.a"),
            ({"a": 2**63}, "call_service.args.a"),
        ],
    )
    def test_bad_arguments_are_told(self, client: Client, args: object, text: str) -> None:
        client.say("call_service", id="x", service="/add_two_ints", args=args)
        (reply,) = client.heard()
        assert (reply["result"], reply["id"]) == (False, "x")
        assert text in reply["values"]

    def test_a_failing_service_says_why(self, client: Client) -> None:
        client.say("call_service", id="x", service="/add_two_ints", args=[1, -1])
        (reply,) = client.heard()
        assert reply["result"] is False
        assert "b is negative" in reply["values"]

    def test_a_call_without_its_service_name_is_answered(self, client: Client) -> None:
        client.say("call_service", id="x")
        (reply,) = client.heard()
        assert (reply["op"], reply["id"], reply["result"]) == ("service_response", "x", False)


def test_unknown_service(client: Client) -> None:
    client.say("call_service", id="x", service="/nothing")
    assert client.heard() == [
        {
            "op": "service_response",
            "service": "/nothing",
            "values": "Service /nothing does not exist",
            "result": False,
            "id": "x",
        }
    ]


def _request(provider: Client) -> dict[str, object]:
    (request,) = provider.heard()
    assert request["op"] == "call_service"
    return request


def test_a_client_provides_a_service(client: Client, other: Client) -> None:
    other.say("advertise_service", **ADD)
    client.say("call_service", id="mine", service="/add_two_ints", args=[1, 2])
    request = _request(other)
    assert request == {
        "op": "call_service",
        "id": "service_request:/add_two_ints:1",
        "service": "/add_two_ints",
        "args": {"a": 1, "b": 2},
    }
    assert client.heard() == []
    other.say("service_response", service="/add_two_ints", id=request["id"], values={"sum": 3}, result=True)
    (reply,) = client.heard()
    assert (reply["id"], reply["values"], reply["result"]) == ("mine", {"sum": 3}, True)


def test_answers_come_in_any_order(client: Client, other: Client) -> None:
    other.say("advertise_service", **ADD)
    for number in range(3):
        client.say("call_service", id=number, service="/add_two_ints", args=[number, 0])
    for request in reversed(other.heard()):
        total = request["args"]["a"]
        other.say(
            "service_response", service=ADD["service"], id=request["id"], values={"sum": total}, result=True
        )
    assert [(reply["id"], reply["values"]["sum"]) for reply in client.heard()] == [(2, 2), (1, 1), (0, 0)]


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        ({"values": "out of fuel", "result": False}, "out of fuel"),
        ({"values": {"sum": 1}, "result": False}, '{"sum": 1}'),
        ({"result": False}, "gave no reason"),
        ({"values": {"total": 1}, "result": True}, 'has no field "total"'),
    ],
)
def test_a_providers_failure_ends_the_call(
    client: Client, other: Client, answer: dict[str, object], text: str
) -> None:
    other.say("advertise_service", **ADD)
    client.say("call_service", id="x", service="/add_two_ints")
    other.say("service_response", service="/add_two_ints", id=_request(other)["id"], **answer)
    (reply,) = client.heard()
    assert (reply["id"], reply["result"]) == ("x", False)
    assert text in reply["values"]


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


def test_a_malformed_answer_ends_the_call_that_it_names(client: Client, other: Client) -> None:
    other.say("advertise_service", **ADD)
    client.say("call_service", id="x", service="/add_two_ints")
    other.say("service_response", service="/add_two_ints", id=_request(other)["id"], values={}, result="yes")
    (reply,) = client.heard()
    assert (reply["id"], reply["result"]) == ("x", False)
    assert "malformed" in reply["values"]
    assert "result" in reply["values"]


def test_a_client_that_is_not_the_provider_ends_nothing_by_a_malformed_answer(
    bridge: Bridge, client: Client, other: Client
) -> None:
    other.say("advertise_service", **ADD)
    client.say("call_service", id="x", service="/add_two_ints")
    stranger = Client(bridge, "192.0.2.7")
    stranger.say("service_response", service="/add_two_ints", id=_request(other)["id"], result="yes")
    assert client.heard() == []


@pytest.mark.parametrize("how", ["leave", "unadvertise", "replace"])
def test_the_provider_goes_away_in_the_middle_of_a_call(
    graph: MemoryGraph, client: Client, other: Client, how: str
) -> None:
    other.say("advertise_service", **ADD)
    client.say("call_service", id="x", service="/add_two_ints")
    _request(other)
    if how == "leave":
        other.leave()
    elif how == "unadvertise":
        other.say("unadvertise_service", service="/add_two_ints")
    else:
        client.say("advertise_service", **ADD)
    (reply,) = client.heard()
    assert (reply["id"], reply["result"]) == ("x", False)
    assert "/add_two_ints" in reply["values"]
    assert (graph.service("/add_two_ints") is None) == (how != "replace")


def test_numbers_start_again_for_a_new_advertisement(client: Client, other: Client) -> None:
    for _ in range(2):
        other.say("advertise_service", **ADD)
        client.say("call_service", service="/add_two_ints")
        assert _request(other)["id"] == "service_request:/add_two_ints:1"
        other.say("unadvertise_service", service="/add_two_ints")


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


def test_a_timeout_of_zero_waits_for_ever(client: Client, other: Client, clock: SimulatedClock) -> None:
    other.say("advertise_service", **ADD)
    client.say("call_service", id="x", service="/add_two_ints", timeout=0)
    clock.advance(3600)
    other.say(
        "service_response", service=ADD["service"], id=_request(other)["id"], values={"sum": 1}, result=True
    )
    (reply,) = client.heard()
    assert reply["result"] is True


def test_a_caller_that_left_is_forgotten(client: Client, other: Client) -> None:
    other.say("advertise_service", **ADD)
    client.say("call_service", id="x", service="/add_two_ints")
    client.leave()
    other.say(
        "service_response", service=ADD["service"], id=_request(other)["id"], values={"sum": 1}, result=True
    )
    assert client.heard() == []


def test_a_client_may_call_its_own_service(client: Client) -> None:
    client.say("advertise_service", **ADD)
    client.say("call_service", id="x", service="/add_two_ints", args=[2, 2])
    request = _request(client)
    client.say("service_response", service=ADD["service"], id=request["id"], values={"sum": 4}, result=True)
    (reply,) = client.heard()
    assert reply["values"] == {"sum": 4}


def test_an_empty_response_is_an_empty_object(client: Client, graph: MemoryGraph) -> None:
    graph.node("n").advertise_service("/nop", "std_srvs/Empty", lambda _: {})
    client.say("call_service", service="/nop")
    (reply,) = client.heard()
    assert reply["values"] == {}


def test_a_python_program_calls_a_clients_service(graph: MemoryGraph, client: Client) -> None:
    client.say("advertise_service", service="/greet", type="std_srvs/Trigger")
    outcomes: list[object] = []
    info = graph.service("/greet")
    assert info is not None
    from rwt_interfaces.payload import Payload

    request = Payload.from_json(info.type.request, b"{}")
    graph.participant("/caller").call_service("/greet", request, outcomes.append, 1.0)
    client.say(
        "service_response",
        service="/greet",
        id=_request(client)["id"],
        values={"success": True, "message": "hi"},
        result=True,
    )
    (outcome,) = outcomes
    assert isinstance(outcome, Payload)
    assert bytes(outcome.json()) == b'{"success": true, "message": "hi"}'


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
