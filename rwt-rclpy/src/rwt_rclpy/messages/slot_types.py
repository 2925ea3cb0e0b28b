"""`rosidl_parser.definition`: types of fields in `SLOT_TYPES` of message classes.

Only the types are here; IDL files are not parsed, because definitions come from the registry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

SIGNED_INTEGER_TYPES = ("int8", "int16", "int32", "int64")
UNSIGNED_INTEGER_TYPES = ("uint8", "uint16", "uint32", "uint64")
INTEGER_TYPES = (*SIGNED_INTEGER_TYPES, *UNSIGNED_INTEGER_TYPES)
FLOATING_POINT_TYPES = ("float", "double", "long double")
CHARACTER_TYPES = ("char", "wchar")
BOOLEAN_TYPE = "boolean"
OCTET_TYPE = "octet"
BASIC_TYPES = (*INTEGER_TYPES, *FLOATING_POINT_TYPES, *CHARACTER_TYPES, BOOLEAN_TYPE, OCTET_TYPE)


class AbstractType:
    """Base of all types."""

    __slots__ = ()


class AbstractNestableType(AbstractType):
    """Base of types that arrays and sequences can contain."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, repr=False)
class BasicType(AbstractNestableType):
    """Number, boolean or octet; one of :data:`BASIC_TYPES`."""

    typename: str

    def __post_init__(self) -> None:
        if self.typename not in BASIC_TYPES:
            raise AssertionError(f"{self.typename!r} is not a basic type of IDL")


@dataclass(frozen=True, slots=True, init=False, repr=False)
class NamespacedType(AbstractNestableType):
    """Message type; `namespaces` is its package and folder."""

    namespaces: tuple[str, ...]
    name: str

    def __init__(self, namespaces: Sequence[str], name: str) -> None:
        object.__setattr__(self, "namespaces", tuple(namespaces))
        object.__setattr__(self, "name", name)

    def namespaced_name(self) -> tuple[str, ...]:
        """Return package, folder and name."""
        return (*self.namespaces, self.name)


class AbstractGenericString(AbstractNestableType):
    """Base of string types."""

    __slots__ = ()

    def has_maximum_size(self) -> bool:
        """True if the type is bounded."""
        return hasattr(self, "maximum_size")


class AbstractString(AbstractGenericString):
    """Base of strings of octets."""

    __slots__ = ()


class AbstractWString(AbstractGenericString):
    """Base of strings of 16-bit units."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, repr=False)
class UnboundedString(AbstractString):
    """``string``."""


@dataclass(frozen=True, slots=True, repr=False)
class UnboundedWString(AbstractWString):
    """``wstring``."""


@dataclass(frozen=True, slots=True, repr=False)
class BoundedString(AbstractString):
    """``string<=N``."""

    maximum_size: int


@dataclass(frozen=True, slots=True, repr=False)
class BoundedWString(AbstractWString):
    """``wstring<=N``."""

    maximum_size: int


class AbstractNestedType(AbstractType):
    """Base of arrays and sequences.

    Attributes:
        value_type: type of its elements.
    """

    __slots__ = ()

    value_type: AbstractNestableType


class AbstractSequence(AbstractNestedType):
    """Base of sequences, of variable length."""

    __slots__ = ()

    def has_maximum_size(self) -> bool:
        """True if the type is bounded."""
        return hasattr(self, "maximum_size")


@dataclass(frozen=True, repr=False)
class Array(AbstractNestedType):
    """``T[N]``."""

    value_type: AbstractNestableType
    size: int

    def has_maximum_size(self) -> bool:
        """True: the length is fixed."""
        return True


@dataclass(frozen=True, repr=False)
class UnboundedSequence(AbstractSequence):
    """``T[]``."""

    value_type: AbstractNestableType


@dataclass(frozen=True, repr=False)
class BoundedSequence(AbstractSequence):
    """``T[<=N]``."""

    value_type: AbstractNestableType
    maximum_size: int


SlotType = BasicType | NamespacedType | AbstractGenericString | AbstractNestedType
