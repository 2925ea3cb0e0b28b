"""Resources and prompts: what a program can show a model of the robot, and how tasks are begun well."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from rwt.gateways.mcp.errors import ToolError
from rwt.gateways.mcp.tools import TOOLS

if TYPE_CHECKING:
    from rwt.gateways.mcp.agent import Agent
    from rwt.gateways.mcp.content.answer import Answer

INSTRUCTIONS: Final = """\
This is a robot. Begin with `list_robot`; `describe_type` tells the fields of messages, services and actions.
Lengths are metres, angles radians, times seconds, unless a field says otherwise (REP 103); x is ahead, y is
left, z is up. Things take time: wait for what you have asked for (`wait_for`, `send_goal`) instead of asking
again and again. Look before you act, and act in small steps. A refusal names the setting that would allow it;
tell the person instead of trying another way round it."""
"""Instructions that every agent gets when it connects."""


@dataclass(frozen=True, slots=True)
class Resource:
    """Readable content with a URI.

    Attributes:
        uri: whole, or with one `{name}` at its end that stands for any text.
        title: for people.
        description: for models.
        read: reads it; is given what stands for the name, empty without one.
    """

    uri: str
    title: str
    description: str
    read: Callable[[Agent, str], Awaitable[Answer]]

    @property
    def is_template(self) -> bool:
        """True if the URI contains a name."""
        return self.uri.endswith("}")

    @property
    def start(self) -> str:
        """The URI up to the name."""
        return self.uri.partition("{")[0]


async def _overview(agent: Agent, _: str) -> Answer:
    return await TOOLS["list_robot"](agent, {})


async def _message(agent: Agent, topic: str) -> Answer:
    return await TOOLS["read_topic"](agent, {"topic": f"/{topic}"})


async def _type(agent: Agent, type: str) -> Answer:
    return await TOOLS["describe_type"](agent, {"type": type})


RESOURCES: Final = (
    Resource(
        "robot://overview",
        "What the robot has",
        "Topics, services and actions with their types, as `list_robot` lists them.",
        _overview,
    ),
    Resource(
        "robot://topics/{+topic}",
        "The next message of a topic",
        "A message as `read_topic` shows it, for example robot://topics/battery_state.",
        _message,
    ),
    Resource(
        "robot://types/{+type}",
        "A type",
        "A message, service or action type as `describe_type` describes it, for example"
        " robot://types/geometry_msgs/Twist.",
        _type,
    ),
)
"""Everything that can be read by URI."""


async def read_resource(agent: Agent, uri: str) -> Answer:
    """Return the content behind a URI.

    Raises:
        ToolError: it leads nowhere, or it cannot be read now.
    """
    for resource in RESOURCES:
        if uri == resource.uri and not resource.is_template:
            return await resource.read(agent, "")
        if resource.is_template and uri.startswith(resource.start) and len(uri) > len(resource.start):
            return await resource.read(agent, uri.removeprefix(resource.start))
    raise ToolError(f"there is no {uri[:200]!r}; there are {', '.join(each.uri for each in RESOURCES)}")


@dataclass(frozen=True, slots=True)
class Prompt:
    """Template of a task.

    Attributes:
        name: as programs list it.
        title: for people.
        description: what it is for.
        arguments: what has to be said, each with what it is.
        text: what the model is told, with the arguments as `{name}`.
    """

    name: str
    title: str
    description: str
    arguments: Mapping[str, str]
    text: str

    def fill_in(self, given: Mapping[str, str]) -> str:
        """Return the text with the arguments filled in.

        Raises:
            ToolError: one is missing, or there is none of that name.
        """
        missing = [name for name in self.arguments if not given.get(name)]
        strange = [name for name in given if name not in self.arguments]
        if missing or strange:
            wrong = f"`{missing[0]}` is missing" if missing else f"there is no argument {strange[0][:100]!r}"
            raise ToolError(f"{self.name}: {wrong}; its arguments are: {', '.join(self.arguments) or 'none'}")
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
                "What the robot is, what it senses and what it can do.",
                MappingProxyType({}),
                "Find out what this robot is. List what it has, look through its camera and at its laser scan"
                " or map if there are any, read its battery, and tell me in a few sentences what it is, what"
                " it senses and what it can do. Do not move anything.",
            ),
            Prompt(
                "check_health",
                "Check the robot's health",
                "Whether something is wrong with the robot.",
                MappingProxyType({}),
                "Check whether this robot is well: read /diagnostics and the battery if there are any, look"
                " for topics that should be published and are not, watch whether the sensors' rates are"
                " steady, and list what is wrong, the gravest first, with what you saw. Do not change"
                " anything.",
            ),
            Prompt(
                "drive_to",
                "Drive to a place",
                "Drive the robot to a place, or to something that it sees.",
                MappingProxyType({"place": "where to, for example `x=2, y=1 in map` or `the red box`"}),
                "Drive the robot to this place: {place}. Find out first whether it has an action for"
                " navigation (as /navigate_to_pose); prefer it to publishing velocities. If the place is"
                " something to be seen, find it in the camera picture and turn that into coordinates with"
                " the depth picture or the scan and `look_up_transform`. Keep clear of obstacles, move in"
                " small steps, and tell at the end where the robot is. If something is unclear, ask me"
                " before anything moves.",
            ),
        )
    }
)
"""Every prompt by its name."""
