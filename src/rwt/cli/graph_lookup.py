"""Names and types in the robot's live graph, and questions to rosapi."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from typing import TypeVar

from rwt.cli.errors import FAILED, CommandError
from rwt_interfaces.errors import InvalidName
from rwt_interfaces.names import two_part
from rwt_participant.errors import ProviderNotFound, ServiceFailed
from rwt_participant.spelling import did_you_mean

T = TypeVar("T")

NO_ROSAPI = "rosapi does not answer: it is missing on the robot, or rejects the question"


def absolute_name(name: str) -> str:
    """Return the absolute form of a name: `/odom` for `odom`."""
    return name if name.startswith("/") else f"/{name}"


def is_hidden(name: str) -> bool:
    """True if ROS 2 hides the name: a part of it begins with ``_``."""
    return any(part.startswith("_") for part in name.split("/"))


def same_type(one: str, other: str) -> bool:
    """True if two spellings name one type: ``std_msgs/String`` is ``std_msgs/msg/String``."""
    try:
        return two_part(one) == two_part(other)
    except InvalidName:
        return one == other


def unknown(what: str, name: str, known: Iterable[str]) -> CommandError:
    """Return the error for an unknown name, with the nearest known one."""
    return CommandError(f"the robot knows no {what} {name}{did_you_mean(name, known)}", FAILED)


async def ask_rosapi(question: Callable[[], Awaitable[T]]) -> T:
    """Return an answer of rosapi.

    Raises:
        CommandError: rosapi is missing or rejects the question.
    """
    try:
        return await question()
    except (ServiceFailed, ProviderNotFound) as error:
        raise CommandError(f"{NO_ROSAPI}: {error}", FAILED) from error
