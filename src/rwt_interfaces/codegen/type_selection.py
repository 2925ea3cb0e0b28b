"""Selected types with everything that they contain, and a class name for each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rwt_interfaces import field_types
from rwt_interfaces.names import two_part
from rwt_interfaces.structs import ActionType, MessageType, ServiceType

if TYPE_CHECKING:
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
    """Return the messages that a type is made of."""
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
        """Add a message and the messages that it contains."""
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
    """Return the name of a time as a message."""
    return f"builtin_interfaces/{'Duration' if time.is_duration else 'Time'}"
