"""Tools that list frames and look up transforms."""

from __future__ import annotations

import math
from typing import Annotated, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from rwt.extensions.mcp.agent import RESULT_BYTES, Agent
from rwt.extensions.mcp.content.answer import Answer, bounded
from rwt.extensions.mcp.tools.tool import Arguments, Name, Seconds, tool
from rwt_tf2.messages import write_transform


class ListFramesArguments(Arguments):
    """Arguments of `list_frames`."""

    seconds: Annotated[Seconds, Field(description="seconds to listen for moving frames")] = 1.0


class ListFramesResult(TypedDict):
    """Result of `list_frames`."""

    tree: Annotated[str, Field(description="one frame a line, below its parent; empty: no transform came")]


@tool("List the frames", ListFramesResult)
async def list_frames(agent: Agent, asked: ListFramesArguments) -> Answer:
    """List the coordinate frames from /tf and /tf_static as a tree, with the rate of each."""
    seconds = agent.bounded_seconds(asked.seconds, "seconds")
    transforms = agent.robot.tf
    await transforms.start()
    await agent.robot.clock.sleep(seconds)
    data: ListFramesResult = {"tree": bounded(transforms.buffer.tree(), RESULT_BYTES)}
    return Answer(data, (data["tree"] or f"no transform on /tf or /tf_static within {seconds:g} s",))


class TransformArguments(Arguments):
    """Arguments of `look_up_transform`."""

    target: Annotated[Name, Field(description="frame of the result, such as map")]
    source: Annotated[Name, Field(description="frame to locate, such as base_link")]
    point: Annotated[
        list[float] | None,
        Field(
            min_length=3,
            max_length=3,
            description="x, y, z in metres of a point in the source frame, converted to the target frame",
        ),
    ] = None
    timeout: Annotated[Seconds, Field(description="seconds to wait for the transforms")] = 5.0


class TransformResult(TypedDict):
    """Result of `look_up_transform`."""

    target: str
    source: str
    stamp_ns: int
    transform: Annotated[object, Field(description="geometry_msgs/Transform, in metres")]
    degrees: Annotated[dict[str, float], Field(description="the rotation as roll, pitch and yaw")]
    point: NotRequired[Annotated[list[float], Field(description="the point in the target frame")]]


@tool("Look up a transform", TransformResult)
async def look_up_transform(agent: Agent, asked: TransformArguments) -> Answer:
    """Return the pose of one frame in another, for example of base_link in map: position in metres,
    orientation as a quaternion and in degrees. Optionally convert a point."""
    timeout = agent.bounded_seconds(asked.timeout, "timeout")
    found = await agent.robot.tf.lookup(asked.target, asked.source, timeout=timeout)
    message = write_transform(found)["transform"]
    angles = found.transform.rpy()
    roll, pitch, yaw = (round(math.degrees(each), 3) for each in angles)
    data: TransformResult = {
        "target": asked.target,
        "source": asked.source,
        "stamp_ns": found.stamp_ns,
        "transform": message,
        "degrees": {"roll": roll, "pitch": pitch, "yaw": yaw},
    }
    if asked.point is not None:
        x, y, z = asked.point
        data["point"] = [float(each) for each in found.transform.apply((x, y, z))]
    return Answer(data)
