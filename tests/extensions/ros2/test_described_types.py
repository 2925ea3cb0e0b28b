"""Messages that nodes describe, and the inquiries that ask them. Without ROS 2."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from rwt.extensions.ros2 import inquiries
from rwt.extensions.ros2.inquiries import PATIENCE_SECONDS, Inquiries
from rwt.extensions.ros2.type_supports.described_types import DescribedTypes
from rwt_graph.backend import NodeResources
from rwt_graph.clock import SimulatedClock
from rwt_interfaces.definitions.hashes import description
from rwt_interfaces.errors import DefinitionError
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.errors import CallTimeout

PLANT = "string name\nint8 size 3\nint8 LARGE=7\ngeometry_msgs/Point place\n"


def robot(plant: str = PLANT, point: str = "") -> Registry:
    registry = Registry()
    registry.add_text(plant, "garden_msgs/Plant")
    if point:
        registry.add_text(point, "geometry_msgs/Point")
    return registry


def hash_of(registry: Registry) -> str:
    return registry.message("garden_msgs/Plant").rihs01


def response(registry: Registry, sources: str | None = None, **further: object) -> Payload:
    """Answer of a node about garden_msgs/Plant."""
    message = registry.message("garden_msgs/Plant")
    described = description(message.definition, registry)
    text = message.definition.text if sources is None else sources
    value = {
        "successful": True,
        "type_description": described,
        "type_sources": [
            {"type_name": "garden_msgs/msg/Plant", "encoding": "msg", "raw_file_contents": text}
        ],
        **further,
    }
    service = registry.service("type_description_interfaces/GetTypeDescription")
    return Payload.from_value(service.response, value)


def add(types: DescribedTypes, registry: Registry, sources: str | None = None, type_hash: str = "") -> None:
    answer: Any = response(registry, sources).value()
    types.add(
        "garden_msgs/msg/Plant", type_hash or hash_of(registry), answer.type_description, answer.type_sources
    )


def test_an_unknown_message_joins_the_registry_with_its_constants_and_defaults() -> None:
    registry, theirs = Registry(), robot()
    types = DescribedTypes(registry)
    assert types.message("garden_msgs/msg/Plant", hash_of(theirs)) is None
    add(types, theirs)
    assert types.message("garden_msgs/msg/Plant", hash_of(theirs)) is registry.message("garden_msgs/Plant")
    assert registry.definition("garden_msgs/Plant") == theirs.definition("garden_msgs/Plant")
    assert registry.message("garden_msgs/Plant") in (types.message("garden_msgs/msg/Plant", ""),)


@pytest.mark.parametrize("sources", ["string other\n", "not a definition at all", "#" * 2_000_000])
def test_a_file_that_does_not_fit_is_not_used(sources: str) -> None:
    registry, theirs = Registry(), robot()
    types = DescribedTypes(registry)
    add(types, theirs, sources)
    assert hash_of(registry) == hash_of(theirs)
    assert registry.definition("garden_msgs/Plant").constants == ()


def test_a_description_with_another_hash_is_rejected() -> None:
    registry = Registry()
    types = DescribedTypes(registry)
    with pytest.raises(DefinitionError, match="has the hash RIHS01_"):
        add(types, robot(), type_hash=f"RIHS01_{'0' * 64}")
    assert registry.known_definition("garden_msgs/Plant") is None


@pytest.mark.parametrize("known", ["string name\n", ""])
def test_a_description_that_contradicts_the_registry_is_beside_it(known: str) -> None:
    registry = robot(known) if known else Registry()
    theirs = robot(point="" if known else "float64 x\n")
    types = DescribedTypes(registry)
    add(types, theirs)
    found = types.message("garden_msgs/msg/Plant", hash_of(theirs))
    assert found is not None
    assert found.rihs01 == hash_of(theirs)
    assert found.registry is not registry
    assert registry.message("geometry_msgs/Point").rihs01 == Registry().message("geometry_msgs/Point").rihs01


def test_descriptions_are_limited() -> None:
    types = DescribedTypes(Registry())
    with pytest.raises(DefinitionError, match="the limits are 1000 and 60000"):
        add(types, robot("".join(f"int8 field_{number}\n" for number in range(1000))))


# -- inquiries ---------------------------------------------------------------------------------------------


class Services:
    """Services of a robot; `asked` are nodes with the functions that answer."""

    def __init__(self) -> None:
        self.offered: set[str] = set()
        self.asked: list[tuple[str, Callable[[Any], None]]] = []
        self.forgotten: list[str] = []

    def info(self, name: str) -> object:
        return name if name in self.offered else None

    def call(
        self, name: str, request: Payload, on_reply: Callable[[Any], None], timeout: float, owner: object
    ) -> None:
        self.asked.append((name, on_reply))

    def forget_client(self, owner: object, name: str) -> None:
        self.forgotten.append(name)


class Asking:
    """Inquiries about garden_msgs/Plant, of a robot that defines it."""

    def __init__(self) -> None:
        self.registry, self.theirs, self.clock = Registry(), robot(), SimulatedClock()
        self.services, self.ends = Services(), 0
        self.types = DescribedTypes(self.registry)
        services: Any = self.services
        self.inquiries = Inquiries(self.types, services, self.registry, self.clock, self._on_end)
        self.inquiries.open(NodeResources("/bridge", private=True))

    def _on_end(self) -> None:
        self.ends += 1

    def ask(self, node: str) -> None:
        self.inquiries.ask("garden_msgs/msg/Plant", hash_of(self.theirs), node)
        self.inquiries.follow()

    @property
    def reason(self) -> str:
        return self.inquiries.reason("garden_msgs/msg/Plant", hash_of(self.theirs))


def test_a_node_is_asked_when_its_service_is_known() -> None:
    asking = Asking()
    asking.ask("/robot")
    assert not asking.services.asked
    asking.services.offered.add("/robot/get_type_description")
    for _ in range(3):
        asking.inquiries.follow()
    ((name, answer),) = asking.services.asked
    assert (name, asking.reason) == ("/robot/get_type_description", "")
    answer(response(asking.theirs))
    assert (asking.ends, asking.reason, asking.services.forgotten) == (1, "", [name])
    assert hash_of(asking.registry) == hash_of(asking.theirs)
    asking.ask("/other")
    assert len(asking.services.asked) == 1


def test_the_next_node_is_asked_if_one_does_not_describe_the_type() -> None:
    asking = Asking()
    asking.services.offered |= {f"/{each}/get_type_description" for each in "abc"}
    for each in "abc":
        asking.ask(f"/{each}")
    asking.services.asked[0][1](CallTimeout("no answer"))
    asking.services.asked[1][1](response(asking.theirs, successful=False, failure_reason="not in use"))
    assert (len(asking.services.asked), asking.ends) == (3, 0)
    asking.services.asked[2][1](response(asking.theirs))
    assert (asking.ends, asking.reason) == (1, "")


def test_an_inquiry_without_an_answer_ends_with_the_reason_of_the_last_one() -> None:
    asking = Asking()
    asking.services.offered.add("/a/get_type_description")
    asking.ask("/a")
    asking.services.asked[0][1](response(robot("int8 x\n")))
    asking.clock.advance(PATIENCE_SECONDS + 1)
    assert asking.ends == 1
    assert asking.reason.startswith("/a does not describe it: its description has the hash RIHS01_")
    # A node that comes later is asked again.
    asking.ask("/a")
    assert (len(asking.services.asked), asking.reason) == (2, "")


def test_a_type_that_no_node_can_describe_has_its_reason_at_once() -> None:
    asking = Asking()
    asking.inquiries.ask("garden_msgs/msg/Plant", "", "/humble")
    assert "announces no type hash" in asking.inquiries.reason("garden_msgs/msg/Plant", "")
    asking.inquiries.ask("garden_msgs/action/Grow_FeedbackMessage", "RIHS01_1", "/robot")
    found = asking.inquiries.reason("garden_msgs/action/Grow_FeedbackMessage", "RIHS01_1")
    assert found == "ROS 2 describes no actions to others"
    asking.clock.advance(60)
    assert not asking.services.asked


def test_questions_that_are_open_at_once_are_limited() -> None:
    asking = Asking()
    for number in range(50):
        asking.services.offered.add(f"/n{number}/get_type_description")
        asking.inquiries.ask(f"garden_msgs/msg/T{number}", "RIHS01_1", f"/n{number}")
    asking.inquiries.follow()
    assert len(asking.services.asked) == inquiries.MOST_OPEN
    for _ in range(100):
        for _, answer in asking.services.asked[:]:
            answer(CallTimeout("no answer"))
        if len(asking.services.asked) >= 50:
            break
    assert len({name for name, _ in asking.services.asked}) == 50
