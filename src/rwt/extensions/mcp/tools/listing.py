"""Tools that list topics, services, actions, parameters and types."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Final, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from rwt.extensions.mcp.agent import RESULT_BYTES, Agent
from rwt.extensions.mcp.content.answer import Answer, as_text, bounded, bounded_value
from rwt.extensions.mcp.content.plain import plain
from rwt.extensions.mcp.tools.tool import Arguments, Name, tool
from rwt_graph.topic_selection import glob_matcher
from rwt_interfaces import field_types
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
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

    kinds: Annotated[tuple[Kind, ...], Field(min_length=1, max_length=4, description="what to list")] = (
        "topics",
        "services",
        "actions",
    )
    filter: Annotated[
        str, Field(max_length=256, description="only names that match, such as `/camera/*` or `*battery*`")
    ] = "*"
    plumbing: Annotated[
        bool, Field(description="include the services that every node has (parameters, loggers)")
    ] = False


class Row(TypedDict):
    """Topic, service, action or parameter. A parameter has no type, and only topics have endpoints."""

    name: str
    type: NotRequired[str]
    publishers: NotRequired[int]
    subscribers: NotRequired[int]


class Rows(TypedDict):
    """Rows of one kind."""

    rows: list[Row]
    left_out: Annotated[int, Field(description="rows that match, but are not listed: use `filter`")]
    hidden: Annotated[int, Field(description="number that the agent's role does not see")]
    requires: NotRequired[Annotated[str, Field(description="setting that would show the hidden ones")]]


class ListRobotResult(TypedDict, total=False):
    """Result of `list_robot`."""

    topics: Rows
    services: Rows
    actions: Rows
    parameters: Rows


@tool("List what the robot has", ListRobotResult)
async def list_robot(agent: Agent, asked: ListRobotArguments) -> Answer:
    """List the robot's topics (streams of messages), services (calls with a response), actions (long-running
    goals) and parameters, with their types. Start here. Names are absolute, such as /battery_state."""
    robot = agent.robot
    found: dict[Kind, list[Row]] = {}
    for kind in dict.fromkeys(asked.kinds):
        if kind == "parameters":
            rows: list[Row] = [{"name": each} for each in await robot.params.names()]
        else:
            find = {"topics": robot.topics, "services": robot.services, "actions": robot.actions}[kind]
            rows = [_row(each) for each in await find()]
        found[kind] = _fitting(rows, asked)
    listed: dict[str, Rows] = {kind: _shown(agent, kind, rows) for kind, rows in found.items()}
    text = "\n\n".join(_lines(kind, rows) for kind, rows in listed.items())
    while len(as_text(listed)) > RESULT_BYTES and any(each["rows"] for each in listed.values()):
        listed = {kind: _halved(rows) for kind, rows in listed.items()}
    return Answer(listed, (bounded(text, RESULT_BYTES),))


def _shown(agent: Agent, kind: Kind, rows: Sequence[Row]) -> Rows:
    """Return the first rows, and how many the role does not see, as they would not seem to exist."""
    shown: Rows = {
        "rows": list(rows[:_MAX_LINES]),
        "left_out": max(0, len(rows) - _MAX_LINES),
        "hidden": agent.hidden().get(kind, 0),
    }
    if shown["hidden"]:
        shown["requires"] = f"roles.{agent.role}.{_REQUIRED[kind]}"
    return shown


def _halved(rows: Rows) -> Rows:
    kept = rows["rows"][: len(rows["rows"]) // 2]
    return {**rows, "rows": kept, "left_out": rows["left_out"] + len(rows["rows"]) - len(kept)}


_IS_PLUMBING: Final = tuple(map(glob_matcher, _PLUMBING))


def _fitting(rows: Iterable[Row], asked: ListRobotArguments) -> list[Row]:
    matches = glob_matcher(asked.filter)
    return [
        row
        for row in rows
        if matches(row["name"])
        and (asked.plumbing or not any(is_one(row["name"]) for is_one in _IS_PLUMBING))
    ]


def _row(each: Listed) -> Row:
    row: Row = {"name": each.name, "type": each.type or ""}
    if each.publishers is not None and each.subscribers is not None:
        row |= {"publishers": len(each.publishers), "subscribers": len(each.subscribers)}
    return row


def _lines(kind: str, listed: Rows) -> str:
    lines = [f"{kind} ({len(listed['rows']) + listed['left_out']}):", *map(_line, listed["rows"])]
    if listed["left_out"]:
        lines.append(f"… and {listed['left_out']} more: use `filter`")
    if "requires" in listed:
        right = listed["requires"].rpartition(".")[2]
        lines.append(f"{listed['hidden']} more require `{right}` ({listed['requires']})")
    return "\n".join(lines)


def _line(row: Row) -> str:
    if "publishers" not in row:
        return f"{row['name']} [{row['type']}]" if row.get("type") else row["name"]
    ends = f"{row['publishers']} publishers, {row['subscribers']} subscribers"
    return f"{row['name']} [{row['type'] or 'no type yet'}] ({ends})"


class DescribeTypeArguments(Arguments):
    """Arguments of `describe_type`."""

    type: Annotated[Name, Field(description="such as geometry_msgs/Twist or std_srvs/srv/SetBool")]


class DescribeTypeResult(TypedDict):
    """Result of `describe_type`."""

    kind: Literal["message", "service", "action"]
    name: str
    fields: Annotated[
        dict[str, str],
        Field(description="fields with types and constants, of `message`, `request`, `response`, `goal` …"),
    ]
    defaults: Annotated[dict[str, object], Field(description="an example with defaults for each of them")]


@tool("Describe a type", DescribeTypeResult)
async def describe_type(agent: Agent, asked: DescribeTypeArguments) -> Answer:
    """Describe a message, service or action type: fields with types, constants, and an example with default
    values. Use it before you publish, call or send a goal."""
    found, most = await agent.robot.interface(asked.type), RESULT_BYTES
    kind, parts = _parts(found)
    fields = {part: _message(type) for part, type in parts.items()}
    defaults = {part: plain(type.struct()) for part, type in parts.items()}
    lines = [f"{kind} {found.name}"]
    for part in parts:
        heading = [] if part == kind else [f"{part}:"]
        lines += [*heading, fields[part], f"  with defaults: {as_text(defaults[part])}"]
    share = most // (2 * len(parts))
    data: DescribeTypeResult = {
        "kind": kind,
        "name": found.name,
        "fields": {part: bounded(text, share) for part, text in fields.items()},
        "defaults": {part: bounded_value(value, share) for part, value in defaults.items()},
    }
    return Answer(data, (bounded("\n".join(lines), most),))


def _parts(
    found: MessageType | ServiceType | ActionType,
) -> tuple[Literal["message", "service", "action"], Mapping[str, MessageType]]:
    if isinstance(found, MessageType):
        return "message", {"message": found}
    if isinstance(found, ServiceType):
        return "service", {"request": found.request, "response": found.response}
    return "action", {"goal": found.goal, "result": found.result, "feedback": found.feedback}


def _message(type: MessageType) -> str:
    """Return the fields of a message, nested messages included."""
    lines: list[str] = []
    _fields(type, "  ", lines, (type.name,))
    return "\n".join(lines or ["  (no fields)"])


def _fields(type: MessageType, indent: str, lines: list[str], within: tuple[str, ...]) -> None:
    constants = type.definition.constants
    lines.extend(f"{indent}constant {constant.name} = {constant.value}" for constant in constants)
    for slot in type.slots:
        lines.append(f"{indent}{slot.name}: {slot.type}")
        nested = slot.type.element if isinstance(slot.type, field_types.Array) else slot.type
        if isinstance(nested, field_types.Message) and nested.type.name not in within:
            _fields(nested.type, f"{indent}  ", lines, (*within, nested.type.name))
