"""`rosidl_adapter.parser`: parser of `.msg` files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rwt_interfaces.definitions.model import WrittenType
from rwt_interfaces.definitions.parser import parse_message
from rwt_interfaces.distro import JAZZY


@dataclass(frozen=True, slots=True)
class Type:
    """Type of a field.

    Attributes:
        pkg_name: package of a message; None for a primitive.
        type: name of the message or primitive.
        string_upper_bound: maximum length of a string, or None.
        is_array: True for an array or a sequence.
        array_size: size of an array, or bound of a sequence; None for others.
        is_upper_bound: True if `array_size` is a bound.
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
    """Field with type and default."""

    name: str
    type: Type
    default_value: Any


@dataclass(frozen=True, slots=True)
class Constant:
    """Constant with type and value."""

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
    """Parse a definition. Raises DefinitionError with the line."""
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
