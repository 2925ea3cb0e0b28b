"""`rosidl_adapter.parser`: what a `.msg` text says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rwt_interfaces.definitions.model import WrittenType
from rwt_interfaces.definitions.parser import parse_message
from rwt_interfaces.distro import JAZZY


@dataclass(frozen=True, slots=True)
class Type:
    """The type of a field.

    Attributes:
        pkg_name: the package of a message; None for a primitive.
        type: the message's name or the primitive.
        string_upper_bound: longest string, or None.
        is_array: whether it is an array or a sequence.
        array_size: elements of an array, or the most of a bounded sequence; None for others.
        is_upper_bound: whether `array_size` is a bound.
    """

    pkg_name: str | None
    type: str
    string_upper_bound: int | None
    is_array: bool
    array_size: int | None
    is_upper_bound: bool

    def is_primitive_type(self) -> bool:
        """True for a type that is not a message."""
        return self.pkg_name is None


@dataclass(frozen=True, slots=True)
class Field:
    """A field, its type and its default."""

    name: str
    type: Type
    default_value: Any


@dataclass(frozen=True, slots=True)
class Constant:
    """A constant, its type and its value."""

    name: str
    type: str
    value: Any


@dataclass(frozen=True, slots=True)
class MessageSpecification:
    """A message."""

    pkg_name: str
    msg_name: str
    fields: list[Field]
    constants: list[Constant]


def parse_message_string(pkg_name: str, msg_name: str, message_string: str) -> MessageSpecification:
    """Read a definition. Raises DefinitionError, which says on which line it cannot be read."""
    found = parse_message(message_string, f"{pkg_name}/{msg_name}", source="", distro=JAZZY)
    return MessageSpecification(
        pkg_name,
        msg_name,
        [Field(each.name, _type(each.type), each.default) for each in found.fields],
        [Constant(each.name, each.type.name, each.value) for each in found.constants],
    )


def _type(written: WrittenType) -> Type:
    package, _, name = written.name.rpartition("/")
    size = written.bound if written.length is None else written.length
    return Type(
        package or None, name, written.string_bound, written.is_array, size, written.bound is not None
    )
