"""Tools that read messages, numbers over time, conditions and parameters."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, NotRequired

import anyio
from pydantic import Field
from typing_extensions import TypedDict

from rwt.extensions.mcp.agent import RESULT_BYTES, Agent
from rwt.extensions.mcp.content.answer import Answer, as_text, bounded, bounded_value
from rwt.extensions.mcp.content.plain import field, numeric_fields, plain
from rwt.extensions.mcp.errors import ToolError
from rwt.extensions.mcp.tools.tool import Arguments, MessageValue, Name, Seconds, tool
from rwt_participant.messages import Message

FieldPath = Annotated[str, Field(min_length=1, max_length=256)]

#: Messages that `watch_numbers` evaluates; later ones are skipped.
_MAX_MESSAGES: Final = 10_000

#: Fields that `watch_numbers` evaluates.
_MAX_FIELDS: Final = 20

#: Maximum number of bytes of the value that `wait_for` reports.
_SEEN_BYTES: Final = 1000

#: Values listed per field.
_SHOWN_VALUES: Final = 20


class ReadTopicArguments(Arguments):
    """Arguments of `read_topic`."""

    topic: Annotated[Name, Field(description="absolute name, such as /odom")]
    timeout: Annotated[Seconds, Field(description="seconds to wait for a message")] = 5.0
    fields: Annotated[
        tuple[FieldPath, ...],
        Field(max_length=50, description="only these fields, such as `pose.pose.position.x` or `ranges[0]`"),
    ] = ()


class ReadTopicResult(TypedDict):
    """Result of `read_topic`."""

    type: str
    message: NotRequired[MessageValue]
    fields: NotRequired[Annotated[dict[str, object], Field(description="values of the requested fields")]]


async def next_message(agent: Agent, topic: str, seconds: float) -> tuple[Message, str]:
    """Return the next or latched message of a topic, with the name of its type.

    Raises:
        ToolError: no message within the time.
        NotFound: unknown topic.
    """
    type = (await agent.robot.type_of(topic)).name
    patience = agent.bounded_seconds(seconds, "timeout")
    found: list[Message] = []
    came = anyio.Event()

    def take(message: Message) -> None:
        if not found:
            found.append(message)
            came.set()

    async with agent.robot.subscribe(topic, take, type):
        with agent.robot.clock.within(patience):
            await came.wait()
    if not found:
        raise ToolError(
            f"no message on {topic} within {patience:g} s: check with `list_robot` that it has a publisher,"
            " or use a longer `timeout`"
        )
    return found[0], type


@tool("Read a message", ReadTopicResult)
async def read_topic(agent: Agent, asked: ReadTopicArguments) -> Answer:
    """Read the next message of a topic, or the last one of a latched topic. Camera images are returned as
    images, laser scans and maps as drawings with a summary, everything else as JSON. Use `fields` to get only
    some fields of a large message."""
    message, type = await next_message(agent, asked.topic, asked.timeout)
    if not asked.fields:
        answer = await agent.show(message, type)
        return Answer({"type": type, **answer.data}, answer.shown)
    values = {path: field(message, path) for path in asked.fields}

    def fields() -> Answer:
        found, most = {path: plain(value) for path, value in values.items()}, RESULT_BYTES
        data = {path: bounded_value(value, most // len(found)) for path, value in found.items()}
        return Answer({"type": type, "fields": data}, (bounded(as_text(found), most),))

    return await agent.in_thread(fields)


class WatchNumbersArguments(Arguments):
    """Arguments of `watch_numbers`."""

    topic: Annotated[Name, Field(description="absolute name")]
    seconds: Annotated[Seconds, Field(description="duration in seconds")] = 2.0
    fields: Annotated[
        tuple[FieldPath, ...],
        Field(max_length=_MAX_FIELDS, description="numeric fields; default: all, up to 20"),
    ] = ()


class Statistics(TypedDict, total=False):
    """Values of one field; without finite values, only `finite` is present, which is 0."""

    finite: int
    first: object
    last: object
    min: float
    max: float
    mean: float
    values: list[object]


class WatchNumbersResult(TypedDict):
    """Result of `watch_numbers`."""

    messages: int
    seconds: float
    per_second: NotRequired[float]
    fields: dict[str, Statistics]


@tool("Watch numbers over a time", WatchNumbersResult)
async def watch_numbers(agent: Agent, asked: WatchNumbersArguments) -> Answer:
    """Watch numeric fields of a topic for some seconds: first, last, minimum, maximum and mean value, sample
    values, and messages per second."""
    type = (await agent.robot.type_of(asked.topic)).name
    seconds = agent.bounded_seconds(asked.seconds, "seconds")
    began = agent.robot.clock.monotonic()
    times: list[float] = []
    values: dict[str, list[float]] = {path: [] for path in asked.fields}
    wrong: list[ToolError] = []

    def take(message: Message) -> None:
        if len(times) >= _MAX_MESSAGES or wrong:
            return
        times.append(agent.robot.clock.monotonic() - began)
        try:
            found = {path: _number(message, path) for path in asked.fields}
        except ToolError as error:
            wrong.append(error)  # Raised by the tool, not in the callback of the robot.
            return
        for path, value in (found or _all_numbers(message)).items():
            values.setdefault(path, []).append(value)

    async with agent.robot.subscribe(asked.topic, take, type):
        await agent.robot.clock.sleep(seconds)
    if wrong:
        raise wrong[0]
    if not times:
        raise ToolError(f"no message on {asked.topic} within {seconds:g} s: use a longer `seconds`")
    if not values:
        raise ToolError(f"{type} has no field with a single number: use `read_topic`")
    data: WatchNumbersResult = {"messages": len(times), "seconds": seconds, "fields": {}}
    if len(times) > 1:
        data["per_second"] = round((len(times) - 1) / max(times[-1] - times[0], 1e-9), 2)
    data["fields"] = {path: _statistics(each) for path, each in values.items()}
    return Answer(data, (bounded(as_text(data), RESULT_BYTES),))


def _all_numbers(message: Message) -> dict[str, float]:
    found = [each for each in numeric_fields(message).items() if not each[0].startswith("header.")]
    return dict(found[:_MAX_FIELDS])


def _number(message: Message, path: str) -> float:
    value = field(message, path)
    if not isinstance(value, bool | int | float):
        raise ToolError(f"`{path}`: expected a number, got {type(value).__name__}")
    return float(value)


def _statistics(values: list[float]) -> Statistics:
    finite = [each for each in values if math.isfinite(each)]
    if not finite:
        return {"finite": 0}
    step = max(1, len(values) // _SHOWN_VALUES)
    return {
        "first": plain(values[0]),
        "last": plain(values[-1]),
        "min": min(finite),
        "max": max(finite),
        "mean": sum(finite) / len(finite),
        "values": [plain(each) for each in values[::step][:_SHOWN_VALUES]],
    }


Comparison = Literal["==", "!=", "<", "<=", ">", ">=", "contains"]

# Fields hold any type; values that cannot be compared raise TypeError.
_COMPARE: Final[Mapping[Comparison, Callable[[Any, Any], object]]] = MappingProxyType(
    {
        "==": operator.eq,
        "!=": operator.ne,
        "<": operator.lt,
        "<=": operator.le,
        ">": operator.gt,
        ">=": operator.ge,
        "contains": operator.contains,
    }
)


class WaitForArguments(Arguments):
    """Arguments of `wait_for`."""

    topic: Annotated[Name, Field(description="absolute name")]
    field: Annotated[FieldPath, Field(description="such as `percentage` or `pose.pose.position.x`")]
    comparison: Annotated[Comparison, Field(description="operator between field and value")]
    value: Annotated[
        float | bool | Annotated[str, Field(max_length=1000)],
        Field(description="number, true, false or string"),
    ]
    timeout: Annotated[Seconds, Field(description="seconds to wait")] = 30.0


class WaitForResult(TypedDict):
    """Result of `wait_for`, once the condition is true."""

    seconds: float
    value: Annotated[object, Field(description="value of the field for which it is true")]


@tool("Wait for a condition", WaitForResult)
async def wait_for(agent: Agent, asked: WaitForArguments) -> Answer:
    """Wait until a field of a topic's messages fulfils a condition, for example until the battery's
    `percentage` is below 0.2. Every message is checked, so short events are not missed."""
    type = (await agent.robot.type_of(asked.topic)).name
    patience = agent.bounded_seconds(asked.timeout, "timeout")
    compare = _COMPARE[asked.comparison]
    began = agent.robot.clock.monotonic()
    last: list[object] = []
    outcome: list[float | ToolError] = []
    ended = anyio.Event()

    def take(message: Message) -> None:
        if outcome:
            return
        try:
            value = field(message, asked.field)
            last[:] = [value]
            holds = bool(compare(value, asked.value))
        except ToolError as error:
            outcome.append(error)
        except TypeError:
            outcome.append(
                ToolError(
                    f"`value`: {asked.value!r} cannot be compared by {asked.comparison} with"
                    f" {as_text(plain(last[0]))[:200]}"
                )
            )
        else:
            if not holds:
                return
            outcome.append(agent.robot.clock.monotonic() - began)
        ended.set()

    async with agent.robot.subscribe(asked.topic, take, type):
        with agent.robot.clock.within(patience):
            await ended.wait()
    seen = bounded(as_text(plain(last[0])), _SEEN_BYTES) if last else "no message"
    condition = f"{asked.field} {asked.comparison} {asked.value!r}"
    if not outcome:
        raise ToolError(f"{condition} did not become true within {patience:g} s; last seen: {seen}")
    if isinstance(outcome[0], ToolError):
        raise outcome[0]
    data: WaitForResult = {"seconds": outcome[0], "value": bounded_value(plain(last[0]), _SEEN_BYTES)}
    return Answer(data, (f"{condition} is true after {outcome[0]:.2f} s; the value is {seen}",))


class GetParameterArguments(Arguments):
    """Arguments of `get_parameter`."""

    name: Annotated[Name, Field(description="`/node:parameter` on ROS 2, `/parameter` on ROS 1")]


class GetParameterResult(TypedDict):
    """Result of `get_parameter`."""

    name: str
    value: object


@tool("Read a parameter", GetParameterResult)
async def get_parameter(agent: Agent, asked: GetParameterArguments) -> Answer:
    """Read a parameter of a node. `list_robot` with `kinds` ["parameters"] lists the names."""
    value, most = plain(await agent.robot.params.get(asked.name)), RESULT_BYTES
    data: GetParameterResult = {"name": asked.name, "value": bounded_value(value, most)}
    return Answer(data, (bounded(as_text(value), most),))
