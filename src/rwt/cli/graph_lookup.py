"""Looks up names in the robot's live graph; an unknown one raises an error with the nearest known one."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from typing import TypeVar

from rwt.cli.errors import FAILED, CommandError
from rwt_interfaces.errors import InvalidName
from rwt_interfaces.names import two_part
from rwt_participant.spelling import did_you_mean

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
