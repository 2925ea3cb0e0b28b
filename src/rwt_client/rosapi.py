"""What rosapi answers, as methods and frozen dataclasses."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import anyio
import msgspec

from rwt_interfaces.times import NANOSECONDS
from rwt_participant import api
from rwt_participant.errors import (
    CallTimeout,
    NotFound,
    ParameterRejected,
    ProviderNotFound,
    RobotError,
    ServiceFailed,
)
from rwt_participant.messages import ParameterValue
from rwt_participant.spelling import did_you_mean

T = TypeVar("T")

Ask = Callable[[str, Mapping[str, object]], Awaitable[Any]]
"""Calls a service of rosapi with plain arguments; gives its plain answer. Raises CallFailed."""

UNANSWERED: Final = (ServiceFailed, ProviderNotFound, CallTimeout)
"""What a question raises that the robot does not answer although there is a connection to it."""

ADVICE_SECONDS: Final = 1.0
"""How long an error waits for the names of which one may have been meant; silence holds none up."""


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic and the name of its type, which is empty where nobody has established it."""

    name: str
    type: str


@dataclass(frozen=True, slots=True)
class NodeInfo:
    """A node: the topics that it subscribes to and publishes, and its services."""

    name: str
    subscribing: tuple[str, ...]
    publishing: tuple[str, ...]
    services: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RosVersion:
    """1 or 2, and the distribution, for example ``jazzy``."""

    version: int
    distro: str


@dataclass(frozen=True, slots=True)
class FieldInfo:
    """One field of a message.

    Attributes:
        type: as rosapi names it, for example ``double`` or ``geometry_msgs/Point``.
        array_length: -1 for a single value, 0 for an array of any length, else the length.
        example: the default as text.
    """

    name: str
    type: str
    array_length: int
    example: str


@dataclass(frozen=True, slots=True)
class TypeInfo:
    """A message type: its fields, and its constants by name."""

    name: str
    fields: tuple[FieldInfo, ...]
    constants: tuple[tuple[str, str], ...]


class RosApi:
    """The questions of rosapi.

    Every method raises :exc:`~rwt_participant.errors.CallFailed`, as a call of any service does.
    """

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    async def topics(self) -> tuple[TopicInfo, ...]:
        """Every topic and its type."""
        answer = await self._answer("topics", {}, dict[str, list[str]])
        pairs = zip(answer.get("topics", ()), answer.get("types", ()), strict=False)
        return tuple(TopicInfo(name, kind) for name, kind in pairs)

    async def topics_for_type(self, type_name: str) -> tuple[str, ...]:
        """The topics of one type."""
        return await self._names("topics_for_type", "topics", type=type_name)

    async def topic_type(self, topic: str) -> str:
        """The type of a topic; empty if there is no such topic."""
        return await self._text("topic_type", "type", topic=topic)

    async def publishers(self, topic: str) -> tuple[str, ...]:
        """The nodes that publish on a topic."""
        return await self._names("publishers", "publishers", topic=topic)

    async def subscribers(self, topic: str) -> tuple[str, ...]:
        """The nodes that subscribe to a topic."""
        return await self._names("subscribers", "subscribers", topic=topic)

    async def nodes(self) -> tuple[str, ...]:
        """Every node."""
        return await self._names("nodes", "nodes")

    async def node(self, name: str) -> NodeInfo:
        """What a node takes part in."""
        answer = await self._answer("node_details", {"node": name}, dict[str, Any])
        parts = (_strings(answer.get(key)) for key in ("subscribing", "publishing", "services"))
        return NodeInfo(name, *parts)

    async def services(self) -> tuple[str, ...]:
        """Every service."""
        return await self._names("services", "services")

    async def services_for_type(self, type_name: str) -> tuple[str, ...]:
        """The services of one type."""
        return await self._names("services_for_type", "services", type=type_name)

    async def service_type(self, service: str) -> str:
        """The type of a service; empty if there is no such service."""
        return await self._text("service_type", "type", service=service)

    async def service_node(self, service: str) -> str:
        """The node that offers a service; empty if there is no such service."""
        return await self._text("service_node", "node", service=service)

    async def service_host(self, service: str) -> str:
        """The host on which a service runs; empty if there is no such service."""
        return await self._text("service_host", "host", service=service)

    async def service_providers(self, type_name: str) -> tuple[str, ...]:
        """The nodes that offer services of a type."""
        return await self._names("service_providers", "providers", service=type_name)

    async def action_servers(self) -> tuple[str, ...]:
        """Every action."""
        return await self._names("action_servers", "action_servers")

    async def action_type(self, action: str) -> str:
        """The type of an action; empty if there is no such action."""
        return await self._text("action_type", "type", action=action)

    async def interfaces(self) -> tuple[str, ...]:
        """The names of all messages, services and actions that the robot knows (ROS 2)."""
        return await self._names("interfaces", "interfaces")

    async def message_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """A message type, and the types in it."""
        return await self._types("message_details", type_name)

    async def service_request_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """The request of a service type, and the types in it."""
        return await self._types("service_request_details", type_name)

    async def service_response_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """The response of a service type, and the types in it."""
        return await self._types("service_response_details", type_name)

    async def action_goal_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """The goal of an action type, and the types in it."""
        return await self._types("action_goal_details", type_name)

    async def action_result_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """The result of an action type, and the types in it."""
        return await self._types("action_result_details", type_name)

    async def action_feedback_details(self, type_name: str) -> tuple[TypeInfo, ...]:
        """The feedback of an action type, and the types in it."""
        return await self._types("action_feedback_details", type_name)

    async def time_ns(self) -> int:
        """The robot's time, in nanoseconds."""
        answer = await self._answer("get_time", {}, dict[str, dict[str, int]])
        now = answer.get("time", {})
        seconds = now.get("sec", now.get("secs", 0))
        return seconds * NANOSECONDS + now.get("nanosec", now.get("nsecs", 0))

    async def ros_version(self) -> RosVersion:
        """Which ROS the robot speaks; of ROS 1 many robots fail this call."""
        answer = await self._answer("get_ros_version", {}, dict[str, Any])
        return RosVersion(int(answer.get("version", 0)), str(answer.get("distro", "")))

    # -- answers ---------------------------------------------------------------------------------------------

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
        answer = await self._answer(question, {"type": type_name}, dict[str, list[_TypeDef]])
        return tuple(each.info() for each in answer.get("typedefs", ()))


