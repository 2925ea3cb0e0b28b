"""Services: what a client is told of them, calls in each encoding, and calls that fail."""

from __future__ import annotations

import struct
from typing import Any

import pytest

from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt_graph import MemoryGraph, Node
from rwt_graph.clock import SimulatedClock
from tests.extensions.foxglove.conftest import MakeGateway, guest
from tests.extensions.foxglove.viewer import Response, Viewer

CDR = bytes.fromhex("00010000")


@pytest.fixture
def adder(graph: MemoryGraph) -> Node:
    node = Node(graph, "robot")
    node.advertise_service("/add", "example_interfaces/AddTwoInts", lambda asked: {"sum": asked.a + asked.b})
    return node


@pytest.fixture
def caller(adder: Node, gateway: FoxgloveGateway) -> Viewer:
    viewer = Viewer(gateway)
    return viewer


def failure(viewer: Viewer) -> str:
    """Why the one call has failed."""
    (said,) = viewer.heard()
    assert said["op"] == "serviceCallFailure"
    assert said["callId"] == 1
    return str(said["message"])


def test_a_service_describes_both_of_its_messages(caller: Viewer) -> None:
    service = caller.services["/add"]
    assert service == {
        "id": service["id"],
        "name": "/add",
        "type": "example_interfaces/srv/AddTwoInts",
        "request": {
            "encoding": "cdr",
            "schemaName": "example_interfaces/srv/AddTwoInts_Request",
            "schemaEncoding": "ros2msg",
            "schema": "int64 a\nint64 b\n",
        },
        "response": {
            "encoding": "cdr",
            "schemaName": "example_interfaces/srv/AddTwoInts_Response",
            "schemaEncoding": "ros2msg",
            "schema": "int64 sum\n",
        },
    }


@pytest.mark.parametrize(
    ("encoding", "request_", "response"),
    [
        ("cdr", CDR + struct.pack("<qq", 2, 3), CDR + struct.pack("<q", 5)),
        ("json", b'{"a":2,"b":3}', b'{"sum":5}'),
        ("json", b"{}", b'{"sum":0}'),
    ],
)
def test_a_call_is_answered_in_its_own_encoding(
    caller: Viewer, encoding: str, request_: bytes, response: bytes
) -> None:
    caller.call("/add", request_, encoding, id=77)
    assert caller.heard() == [Response(caller.services["/add"]["id"], 77, encoding, response)]


@pytest.mark.parametrize(
    ("service", "payload", "encoding", "words"),
    [
        (4_000_000_000, b"{}", "json", "there is no service 4000000000"),
        ("/add", b"{}", "protobuf", "encoding 'protobuf': expected cdr or json"),
        ("/add", b"{", "json", "the request for /add: not valid JSON"),
        ("/add", b'{"a":"x"}', "json", "a: expected int64"),
        ("/add", b"\0", "cdr", "the request for /add: data cut short"),
        ("/add", b'{"a":' + b"[" * 70_000, "json", "the request for /add: nested too deeply"),
    ],
)
def test_a_call_that_is_not_possible_fails(
    caller: Viewer, service: Any, payload: bytes, encoding: str, words: str
) -> None:
    caller.call(service, payload, encoding)
    assert words in failure(caller)
    assert caller.client.graph.calls_in_flight == 0
    assert caller.client.graph.kept_bytes == 0


def test_a_service_that_fails_or_goes_says_so(graph: MemoryGraph, gateway: FoxgloveGateway) -> None:
    calls: list[Any] = []
    robot = graph.participant("/robot")
    robot.advertise_service("/slow", graph.registry.service("std_srvs/Trigger"), calls.append)
    viewer = Viewer(gateway)
    viewer.call("/slow", b"{}")
    calls[0].fail("the arm is stuck")
    assert failure(viewer) == "the arm is stuck"
    viewer.call("/slow", b"{}")
    robot.close()
    assert "/slow" in failure(viewer)
    viewer.call("/slow", b"{}")
    assert "/slow" in failure(viewer)


def test_a_call_without_an_answer_ends(
    graph: MemoryGraph, gateway: FoxgloveGateway, clock: SimulatedClock
) -> None:
    type = graph.registry.service("std_srvs/Trigger")
    graph.participant("/robot").advertise_service("/never", type, lambda call: None)
    viewer = Viewer(gateway)
    viewer.call("/never", b"{}")
    clock.advance(4.9)
    assert not [each for each in viewer.heard() if isinstance(each, dict)]
    clock.advance(0.2)
    (said,) = [each for each in viewer.heard() if isinstance(each, dict)]
    assert said["op"] == "serviceCallFailure"


def test_rights_and_bounds_hold_for_calls(graph: MemoryGraph, adder: Node, make: MakeGateway) -> None:
    gateway = make(**guest(call=["/add"]), limits={"calls": 1})
    type = graph.registry.service("std_srvs/Trigger")
    graph.participant("/robot").advertise_service("/secret", type, lambda call: None)
    viewer = Viewer(gateway)
    assert set(viewer.services) == {"/add"}
    answers: list[Any] = []
    for id in range(1, 50):
        viewer.call(id, b"{}")
        answers += viewer.heard()
    assert sum(isinstance(each, Response) for each in answers) == 1
    assert "secret" not in str(answers)
    gateway = make(limits={"calls": 1})
    viewer = Viewer(gateway)
    viewer.call("/secret", b"{}")
    viewer.call("/secret", b"{}")
    assert "limits.calls" in failure(viewer)


def test_an_answer_that_is_too_large_fails_the_call(graph: MemoryGraph, gateway: FoxgloveGateway) -> None:
    Node(graph, "robot").advertise_service(
        "/s", "std_srvs/Trigger", lambda _: {"success": True, "message": "x" * 1000}
    )
    viewer = Viewer(gateway)
    viewer.client.replies.max_bytes = 500
    viewer.call("/s", b"{}")
    assert "limits.outgoing_message_bytes" in failure(viewer)
