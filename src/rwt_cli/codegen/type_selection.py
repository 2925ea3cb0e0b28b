"""Which types a command is about: of the standard set, of folders, or of the robot's live graph."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rwt_cli.errors import CALLED_WRONGLY, FAILED, CommandError
from rwt_interfaces import field_types
from rwt_interfaces.errors import InterfaceError, UnknownType
from rwt_interfaces.names import KINDS, Kind, parse_type_name, two_part
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_program.spelling import did_you_mean

if TYPE_CHECKING:
    from pathlib import Path

    from rwt_client import Robot
    from rwt_interfaces.distro import Distro
    from rwt_interfaces.field_types import FieldType
    from rwt_interfaces.registry import Registry

InterfaceType = MessageType | ServiceType | ActionType


@dataclass(frozen=True, slots=True)
class TypeSelection:
    """Types, with everything that they contain.

    Attributes:
        registry: where they are from.
        messages: each after those it contains, parts of services and actions included, times not.
        times: the times that occur in them.
        services: the services.
        actions: the actions.
    """

    registry: Registry
    messages: tuple[MessageType, ...]
    times: tuple[field_types.Time, ...]
    services: tuple[ServiceType, ...]
    actions: tuple[ActionType, ...]


def offline_registry(distro: Distro, folders: Iterable[Path]) -> Registry:
    """The standard set and the packages in some folders.

    Raises:
        CommandError: a folder cannot be read, or has a mistake in it.
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
    """The type of that name, whatever kind it is; a message where two kinds share a name.

    Raises:
        CommandError: there is none; names the nearest.
    """
    unknown: UnknownType | None = None
    for kind in _kinds(name):
        try:
            return _of_kind(registry, kind, name)
        except UnknownType as error:
            unknown = unknown or error
        except InterfaceError as error:
            raise CommandError(str(error), FAILED) from error
    raise CommandError(str(unknown), FAILED)


def _kinds(name: str) -> tuple[Kind, ...]:
    """The kinds that a name may be of: the one in its middle part, and message, as of parts of services."""
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
    """The types that words name: a type each, or all of a package.

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
            raise CommandError(_no_package(registry, word), FAILED)
        found += of_package
    return found


def _no_package(registry: Registry, word: str) -> str:
    packages = {name.partition("/")[0] for kind in KINDS for name in registry.names(kind)}
    return f"no package {word} is known{did_you_mean(word, packages) or '; --interfaces DIR adds your own'}"


async def live_types(robot: Robot, words: Iterable[str]) -> list[InterfaceType]:
    """The types that words name, asked of the robot where they are not known; without words, those of all its
    topics, services and actions.

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
            raise CommandError(f"the robot knows no package {word}", FAILED)
        found += [await live_type(robot, name) for name in of_package]
    return found


async def live_type(robot: Robot, name: str) -> InterfaceType:
    """The type of that name, asked of the robot where it is not known."""
    from rwt_program.errors import UnknownType

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


def selection(registry: Registry, types: Iterable[InterfaceType]) -> TypeSelection:
    """Types with everything that they contain, sorted by name, each after what it contains."""
    chosen = sorted(
        {(type(each).__name__, each.name): each for each in types}.values(), key=lambda each: each.name
    )
    walk = _Walk()
    for each in chosen:
        for part in parts_of(each):
            walk.add(part)
    return TypeSelection(
        registry,
        tuple(walk.messages.values()),
        tuple(dict.fromkeys(walk.times)),
        tuple(each for each in chosen if isinstance(each, ServiceType)),
        tuple(each for each in chosen if isinstance(each, ActionType)),
    )


def parts_of(interface: InterfaceType) -> Iterator[MessageType]:
    """The messages that a type is made of."""
    if isinstance(interface, MessageType):
        yield interface
    elif isinstance(interface, ServiceType):
        yield from (interface.request, interface.response)
    else:
        yield from (interface.goal, interface.result, interface.feedback)


class _Walk:
    """Collects messages, what is contained first."""

    def __init__(self) -> None:
        self.messages: dict[str, MessageType] = {}
        self.times: list[field_types.Time] = []

    def add(self, message: MessageType) -> None:
        """A message and what it contains."""
        if message.name in self.messages:
            return
        if message.time is not None:
            self.times.append(message.time)
            return
        for slot in message.slots:
            self._add_type(slot.type)
        self.messages[message.name] = message

    def _add_type(self, field_type: FieldType) -> None:
        match field_type:
            case field_types.Message(type=nested):
                self.add(nested)
            case field_types.Array(element=element):
                self._add_type(element)
            case field_types.Time():
                self.times.append(field_type)
            case _:
                pass


class ClassNames:
    """A class name for each message: its own, with its package's before it where two packages share it.

    Args:
        reserved: names that the file needs for something else.
    """

    def __init__(self, chosen: TypeSelection, reserved: Iterable[str]) -> None:
        names = [message.name for message in chosen.messages]
        names += [service.name for service in chosen.services]
        names += [action.name for action in chosen.actions]
        names += [time_name(time) for time in chosen.times]
        shared: dict[str, int] = {}
        for name in dict.fromkeys(map(two_part, names)):
            short = name.partition("/")[2]
            shared[short] = shared.get(short, 0) + 1
        taken = set(reserved)
        self._names: dict[str, str] = {}
        for name in names:
            package, _, short = name.partition("/")
            prefix = "".join(part.capitalize() for part in package.split("_"))
            self._names[name] = f"{prefix}{short}" if shared[short] > 1 or short in taken else short

    def of(self, name: str) -> str:
        """The class of a message, service or action."""
        return self._names[name]

    def all(self) -> frozenset[str]:
        """Every class name."""
        return frozenset(self._names.values())


def time_name(time: field_types.Time) -> str:
    """The name of a time as a message."""
    return f"builtin_interfaces/{'Duration' if time.is_duration else 'Time'}"
