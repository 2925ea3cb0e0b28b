"""Selected types with all nested types, and a class name for each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from rwt_interfaces import field_types
from rwt_interfaces.field_types import FieldType
from rwt_interfaces.names import two_part
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import ActionType, MessageType, ServiceType

InterfaceType = MessageType | ServiceType | ActionType


@dataclass(frozen=True, slots=True)
class TypeSelection:
    """Types with all nested types.

    Attributes:
        messages: messages in dependency order, including parts of services and actions, excluding times.
        times: time types that occur in them.
    """

    registry: Registry
    messages: tuple[MessageType, ...]
    times: tuple[field_types.Time, ...]
    services: tuple[ServiceType, ...]
    actions: tuple[ActionType, ...]


def selection(registry: Registry, types: Iterable[InterfaceType]) -> TypeSelection:
    """Return types with all nested types, sorted by name, in dependency order."""
    chosen = sorted(
        {(type(each).__name__, each.name): each for each in types}.values(), key=lambda each: each.name
    )
    walk = _Walk()
    for each in chosen:
        for part in each.parts:
            walk.add(part)
    return TypeSelection(
        registry,
        tuple(walk.messages.values()),
        tuple(dict.fromkeys(walk.times)),
        tuple(each for each in chosen if isinstance(each, ServiceType)),
        tuple(each for each in chosen if isinstance(each, ActionType)),
    )


class _Walk:
    def __init__(self) -> None:
        self.messages: dict[str, MessageType] = {}
        self.times: list[field_types.Time] = []

    def add(self, message: MessageType) -> None:
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
    """Class names of messages; the package is prepended if two packages share a name."""

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
        """Return the class name of a message, service or action."""
        return self._names[name]

    def all(self) -> frozenset[str]:
        """Return all class names."""
        return frozenset(self._names.values())


def time_name(time: field_types.Time) -> str:
    """Return the name of a time as a message."""
    return f"builtin_interfaces/{'Duration' if time.is_duration else 'Time'}"
