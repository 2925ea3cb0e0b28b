"""Instructions, resources and prompts for agents."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from rwt.extensions.mcp.agent import Agent
from rwt.extensions.mcp.content.answer import Answer, Parts
from rwt.extensions.mcp.errors import ToolError
from rwt.extensions.mcp.tools import TOOLS

INSTRUCTIONS: Final = """\
This is a robot. Start with `list_robot`; `describe_type` shows the fields of messages, services and actions.
Units are metres, radians and seconds unless a field says otherwise; x points forward, y left, z up (REP 103).
Actions take time: wait with `wait_for` or `send_goal` instead of polling. Observe before you act, and act in
small steps. A rejection names the setting that would allow the request: tell the user, and do not try to work
around it."""
"""Instructions for every agent, sent when it connects."""


@dataclass(frozen=True, slots=True)
class Resource:
    """Readable content with a URI.

    Attributes:
        uri: complete, or a template that ends in `{name}`.
        title: name for people.
        description: content, for the model.
        read: returns the content; gets the text that replaces `{name}`, or an empty string.
    """

    uri: str
    title: str
    description: str
    read: Callable[[Agent, str], Awaitable[Answer]]

    @property
    def is_template(self) -> bool:
        """True if the URI ends in `{name}`."""
        return self.uri.endswith("}")


RESOURCES: Final = (
    Resource(
        "robot://overview",
        "Overview of the robot",
        "Topics, services and actions with their types, as `list_robot` lists them.",
        lambda agent, _: TOOLS["list_robot"](agent, {}),
    ),
    Resource(
        "robot://topics/{+topic}",
        "The next message of a topic",
        "A message as returned by `read_topic`, for example robot://topics/battery_state.",
        lambda agent, topic: TOOLS["read_topic"](agent, {"topic": f"/{topic}"}),
    ),
    Resource(
        "robot://types/{+type}",
        "A type",
        "A message, service or action type as described by `describe_type`, for example"
        " robot://types/geometry_msgs/Twist.",
        lambda agent, type: TOOLS["describe_type"](agent, {"type": type}),
    ),
)
"""All resources."""


async def read_resource(agent: Agent, uri: str) -> Parts:
    """Return the content behind a URI. Raises ToolError."""
    for resource in RESOURCES:
        start, template, _ = resource.uri.partition("{")
        if (uri.startswith(start) and uri != start) if template else uri == start:
            return (await resource.read(agent, uri.removeprefix(start))).parts
    raise ToolError(f"unknown resource {uri[:200]!r}; available: {', '.join(each.uri for each in RESOURCES)}")


@dataclass(frozen=True, slots=True)
class Prompt:
    """Template of a task.

    Attributes:
        name: name in MCP.
        title: name for people.
        description: purpose.
        arguments: required arguments, each with its description.
        text: instructions for the model, with the arguments as `{name}`.
    """

    name: str
    title: str
    description: str
    arguments: Mapping[str, str]
    text: str

    def fill_in(self, given: Mapping[str, str]) -> str:
        """Return the text with the arguments filled in. Raises ToolError."""
        missing = [name for name in self.arguments if not given.get(name)]
        strange = [name for name in given if name not in self.arguments]
        if missing or strange:
            wrong = f"`{missing[0]}` is missing" if missing else f"unknown argument {strange[0][:100]!r}"
            raise ToolError(f"{self.name}: {wrong}; arguments: {', '.join(self.arguments) or 'none'}")
        text = self.text
        for name in self.arguments:
            text = text.replace(f"{{{name}}}", given[name][:1000])
        return text


PROMPTS: Final[Mapping[str, Prompt]] = MappingProxyType(
    {
        prompt.name: prompt
        for prompt in (
            Prompt(
                "get_to_know",
                "Get to know the robot",
                "Find out what the robot is, senses and can do.",
                MappingProxyType({}),
                "Find out what this robot is. List its topics, services and actions, look at its camera image"
                " and its laser scan or map if it has them, read its battery, and tell me in a few sentences"
                " what it is, what it senses and what it can do. Do not move anything.",
            ),
            Prompt(
                "check_health",
                "Check the robot's health",
                "Find faults of the robot.",
                MappingProxyType({}),
                "Check the health of this robot: read /diagnostics and the battery if it has them, look for"
                " topics without a publisher, check that the sensor rates are steady, and list all faults,"
                " most severe first, with the evidence. Do not change anything.",
            ),
            Prompt(
                "drive_to",
                "Drive to a place",
                "Drive the robot to a place or a visible object.",
                MappingProxyType({"place": "destination, for example `x=2, y=1 in map` or `the red box`"}),
                "Drive the robot to this place: {place}. Check first for a navigation action (such as"
                " /navigate_to_pose) and prefer it to publishing velocities. If the place is a visible"
                " object, find it in the camera image and determine its coordinates from the depth image or"
                " the scan and `look_up_transform`. Keep clear of obstacles, move in small steps, and report"
                " the final position. If anything is unclear, ask me before you move the robot.",
            ),
        )
    }
)
"""Prompts by name."""
