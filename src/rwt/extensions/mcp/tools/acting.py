"""Tools that change something at once: publishing, calling, setting a parameter."""

from __future__ import annotations

from typing import Annotated, Any, Final

from pydantic import Field

from rwt.access.errors import AccessError
from rwt.access.graph_view import STOP, canonical
from rwt.extensions.mcp.agent import Agent
from rwt.extensions.mcp.content.answer import Answer, as_text
from rwt.extensions.mcp.errors import ToolError
from rwt.extensions.mcp.tools.tool import Acted, Arguments, MessageValue, Name, Seconds, tool
from rwt_participant.errors import NotFound, UnknownType
from rwt_participant.handles import Publisher

Fields = Annotated[dict[str, Any], Field(description="field values; omitted fields keep their defaults")]

#: Types whose zero message stops a robot.
_STOPPED_BY_ZEROS: Final = frozenset({"geometry_msgs/Twist", "geometry_msgs/TwistStamped"})


class PublishArguments(Arguments):
    """Arguments of `publish`."""

    topic: Annotated[Name, Field(description="absolute name, such as /cmd_vel")]
    message: Fields
    type: Annotated[
        str, Field(max_length=256, description="required only for a new topic; otherwise the topic's type")
    ] = ""
    seconds: Annotated[Seconds, Field(description="repeat the message for this long; 0: publish once")] = 0.0
    rate: Annotated[
        float, Field(gt=0, le=50, allow_inf_nan=False, description="messages per second while repeating")
    ] = 10.0
    stop: Annotated[
        dict[str, Any] | None,
        Field(
            description="last message, sent even if the call is cancelled; default: zeros for velocities"
            " (geometry_msgs/Twist), none for other types"
        ),
    ] = None


class PublishResult(Acted):
    """Result of `publish`."""

    topic: str
    published: Annotated[int, Field(description="number of messages, without the last one of `stop`")]
    stop: Annotated[dict[str, Any] | None, Field(description="last message; null: none was sent")]


@tool("Publish a message", PublishResult, act="publish", named_by="topic")
async def publish(agent: Agent, asked: PublishArguments) -> Answer:
    """Publish a message on a topic, once or repeatedly. To drive a robot, publish a velocity with `seconds`:
    the robot is stopped at the end, even if the call fails or is cancelled."""
    seconds = agent.bounded_seconds(asked.seconds, "seconds")
    type = await _message_type(agent, asked)
    stop = asked.stop
    if stop is None and seconds and type in _STOPPED_BY_ZEROS:
        # All fields of an empty message have their defaults: velocities of zero.
        stop = {}
    for_long = f" for {seconds:g} s" if seconds else ""
    if canonical(asked.topic) != STOP:
        what = f"publish {as_text(asked.message)} on {asked.topic}{for_long}"
        await agent.confirm("publish", asked.topic, what)
    async with agent.advertise(asked.topic, type) as publisher:
        lease = await agent.lease_seconds(asked.topic)
        if lease is not None and seconds > lease:
            # The server repeats the message and cannot distinguish an agent that died from one that waits.
            raise ToolError(
                f"`seconds` is {seconds:g}, but the lease on {asked.topic} (safety gate) lasts {lease:g} s:"
                f" publish for at most {lease:g} s, and call again to continue"
            )
        await _publish_first(agent, publisher, asked)
        if not seconds:
            data: PublishResult = {"topic": publisher.name, "published": 1, "stop": None}
            return Answer(data, (f"published one message on {publisher.name}",))
        count = await _publish_for(agent, publisher, asked, seconds, stop)
    ending = "" if stop is None else f", then {as_text(stop) if stop else 'zeros'}"
    data = {"topic": publisher.name, "published": count, "stop": stop}
    return Answer(data, (f"published {count} messages on {publisher.name} in {seconds:g} s{ending}",))


async def _message_type(agent: Agent, asked: PublishArguments) -> str:
    """Return the two-part name of the given type, or of the topic's type."""
    try:
        if not asked.type:
            return (await agent.robot.type_of(asked.topic)).name
        return (await agent.robot.interface(asked.type)).name
    except UnknownType:
        raise
    except NotFound as error:
        raise ToolError(f"{error}; to create a topic, pass its `type`") from None


async def _publish_first(agent: Agent, publisher: Publisher, asked: PublishArguments) -> None:
    """Publish one message, again after approval if the gate requires it."""
    try:
        publisher.publish(asked.message)
    except AccessError:
        if not await agent.pass_gate(asked.seconds):
            raise
        publisher.publish(asked.message)


async def _publish_for(
    agent: Agent, publisher: Publisher, asked: PublishArguments, seconds: float, stop: dict[str, Any] | None
) -> int:
    """Publish repeatedly after the first message; the stop message is always the last."""
    robot = agent.robot
    began, count, told = robot.clock.monotonic(), 1, 0
    try:
        await robot.clock.sleep(min(1 / asked.rate, seconds))
        while (gone := robot.clock.monotonic() - began) < seconds:
            publisher.publish(asked.message)
            count += 1
            if int(gone) > told:
                told = int(gone)
                await agent.report_progress(gone, seconds, f"published {count} messages on {publisher.name}")
            await robot.clock.sleep(min(1 / asked.rate, max(0.0, seconds - gone)))
    finally:
        if stop is not None:
            # Publishing does not await anything, so it also works while the task is being cancelled.
            publisher.publish(stop)
    return count


class CallServiceArguments(Arguments):
    """Arguments of `call_service`."""

    service: Annotated[Name, Field(description="absolute name")]
    request: Fields = Field(default_factory=dict)
    timeout: Annotated[Seconds, Field(gt=0, description="seconds to wait for the response")] = 10.0


class CallServiceResult(Acted):
    """Result of `call_service`."""

    message: MessageValue


@tool("Call a service", CallServiceResult, act="call", named_by="service")
async def call_service(agent: Agent, asked: CallServiceArguments) -> Answer:
    """Call a service and wait for its response. `list_robot` shows its type, `describe_type` the fields of
    the request."""
    timeout = agent.bounded_seconds(asked.timeout, "timeout")
    if canonical(asked.service) != STOP:
        await agent.confirm("call", asked.service, f"call {asked.service} with {as_text(asked.request)}")
    response = await agent.robot.call(asked.service, asked.request, timeout=timeout)
    return await agent.show(response, "")


class SetParameterArguments(Arguments):
    """Arguments of `set_parameter`."""

    name: Annotated[Name, Field(description="`/node:parameter` on ROS 2, `/parameter` on ROS 1")]
    value: Annotated[Any, Field(description="true, false, a number, a string, or a list of one of these")]


class SetParameterResult(Acted):
    """Result of `set_parameter`."""

    name: str
    value: object


@tool("Set a parameter", SetParameterResult, act="set_param", is_idempotent=True)
async def set_parameter(agent: Agent, asked: SetParameterArguments) -> Answer:
    """Set a parameter of a node. The node may reject the value."""
    await agent.confirm("set_param", asked.name, f"set the parameter {asked.name} to {as_text(asked.value)}")
    await agent.robot.params.set(asked.name, asked.value)
    data: SetParameterResult = {"name": asked.name, "value": asked.value}
    return Answer(data, (f"{asked.name} is now {as_text(asked.value)[:1000]}",))