class _TypeDef(msgspec.Struct):
    """A type as rosapi describes it (API-03)."""

    type: str = ""
    fieldnames: list[str] = []
    fieldtypes: list[str] = []
    fieldarraylen: list[int] = []
    examples: list[str] = []
    constnames: list[str] = []
    constvalues: list[str] = []

    def info(self) -> TypeInfo:
        """The same as this package tells it."""
        columns = zip(self.fieldnames, self.fieldtypes, self.fieldarraylen, self.examples, strict=False)
        return TypeInfo(
            self.type,
            tuple(FieldInfo(*column) for column in columns),
            tuple(zip(self.constnames, self.constvalues, strict=False)),
        )


def _strings(value: object) -> tuple[str, ...]:
    return tuple(map(str, value)) if isinstance(value, list) else ()


class Parameters(api.Parameters):
    """The parameters of a robot: ``/demo_robot:max_speed`` on ROS 2, ``/max_speed`` on ROS 1."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    async def get(self, name: str, default: ParameterValue = None) -> ParameterValue:  # noqa: D102 - inherited
        try:
            answer = await self._asked("get_param", NotFound, name=name)
        except NotFound as error:
            if default is not None:
                return default
            if isinstance(error, ProviderNotFound):
                raise  # There is no rosapi to ask.
            raise await self._not_found(name, str(error)) from None
        value: ParameterValue = json.loads(answer.get("value") or "null")
        if value is None and default is None:
            raise await self._not_found(name, f"there is no parameter {name}")
        return default if value is None else value

    async def set(self, name: str, value: ParameterValue) -> None:  # noqa: D102 - inherited
        try:
            await self._asked("set_param", ParameterRejected, name=name, value=json.dumps(value))
        except ParameterRejected as error:
            raise ParameterRejected(f"{error}{await self._meant(name)}") from None

    async def has(self, name: str) -> bool:  # noqa: D102 - inherited
        return bool((await self._asked("has_param", name=name)).get("exists"))

    async def delete(self, name: str) -> None:  # noqa: D102 - inherited
        try:
            await self._asked("delete_param", ParameterRejected, name=name)
        except ParameterRejected as error:
            if await self.has(name):
                raise
            raise await self._not_found(name, str(error)) from None

    async def _not_found(self, name: str, text: str) -> NotFound:
        return NotFound(f"{text}{await self._meant(name)}")

    async def _meant(self, name: str) -> str:
        """`; did you mean X?` with a parameter of a name like it; empty where the robot does not tell."""
        with anyio.move_on_after(ADVICE_SECONDS):
            try:
                return did_you_mean(name, await self.names())
            except UNANSWERED:
                pass  # It does not tell.
        return ""

    async def names(self) -> tuple[str, ...]:  # noqa: D102 - inherited
        return tuple(map(str, (await self._asked("get_param_names")).get("names", ())))

    async def _asked(
        self, question: str, refused: type[RobotError] = ServiceFailed, **args: object
    ) -> dict[str, Any]:
        """The answer, or `refused` with the robot's words."""
        try:
            answer = await self._ask(question, args)
        except ServiceFailed as error:
            raise refused(str(error)) from None
        found: dict[str, Any] = answer if isinstance(answer, dict) else {}
        if found.get("successful") is False:
            name = args.get("name", "")
            raise refused(str(found.get("reason") or f"{question} of {name} was refused"))
        return found
