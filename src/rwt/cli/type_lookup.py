"""Look-up of the types that a command names: in the standard set, in folders, or on the robot."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rwt.cli.errors import CALLED_WRONGLY, FAILED, CommandError
from rwt_interfaces.distro import Distro
from rwt_interfaces.errors import InterfaceError, UnknownType
from rwt_interfaces.names import KINDS, Kind, parse_type_name
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
    from rwt_interfaces.registry import Registry

    registry = Registry(distro)
    try:
        for folder in folders:
            registry.add_directory(folder)
        registry.verify()
    except (InterfaceError, OSError) as error:
        raise CommandError(f"--interfaces: {error}", CALLED_WRONGLY) from error
    return registry


def find_type(registry: Registry, name: str) -> InterfaceType:
    """Return the type of any kind with this name; a message if two kinds share the name.

    Raises:
        CommandError: there is no such type; names the nearest one.
    """
    unknown: UnknownType | None = None
    for kind in _kinds(name):
        try:
            return _of_kind(registry, kind, name)
        except UnknownType as error:
            unknown = unknown or error
        except InterfaceError as error:
            raise CommandError(str(error), FAILED) from error
    raise CommandError(f"{unknown}; --live asks the robot, --interfaces DIR adds definitions", FAILED)


def _kinds(name: str) -> tuple[Kind, ...]:
    """Return the possible kinds of a name: that of its middle part, and message, as parts of services are."""
    try:
        _, kind, _ = parse_type_name(name)
    except InterfaceError:
        return ("msg",)
    return KINDS if kind == "" else tuple(dict.fromkeys((*(each for each in KINDS if each == kind), "msg")))


def _of_kind(registry: Registry, kind: Kind, name: str) -> InterfaceType:
    if kind == "msg":
        return registry.message(name)
    return registry.service(name) if kind == "srv" else registry.action(name)


def find_types(registry: Registry, words: Iterable[str]) -> list[InterfaceType]:
    """Return the types that words name, each a type or a package.

    Raises:
        CommandError: there is no such type or package.
    """
    found: list[InterfaceType] = []
    for word in words:
        if "/" in word:
            found.append(find_type(registry, word))
            continue
        prefix = f"{word}/"
        of_package = [
            _of_kind(registry, kind, name)
            for kind in KINDS
            for name in registry.names(kind)
            if name.startswith(prefix)
        ]
        if not of_package:
            packages = {name.partition("/")[0] for kind in KINDS for name in registry.names(kind)}
            meant = did_you_mean(word, packages) or "; --interfaces DIR adds your own"
            raise CommandError(f"unknown package {word}{meant}", FAILED)
        found += of_package
    return found


async def live_types(robot: Robot, words: Iterable[str]) -> list[InterfaceType]:
    """Return the types that words name, asking the robot for unknown ones; without words, the types of all
    its topics, services and actions.

    Raises:
        RobotError: the robot does not know one.
    """
    wanted = list(words)
    if not wanted:
        return await _of_graph(robot)
    found: list[InterfaceType] = []
    for word in wanted:
        if "/" in word:
            found.append(await live_type(robot, word))
            continue
        of_package = [name for name in await robot.api.interfaces() if name.startswith(f"{word}/")]
        if not of_package:
            raise CommandError(f"the robot has no package {word}", FAILED)
        found += [await live_type(robot, name) for name in of_package]
    return found


async def live_type(robot: Robot, name: str) -> InterfaceType:
    """Return the type of this name, asking the robot if it is unknown."""
    from rwt_participant.errors import UnknownType

    unavailable: UnknownType | None = None
    for kind in _kinds(name):
        try:
            if kind == "msg":
                return await robot.types.message(name)
            return await (robot.types.service(name) if kind == "srv" else robot.types.action(name))
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
