"""Field types, resolved for one distribution; all serialisations are compiled from them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rwt_interfaces.distro import Distro

if TYPE_CHECKING:
    from rwt_interfaces.definitions.model import WrittenType
    from rwt_interfaces.registry import Registry
    from rwt_interfaces.structs import MessageType

#: Largest double that still rounds to a finite float32: just under 2**128 - 2**103.
FLOAT32_LIMIT = 3.4028235677973362e38


@dataclass(frozen=True, slots=True)
class Bool:
    """``bool``."""

    def __str__(self) -> str:
        return "bool"


@dataclass(frozen=True, slots=True)
class Int:
    """Integer; `code` is its :mod:`struct` letter, `low` and `high` are inclusive."""

    name: str
    code: str
    low: int
    high: int

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Float:
    """``float32`` (code ``f``) or ``float64`` (code ``d``)."""

    name: str
    code: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class String:
    """``string`` or ``wstring``; `bound` counts characters."""

    bound: int | None = None
    wide: bool = False

    def __str__(self) -> str:
        name = "wstring" if self.wide else "string"
        return name if self.bound is None else f"{name}<={self.bound}"


@dataclass(frozen=True, slots=True)
class Time:
    """Time or duration: whole seconds and nanoseconds under the names in `keys` (JSN-05)."""

    is_duration: bool
    keys: tuple[str, str]
    seconds: Int
    nanoseconds: Int

    def __str__(self) -> str:
        return "duration" if self.is_duration else "time"


@dataclass(frozen=True, slots=True)
class Octets:
    """``uint8[]``, ``char[]`` and their fixed forms: base64 in JSON (JSN-01), bytes in Python."""

    length: int | None = None

    def __str__(self) -> str:
        return "uint8[]" if self.length is None else f"uint8[{self.length}]"


@dataclass(frozen=True, slots=True)
class Message:
    """Nested message."""

    type: MessageType

    def __str__(self) -> str:
        return self.type.name


@dataclass(frozen=True, slots=True)
class Array:
    """List of `element`: exactly `length`, at most `bound`, or any number."""

    element: Scalar
    length: int | None = None
    bound: int | None = None

    def __str__(self) -> str:
        if self.length is not None:
            return f"{self.element}[{self.length}]"
        return f"{self.element}[]" if self.bound is None else f"{self.element}[<={self.bound}]"


Scalar = Bool | Int | Float | String | Time | Message
FieldType = Scalar | Octets | Array


@dataclass(frozen=True, slots=True)
class Slot:
    """Field of a message.

    Attributes:
        name: name in ROS and on the wire.
        attribute: name in Python; keywords get an underscore appended (``from`` is ``from_``).
    """

    name: str
    attribute: str
    type: FieldType
    default: object | None


def leaves(message: MessageType, path: tuple[Slot, ...] = ()) -> Iterator[tuple[tuple[Slot, ...], FieldType]]:
    """Yield the fields of a message that are no messages, those of nested ones included, with their paths."""
    for slot in message.slots:
        if isinstance(slot.type, Message):
            yield from leaves(slot.type.type, (*path, slot))
        else:
            yield (*path, slot), slot.type


def attributes(path: tuple[Slot, ...]) -> tuple[str, ...]:
    """Return the attributes that lead to a field."""
    return tuple(slot.attribute for slot in path)


def _int(name: str, code: str, bits: int, signed: bool) -> Int:
    return (
        Int(name, code, -(1 << bits - 1), (1 << bits - 1) - 1)
        if signed
        else Int(name, code, 0, (1 << bits) - 1)
    )


_INTS = {
    each.name: each
    for code, bits in zip("bhiq", (8, 16, 32, 64), strict=True)
    for each in (_int(f"int{bits}", code, bits, True), _int(f"uint{bits}", code.upper(), bits, False))
}
#: The element of :class:`Octets`.
UINT8 = _INTS["uint8"]
#: ROS 1's byte is an old name of int8; ROS 2's is an octet.
_BYTE = {True: _int("byte", "b", 8, True), False: _int("byte", "B", 8, False)}
#: The element of most arrays of numbers.
FLOAT32 = Float("float32", "f")
_SCALARS: dict[str, Scalar] = {
    **_INTS,
    "bool": Bool(),
    "char": _int("char", "B", 8, False),
    "float32": FLOAT32,
    "float64": Float("float64", "d"),
}
_BUILTIN_TIMES = {"builtin_interfaces/Time": False, "builtin_interfaces/Duration": True}


def time_type(name: str, distro: Distro) -> Time | None:
    """Return the time type called `name`, or None.

    ROS 2's times are messages with fixed names and signs. ROS 1's are primitives, spelled as the distribution
    spells times; only durations may be negative.
    """
    nanoseconds = _INTS["uint32"]
    if name in _BUILTIN_TIMES:
        return Time(_BUILTIN_TIMES[name], ("sec", "nanosec"), _INTS["int32"], nanoseconds)
    if name == "time":
        return Time(False, distro.time_fields, nanoseconds, nanoseconds)
    if name == "duration":
        return Time(True, distro.time_fields, _INTS["int32"], _INTS["int32"])
    return None


def field_type_of(field: WrittenType, types: Registry) -> FieldType:
    """Resolve one field's type; raises UnknownType for a nested message without a definition."""
    if not field.is_array:
        return _scalar(field, types)
    # JSN-02: a bounded sequence of uint8 is a list, unlike the free and the fixed one.
    if field.name in ("uint8", "char") and field.bound is None:
        return Octets(field.length)
    return Array(_scalar(field, types), field.length, field.bound)


def _scalar(field: WrittenType, types: Registry) -> Scalar:
    name = field.name
    if name in _SCALARS:
        return _SCALARS[name]
    if name in ("string", "wstring"):
        return String(field.string_bound, name == "wstring")
    if name == "byte":
        return _BYTE[types.distro.byte_is_signed]
    return time_type(name, types.distro) or Message(types.message(name))
