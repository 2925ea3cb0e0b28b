"""Look-up of the types that a command names: in the standard set, in folders, or on the robot."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rwt.cli.errors import CALLED_WRONGLY, FAILED, CommandError
from rwt_interfaces.distro import Distro
from rwt_interfaces.errors import InterfaceError, UnknownType
from rwt_interfaces.names import KINDS, Kind, parse_type_name, three_part
from rwt_interfaces.registry import Registry
from rwt_participant.spelling import did_you_mean

if TYPE_CHECKING:
    from rwt_client import Robot
    from rwt_interfaces.codegen.type_selection import InterfaceType


def offline_registry(distro: Distro, folders: Iterable[Path]) -> Registry:
    """Return the standard types and those of the packages in some folders.

    Raises:
        CommandError: a folder cannot be read, or has an invalid definition.
    """
    registry = Registry(distro)
    try:
        for folder in folders:
            registry.add_directory(folder)
        registry.verify()
    except (InterfaceError, OSError) as error:
        raise CommandError(f"--interfaces: {error}", CALLED_WRONGLY) from error
    return registry


def known_names(registry: Registry) -> list[str]:
    """Return the three-part names of all types, by kind."""
    return [three_part(name, kind) for kind in KINDS for name in registry.names(kind)]


def of_package(names: Sequence[str], package: str, hint: str = "") -> list[str]:
    """Return the names of the types of a package.

    Args:
        hint: advice if no package has a similar name.

    Raises:
        CommandError: there is no such package.
    """
    found = [name for name in names if name.startswith(f"{package}/")]
    if not found:
        packages = {name.partition("/")[0] for name in names}
        raise CommandError(f"unknown package {package}{did_you_mean(package, packages) or hint}", FAILED)
    return found


def _kinds(name: str) -> tuple[Kind, ...]:
    """Return the possible kinds of a name: that of its middle part, and message, as parts of services are."""
    try:
        _, kind, _ = parse_type_name(name)
    except InterfaceError:
        return ("msg",)
    return KINDS if kind == "" else tuple(dict.fromkeys((*(each for each in KINDS if each == kind), "msg")))


def find_types(registry: Registry, words: Iterable[str]) -> list[InterfaceType]:
    """Return the types that words name, each a type or a package.

    Raises:
        CommandError: there is no such type or package; names the nearest one.
    """
    found: list[InterfaceType] = []
    for word in words:
        names = [word]
        if "/" not in word:
            names = of_package(known_names(registry), word, "; --interfaces DIR adds your own")
        found += [_find_type(registry, name) for name in names]
    return found


def _find_type(registry: Registry, name: str) -> InterfaceType:
    """Return the type of any kind with this name; a message if two kinds share the name."""
    finders: dict[Kind, Callable[[str], InterfaceType]] = {
        "msg": registry.message, "srv": registry.service, "action": registry.action,
    }  # fmt: skip
    unknown: UnknownType | None = None
    for kind in _kinds(name):
        try:
            return finders[kind](name)
        except UnknownType as error:
            unknown = unknown or error
        except InterfaceError as error:
            raise CommandError(str(error), FAILED) from error
    raise CommandError(f"{unknown}; --live asks the robot, --interfaces DIR adds definitions", FAILED)


async def live_types(robot: Robot, words: Sequence[str]) -> list[InterfaceType]:
    """Return the types that words name, asking the robot for unknown ones; without words, the types of all
    its topics, services and actions.

    Raises:
        RobotError: the robot does not know one.
    """
    if not words:
        return await _of_graph(robot)
    found: list[InterfaceType] = []
    for word in words:
        names = [word] if "/" in word else of_package(await robot.api.interfaces(), word)
        found += [await _live_type(robot, name) for name in names]
    return found


async def _live_type(robot: Robot, name: str) -> InterfaceType:
    from rwt_participant.errors import UnknownType

    finders: dict[Kind, Callable[[str], Awaitable[InterfaceType]]] = {
        "msg": robot.types.message, "srv": robot.types.service, "action": robot.types.action,
    }  # fmt: skip
    unavailable: UnknownType | None = None
    for kind in _kinds(name):
        try:
            return await finders[kind](name)
        except UnknownType as error:
            unavailable = unavailable or error
    raise CommandError(str(unavailable), FAILED)


async def _of_graph(robot: Robot) -> list[InterfaceType]:
    found: list[InterfaceType] = [
        await robot.types.message(topic.type) for topic in await robot.api.topics() if topic.type
    ]
    services, actions = await robot.api.services(), await robot.api.action_servers()
    found += [await robot.types.service(await robot.types.of_service(name)) for name in services]
    found += [await robot.types.action(await robot.types.of_action(name)) for name in actions]
    return found
