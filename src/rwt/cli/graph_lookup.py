"""Looks up names in the robot's live graph; an unknown one raises an error with the nearest known one."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from typing import TYPE_CHECKING, TypeVar

from rwt.cli.errors import FAILED, CommandError
from rwt_interfaces.errors import InvalidName
from rwt_interfaces.names import two_part
from rwt_participant.spelling import did_you_mean

if TYPE_CHECKING:
    from rwt_client import Robot, TopicInfo

T = TypeVar("T")

NO_ROSAPI = "the robot does not answer questions: its node rosapi is missing or refuses"


def absolute_name(name: str) -> str:
    """A name as the graph has it: `odom` is `/odom`."""
    return name if name.startswith("/") else f"/{name}"


def is_hidden(name: str) -> bool:
    """Whether ROS 2 hides a name: a part of it begins with ``_``."""
    return any(part.startswith("_") for part in name.split("/"))


def same_type(one: str, other: str) -> bool:
    """Whether two names are one type's: ``std_msgs/String`` is ``std_msgs/msg/String``."""
    try:
        return two_part(one) == two_part(other)
    except InvalidName:
        return one == other


def unknown(what: str, name: str, known: Iterable[str]) -> CommandError:
    """That there is no such thing, and what may have been meant."""
    return CommandError(f"the robot knows no {what} {name}{did_you_mean(name, known)}", FAILED)


async def topics_of(robot: Robot, *, hidden: bool = False) -> list[TopicInfo]:
    """The robot's topics, sorted by name."""
    found = sorted(await ask_rosapi(robot.api.topics), key=lambda topic: topic.name)
    return [topic for topic in found if hidden or not is_hidden(topic.name)]


async def ask_rosapi(question: Callable[[], Awaitable[T]]) -> T:
    """An answer of rosapi.

    Raises:
        CommandError: there is no rosapi.
    """
    from rwt_participant.errors import ProviderNotFound, ServiceFailed

    try:
        return await question()
    except (ServiceFailed, ProviderNotFound) as error:
        raise CommandError(f"{NO_ROSAPI}: {error}", FAILED) from error


async def topic_type(robot: Robot, name: str) -> str:
    """The type of a topic that is there.

    Raises:
        CommandError: there is no such topic; names the nearest one.
    """
    known = {topic.name: topic.type for topic in await ask_rosapi(robot.api.topics)}
    if name not in known:
        raise unknown("topic", name, known)
    if not known[name]:
        raise CommandError(f"the type of {name} is not known to the robot yet; give it", FAILED)
    return known[name]


async def known_service(robot: Robot, name: str) -> str:
    """The type of a service that is there.

    Raises:
        CommandError: there is no such service; names the nearest one.
    """
    found = await ask_rosapi(lambda: robot.api.service_type(name))
    if not found:
        raise unknown("service", name, await robot.api.services())
    return found


async def known_action(robot: Robot, name: str) -> str:
    """The type of an action that is there.

    Raises:
        CommandError: there is no such action; names the nearest one.
    """
    from rwt_participant.errors import ProviderNotFound, ServiceFailed

    try:
        found = await robot.api.action_type(name)
    except (ServiceFailed, ProviderNotFound):
        found = ""
    if not found:
        raise unknown("action", name, await ask_rosapi(robot.api.action_servers))
    return found


async def known_node(robot: Robot, name: str) -> None:
    """Nothing, if there is such a node.

    Raises:
        CommandError: there is none; names the nearest one.
    """
    nodes = await ask_rosapi(robot.api.nodes)
    if name not in nodes:
        raise unknown("node", name, nodes)
