"""Tools that list topics, services, actions, parameters and types."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Final, Literal

from pydantic import Field

from rwt.gateways.mcp.content.answer import Answer, as_text, bounded
from rwt.gateways.mcp.content.plain import plain
from rwt.gateways.mcp.tools.tool import Arguments, Name, Tool
from rwt_interfaces import field_types
from rwt_interfaces.structs import ActionType, MessageType, ServiceType

if TYPE_CHECKING:
    from rwt.gateways.mcp.agent import Agent
    from rwt_participant.api import Listed

Kind = Literal["topics", "services", "actions", "parameters"]

#: Right that shows the names of a kind.
_REQUIRED: Final = {"topics": "subscribe", "services": "call", "actions": "goals"}

#: Lines per kind; a narrower filter shows the others.
_MAX_LINES: Final = 120

#: Services that every node has.
_PLUMBING: Final = (
    "*/describe_parameters",
    "*/get_parameter_types",
    "*/get_parameters",
    "*/get_type_description",
    "*/list_parameters",
    "*/set_parameters",
    "*/set_parameters_atomically",
    "*/get_loggers",
    "*/set_logger_level",
    "*/get_logger_levels",
    "*/set_logger_levels",
    "*/_action/*",
    "/rosapi/*",
)


class ListRobotArguments(Arguments):
    """Arguments of `list_robot`."""

    kinds: Annotated[
        tuple[Kind, ...],
        Field(min_length=1, max_length=4, description="what to list"),
    ] = ("topics", "services", "actions")
    filter: Annotated[
        str,
        Field(max_length=256, description="only names that match, such as `/camera/*` or `*battery*`"),
    ] = "*"
    plumbing: Annotated[
        bool, Field(description="include the services that every node has (parameters, loggers)")
    ] = False


async def _list_robot(agent: Agent, asked: ListRobotArguments) -> Answer:
    robot = agent.robot
    parts: list[str] = []
    for kind in dict.fromkeys(asked.kinds):
        if kind == "parameters":
            names = [each for each in await robot.params.names() if _fits(each, asked)]
            parts.append(_lines(kind, names))
            continue
        find = {"topics": robot.topics, "services": robot.services, "actions": robot.actions}[kind]
        rows = [each for each in await find() if _fits(each.name, asked)]
        parts.append(_lines(kind, map(_row, rows)) + _hidden(agent, kind))
    return (bounded("\n\n".join(parts), agent.settings.result_bytes),)


def _hidden(agent: Agent, kind: str) -> str:
    """Return a line about names that the role does not see: without it, they would not seem to exist."""
    count = agent.hidden().get(kind, 0)
    return (
        f"\n{count} more require `{_REQUIRED[kind]}` (roles.{agent.role}.{_REQUIRED[kind]})" if count else ""
    )


def _fits(name: str, asked: ListRobotArguments) -> bool:
    if not fnmatch.fnmatchcase(name, asked.filter):
        return False
    return asked.plumbing or not any(fnmatch.fnmatchcase(name, glob) for glob in _PLUMBING)


def _row(each: Listed) -> str:
    if each.publishers is None or each.subscribers is None:
        return f"{each.name} [{each.type}]" if each.type else each.name
    ends = f"{len(each.publishers)} publishers, {len(each.subscribers)} subscribers"
    return f"{each.name} [{each.type or 'no type yet'}] ({ends})"


def _lines(kind: str, rows: Iterable[str]) -> str:
    found = list(rows)
    shown = found[:_MAX_LINES]
    more = [f"… and {len(found) - _MAX_LINES} more: use `filter`"] if len(found) > _MAX_LINES else []
    return "\n".join([f"{kind} ({len(found)}):", *shown, *more])


LIST_ROBOT: Final = Tool(
    "list_robot",
    "List what the robot has",
    "List the robot's topics (streams of messages), services (calls with a response), actions (long-running"
    " goals) and parameters, with their types. Start here. Names are absolute, such as /battery_state.",
    ListRobotArguments,
    _list_robot,
)


class DescribeTypeArguments(Arguments):
    """Arguments of `describe_type`."""

    type: Annotated[Name, Field(description="such as geometry_msgs/Twist or std_srvs/srv/SetBool")]


async def _describe_type(agent: Agent, asked: DescribeTypeArguments) -> Answer:
    found = await agent.robot.interface(asked.type)
    return (bounded(describe(found), agent.settings.result_bytes),)


def describe(interface: MessageType | ServiceType | ActionType) -> str:
    """Return the fields of an interface, nested messages included, and an example with defaults."""
    if isinstance(interface, MessageType):
        return f"message {interface.name}\n{_message(interface)}"
    if isinstance(interface, ServiceType):
        return (
            f"service {interface.name}\nrequest:\n{_message(interface.request)}\n"
            f"response:\n{_message(interface.response)}"
        )
    return (
        f"action {interface.name}\ngoal:\n{_message(interface.goal)}\nresult:\n{_message(interface.result)}\n"
        f"feedback:\n{_message(interface.feedback)}"
    )


def _message(type: MessageType) -> str:
    lines: list[str] = []
    _fields(type, "  ", lines, (type.name,))
    example = as_text(plain(type.struct()))
    return "\n".join([*(lines or ["  (no fields)"]), f"  with defaults: {example}"])


def _fields(type: MessageType, indent: str, lines: list[str], within: tuple[str, ...]) -> None:
    constants = type.definition.constants
    lines.extend(f"{indent}constant {constant.name} = {constant.value}" for constant in constants)
    for slot in type.slots:
        lines.append(f"{indent}{slot.name}: {slot.type}")
        nested = slot.type.element if isinstance(slot.type, field_types.Array) else slot.type
        if isinstance(nested, field_types.Message) and nested.type.name not in within:
            _fields(nested.type, f"{indent}  ", lines, (*within, nested.type.name))


DESCRIBE_TYPE: Final = Tool(
    "describe_type",
    "Describe a type",
    "Describe a message, service or action type: fields with types, constants, and an example with default"
    " values. Use it before you publish, call or send a goal.",
    DescribeTypeArguments,
    _describe_type,
)
