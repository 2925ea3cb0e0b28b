"""Tools that read recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field
from typing_extensions import TypedDict

from rwt.extensions.mcp.agent import RESULT_BYTES, Agent, shown
from rwt.extensions.mcp.content.answer import Answer, bounded
from rwt.extensions.mcp.errors import ToolError
from rwt.extensions.mcp.tools.tool import Arguments, MessageValue, Name, tool

if TYPE_CHECKING:
    from rwt.extensions.mcp.recordings import RecordingFolder


def _recordings(agent: Agent) -> RecordingFolder:
    if agent.recordings is None:
        raise ToolError("no recordings are available (setting mcp.recordings)")
    return agent.recordings


class DescribeRecordingArguments(Arguments):
    """Arguments of `describe_recording`."""

    recording: Annotated[
        str, Field(max_length=256, description="name of a recording; empty: list all recordings")
    ] = ""


class DescribeRecordingResult(TypedDict, total=False):
    """Result of `describe_recording`: names of recordings, or lines about one."""

    recordings: list[str]
    lines: list[str]


@tool("Look at recordings", DescribeRecordingResult, reads_recordings=True)
async def describe_recording(agent: Agent, asked: DescribeRecordingArguments) -> Answer:
    """List the recordings, or describe one: duration, topics and message counts."""
    recordings = _recordings(agent)

    def text() -> Answer:
        if not asked.recording:
            names = recordings.names()
            listed = [f"recordings ({len(names)}):", *names[:200]]
            return Answer({"recordings": listed[1:]}, ("\n".join(listed),))
        text = bounded("\n".join(recordings.describe(asked.recording, agent.sees)), RESULT_BYTES)
        return Answer({"lines": text.split("\n")}, (text,))

    return await agent.in_thread(text)


class ReadRecordingArguments(Arguments):
    """Arguments of `read_recording`."""

    recording: Annotated[Name, Field(description="name of the recording")]
    topic: Annotated[Name, Field(description="absolute name")]
    at: Annotated[
        float, Field(ge=0, le=1e9, allow_inf_nan=False, description="seconds after the recording's start")
    ] = 0.0


class ReadRecordingResult(TypedDict):
    """Result of `read_recording`."""

    type: str
    seconds: Annotated[float, Field(description="time of the message after the recording's start")]
    message: MessageValue


@tool("Read a recorded message", ReadRecordingResult, reads_recordings=True)
async def read_recording(agent: Agent, asked: ReadRecordingArguments) -> Answer:
    """Read the first message of a topic at or after a time of a recording, formatted as by `read_topic`."""
    recordings = _recordings(agent)
    if not agent.sees(asked.topic):
        raise ToolError(f"{asked.recording} has no topic {asked.topic}")

    def read() -> Answer:
        message, type, seconds = recordings.message(asked.recording, asked.topic, asked.at)
        answer = shown(message, type)
        data = {"type": type, "seconds": seconds, **answer.data}
        return Answer(data, (f"recorded at {seconds:.3f} s:", *answer.shown))

    return await agent.in_thread(read)
