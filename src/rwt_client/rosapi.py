"""Queries of rosapi as methods, with frozen dataclasses as results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain, repeat
from typing import Any, TypeVar

import msgspec

from rwt_interfaces.times import NANOSECONDS
from rwt_participant.api import Listed
from rwt_participant.errors import ServiceFailed
from rwt_participant.rosapi_parameters import Ask

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class NodeDetails:
    """Node with its subscriptions, publications and services."""

    name: str
    subscribing: tuple[str, ...]
    publishing: tuple[str, ...]
    services: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RosVersion:
    """Version of ROS, 1 or 2, and the distribution, for example ``jazzy``."""

    version: int = 0
    distro: str = ""


@dataclass(frozen=True, slots=True)
class FieldInfo:
    """Field of a message.

    Attributes:
        type: name in rosapi, for example ``double`` or ``geometry_msgs/Point``.
        array_length: -1 for a single value, 0 for an array of any length, else the length.
        example: default value as text.
    """

    name: str
    type: str
    array_length: int
    example: str


@dataclass(frozen=True, slots=True)
class TypeInfo:
    """Message type: its fields, and its constants by name."""

    name: str
    fields: tuple[FieldInfo, ...]
    constants: tuple[tuple[str, str], ...]


class RosApi:
    """Queries of rosapi. Every method raises :exc:`~rwt_participant.errors.CallFailed`."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    async def topics(self) -> tuple[Listed, ...]:
        """Return all topics with their types."""
        answer = await self._answer("topics", {}, dict[str, list[str]])
        pairs = zip(answer.get("topics", ()), answer.get("types", ()), strict=False)
        return tuple(Listed(name, kind) for name, kind in pairs)

    async def topics_for_type(self, type_name: str) -> tuple[str, ...]:
        """Return the topics of one type."""
        return await self._names("topics_for_type", "topics", type=type_name)

    async def topic_type(self, topic: str) -> str:
        """Return the type of a topic; empty if it does not exist."""
        return await self._text("topic_type", "type", topic=topic)

    async def publishers(self, topic: str) -> tuple[str, ...]:
        """Return the nodes that publish on a topic."""
        return await self._names("publishers", "publishers", topic=topic)

    async def subscribers(self, topic: str) -> tuple[str, ...]:
        """Return the nodes that subscribe to a topic."""
        return await self._names("subscribers", "subscribers", topic=topic)

    async def nodes(self) -> tuple[str, ...]:
        """Return all nodes."""
        return await self._names("nodes", "nodes")

    async def node(self, name: str) -> NodeDetails:
        """Return the topics and services of a node."""
        answer = await self._answer("node_details", {"node": name}, dict[str, Any])
        parts = (_strings(answer.get(key)) for key in ("subscribing", "publishing", "services"))
        return NodeDetails(name, *parts)

    async def services(self) -> tuple[str, ...]:
        """Return all services."""
        return await self._names("services", "services")

    async def services_for_type(self, type_name: str) -> tuple[str, ...]:
        """Return the services of one type."""
        return await self._names("services_for_type", "services", type=type_name)

    async def service_type(self, service: str) -> str:
        """Return the type of a service; empty if it does not exist."""
        return await self._text("service_type", "type", service=service)

    async def service_node(self, service: str) -> str:
        """Return the node that offers a service; empty if it does not exist."""
        return await self._text("service_node", "node", service=service)

    async def service_host(self, service: str) -> str:
        """Return the host on which a service runs; empty if it does not exist."""
        return await self._text("service_host", "host", service=service)

    async def service_providers(self, type_name: str) -> tuple[str, ...]:
        """Return the nodes that offer services of a type."""
        return await self._names("service_providers", "providers", service=type_name)

    async def action_servers(self) -> tuple[str, ...]:
        """Return all actions."""
        return await self._names("action_servers", "action_servers")

    async def action_type(self, action: str) -> str:
        """Return the type of an action; empty if it does not exist."""
        return await self._text("action_type", "type", action=action)

    async def interfaces(self) -> tuple[str, ...]:
        """Return the names of all messages, services and actions that the robot knows (ROS 2)."""
        return await self._names("interfaces", "interfaces")

    async def message_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """Return a message type, and the types in it."""
        return await self._types("message_details", type_name)

    async def service_request_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """Return the request of a service type, and the types in it."""
        return await self._types("service_request_details", type_name)

    async def service_response_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """Return the response of a service type, and the types in it."""
        return await self._types("service_response_details", type_name)

    async def action_goal_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """Return the goal of an action type, and the types in it."""
        return await self._types("action_goal_details", type_name)

    async def action_result_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """Return the result of an action type, and the types in it."""
        return await self._types("action_result_details", type_name)

    async def action_feedback_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """Return the feedback of an action type, and the types in it."""
        return await self._types("action_feedback_details", type_name)

    async def time_ns(self) -> int:
        """Return the robot's time in nanoseconds."""
        answer = await self._answer("get_time", {}, dict[str, dict[str, int]])
        now = answer.get("time", {})
        seconds = now.get("sec", now.get("secs", 0))
        return seconds * NANOSECONDS + now.get("nanosec", now.get("nsecs", 0))

    async def ros_version(self) -> RosVersion:
        """Return the robot's version of ROS (API-05); many ROS 1 robots fail this call."""
        return await self._answer("get_ros_version", {}, RosVersion)

    # -- results ---------------------------------------------------------------------------------------------

    async def _answer(self, question: str, args: Mapping[str, object], expected: type[T]) -> T:
        answer = await self._ask(question, args)
        try:
            return msgspec.convert(answer, expected)
        except msgspec.ValidationError:
            raise ServiceFailed(f"rosapi answers {question} with something else than was asked for") from None

    async def _names(self, question: str, key: str, **args: object) -> tuple[str, ...]:
        return _strings((await self._answer(question, args, dict[str, Any])).get(key))

    async def _text(self, question: str, key: str, **args: object) -> str:
        return str((await self._answer(question, args, dict[str, Any])).get(key, ""))

    async def _types(self, question: str, type_name: str) -> tuple[TypeInfo, ...]:
        answer = await self._answer(question, {"type": type_name}, dict[str, list[TypeDef]])
        return tuple(each.info() for each in answer.get("typedefs", ()))


class TypeDef(msgspec.Struct):
    """Type description of rosapi (API-03)."""

    type: str = ""
    fieldnames: list[str] = []
    fieldtypes: list[str] = []
    fieldarraylen: list[int] = []
    examples: list[str] = []
    constnames: list[str] = []
    constvalues: list[str] = []

    def info(self) -> TypeInfo:
        examples = chain(self.examples, repeat(""))
        columns = zip(self.fieldnames, self.fieldtypes, self.fieldarraylen, examples, strict=False)
        return TypeInfo(
            self.type,
            tuple(FieldInfo(*column) for column in columns),
            tuple(zip(self.constnames, self.constvalues, strict=False)),
        )


def _strings(value: object) -> tuple[str, ...]:
    return tuple(map(str, value)) if isinstance(value, list) else ()
