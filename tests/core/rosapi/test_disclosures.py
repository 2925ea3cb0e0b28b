"""Disclosures declared by rosapi and the parameter services, compared with their answers."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Mapping
from operator import attrgetter
from typing import Any

import pytest

from rwt.rosapi import DISCLOSURES as OF_ROSAPI
from rwt.rosapi import Rosapi
from rwt_graph import MemoryGraph, Node
from rwt_graph.disclosure import NOTHING, Disclosure, Lists, ListsProviders, Reads, Writes
from rwt_graph.nodes.logs import DISCLOSURES as OF_LOGGERS
from rwt_graph.parameters.services import DISCLOSURES as OF_PARAMETERS
from rwt_interfaces import Payload
from rwt_interfaces.structs import MessageType, ServiceType
from rwt_participant.errors import GoalAborted
from rwt_participant.goals import ReceivedGoal

pytestmark = pytest.mark.anyio

DECLARED: Mapping[str, Disclosure] = {**OF_ROSAPI, **OF_PARAMETERS, **OF_LOGGERS}
FIBONACCI = "example_interfaces/Fibonacci"
#: What is asked for, by the field of a request: things that a client may see.
REQUEST: Mapping[str, object] = {
    "topic": "/open/topic",
    "service": "/open/service",
    "action": "/open/action",
    "node": "/open/node",
    "name": "open_parameter",
    "names": ["open_parameter"],
}
#: The type that is asked about, by the end of the service's name.
TYPES = {
    "message_details": "std_msgs/String",
    "topics_for_type": "std_msgs/String",
    "service_request_details": "std_srvs/Trigger",
    "service_response_details": "std_srvs/Trigger",
    "services_for_type": "std_srvs/Trigger",
}


async def count(goal: ReceivedGoal) -> dict[str, object]:
    raise GoalAborted({}, "nobody sends goals here")


@pytest.fixture
async def graph() -> AsyncIterator[MemoryGraph]:
    """Of everything there is one called "open" and one called "secret"."""
    graph = MemoryGraph()
    async with graph:
        for word in ("open", "secret"):
            node = Node(graph, "node", f"/{word}")
            node.advertise("topic", "std_msgs/String")
            node.advertise_service("service", "std_srvs/Trigger", lambda _: {"success": True})
            node.advertise_action("action", FIBONACCI, count)
            node.parameters.declare(f"{word}_parameter", 1)
            node.parameters.declare(f"{word}_group.parameter", 1)
        with Rosapi(graph):
            yield graph


def declared_services(graph: MemoryGraph) -> dict[str, Disclosure]:
    """Each service of rosapi and of the open node's parameters, with its declaration."""
    asked = [each for each in graph.services() if each.name.startswith(("/rosapi/", "/open/node/"))]
    # One without a declaration is an error here: nobody has said what its answers reveal.
    return {each.name: DECLARED[each.type.name] for each in asked}


def type_of(graph: MemoryGraph, service: str) -> ServiceType:
    info = graph.service(service)
    assert info is not None
    return info.type


def fields_of(message: MessageType) -> set[str]:
    return {field.name for field in message.definition.fields}


async def answer(graph: MemoryGraph, service: str) -> Any:
    """The response to a request about what is open."""
    given = {**REQUEST, "type": TYPES.get(service.rpartition("/")[2], FIBONACCI)}
    asked = fields_of(type_of(graph, service).request) & given.keys()
    return await Node(graph, "client").call(service, {name: given[name] for name in asked})


async def test_every_service_declares_what_it_reveals(graph: MemoryGraph) -> None:
    services = declared_services(graph)
    own = {each.name for each in graph.services() if each.node == "/rosapi"}
    assert own <= services.keys() and len(own) >= 30
    in_nodes = graph.distro.parameters_belong_to_nodes
    assert (
        len(services.keys() & {f"/open/node/{name}_parameters" for name in ("get", "set", "list")})
        == 3 * in_nodes
    )


async def test_declared_fields_are_there(graph: MemoryGraph) -> None:
    for name, disclosure in declared_services(graph).items():
        asked, answered = fields_of(type_of(graph, name).request), fields_of(type_of(graph, name).response)
        for each in disclosure:
            if isinstance(each, Lists):
                assert {field.partition(".")[0] for field in each.fields} <= answered, name
            else:
                assert each.field in asked, name
            if isinstance(each, ListsProviders):
                assert each.lists in answered, name


async def test_services_that_declare_nothing_name_nothing_of_the_robot(graph: MemoryGraph) -> None:
    silent = [name for name, disclosure in declared_services(graph).items() if disclosure == NOTHING]
    assert "/rosapi/get_time" in silent
    for name in silent:
        text = as_text(graph, name, await answer(graph, name))
        assert "secret" not in text and "open" not in text, name


async def test_answers_about_what_is_open_name_the_rest_in_declared_fields_only(graph: MemoryGraph) -> None:
    named: set[str] = set()
    for name, disclosure in declared_services(graph).items():
        if any(isinstance(each, Writes) for each in disclosure):
            continue
        response = await answer(graph, name)
        text = as_text(graph, name, response)
        for listed in (each for each in disclosure if isinstance(each, Lists)):
            for field in listed.fields:
                shown = json.dumps(attrgetter(field)(response))
                named |= {name} if "secret" in shown else set()
                text = text.replace(shown, "")
        assert "secret" not in text, name
    assert {"/rosapi/topics", "/rosapi/services", "/rosapi/nodes", "/rosapi/action_servers"} <= named
    assert {"/rosapi/topics_for_type", "/rosapi/services_for_type", "/rosapi/get_param_names"} <= named


def as_text(graph: MemoryGraph, service: str, response: Any) -> str:
    """The response in JSON, as :func:`json.dumps` writes it."""
    return json.dumps(
        json.loads(bytes(Payload.from_value(type_of(graph, service).response, response).json()))
    )


async def test_services_that_are_asked_about_something_declare_it(graph: MemoryGraph) -> None:
    for name, disclosure in declared_services(graph).items():
        asked = fields_of(type_of(graph, name).request)
        if asked & REQUEST.keys():
            assert disclosure != NOTHING, name
        for field in asked & {"names", "parameters"}:
            assert any(isinstance(each, Reads | Writes) and each.field == field for each in disclosure), name
