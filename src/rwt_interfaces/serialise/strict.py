"""Strict Struct of a message: msgspec accepts with it exactly the messages that may be passed on.

All fields are required, unknown ones rejected, floats may be null, octets are base64, and times are spelled
as the distribution does. Flaws that annotations cannot express are checked separately.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import lru_cache
from operator import attrgetter
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from rwt_interfaces import field_types
from rwt_interfaces.field_types import FieldType
from rwt_interfaces.validation.mismatch import has_lone_surrogate
from rwt_interfaces.validation.numbers import (
    LIST,
    are_float32,
    float32,
    float32_list,
    float_annotation,
    int_annotation,
)

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

#: Test for flaws that no msgspec annotation expresses.
Flaw = Callable[[Any], bool]
#: Batch size of the comparison.
_PIECE = 1 << 16
_UINT64_MAX = (1 << 64) - 1


def strict_struct(message: MessageType, *, has_nulls: bool = True) -> type[msgspec.Struct]:
    """Compile the Struct; nested ones come from their types. With `has_nulls`, floats may be null."""
    name = message.name.partition("/")[2]
    if message.time is not None:
        return _strict_time(message.time)
    return _define(
        name,
        [
            (slot.attribute, slot.name, strict_annotation(slot.type, has_nulls=has_nulls))
            for slot in message.slots
        ],
    )


@lru_cache(maxsize=8)
def _strict_time(type: field_types.Time) -> type[msgspec.Struct]:
    halves = zip(type.keys, (type.seconds, type.nanoseconds), strict=True)
    return _define("Time", [(key, key, int_annotation(half)) for key, half in halves])


def _define(name: str, fields: list[tuple[str, str, Any]]) -> type[msgspec.Struct]:
    # Without the garbage collector's tracking decoding is a quarter faster; an immutable tree has no cycles.
    return msgspec.defstruct(
        name,
        [(attribute, annotation) for attribute, _, annotation in fields],
        rename={attribute: encoded for attribute, encoded, _ in fields if attribute != encoded} or None,
        forbid_unknown_fields=True,
        frozen=True,
        gc=False,
    )


def strict_annotation(type: FieldType, *, has_nulls: bool = True) -> Any:
    """Return the annotation of a field that may be passed on; `has_nulls` as for :func:`strict_struct`."""
    match type:
        case field_types.Bool():
            return bool
        case field_types.Int():
            return int_annotation(type)
        case field_types.Float():
            return float_annotation(type, has_nulls=has_nulls)
        case field_types.String():
            return str if type.bound is None else Annotated[str, msgspec.Meta(max_length=type.bound)]
        case field_types.Time():
            return _strict_time(type)
        case field_types.Octets():
            return sized(bytes, type.length, None)
        case field_types.Message():
            return type.type.json.strict if has_nulls else type.type.json.sendable
        case field_types.Array():
            return sized(LIST[strict_annotation(type.element, has_nulls=has_nulls)], type.length, type.bound)


def sized(kind: Any, length: int | None, bound: int | None) -> Any:
    """Return the annotation of octets or a list with its length or bound."""
    if length is not None:
        return Annotated[kind, msgspec.Meta(min_length=length, max_length=length)]
    return kind if bound is None else Annotated[kind, msgspec.Meta(max_length=bound)]


def inexact(type: FieldType) -> Flaw | None:
    """Return a test for numbers that may not be passed on; None if the type has none.

    These are uint64 above its range, since msgspec's bounds end at int64's, and float32 fields with other
    numbers, since ROS sends 0.10000000149011612 for 0.1.
    """
    if isinstance(type, field_types.Int) and type.high == _UINT64_MAX:
        return lambda value: bool(value > _UINT64_MAX)
    if isinstance(type, field_types.Float) and type.code == "f":
        return _is_inexact
    return None


def _is_inexact(number: float | None) -> bool:
    return number is not None and float32(number) != number


def unsendable(type: FieldType) -> Flaw | None:
    """Return a test like :func:`inexact` for Python values, which also finds lone surrogates."""
    if isinstance(type, field_types.String):
        return lambda text: not text.isascii() and has_lone_surrogate(text)
    return inexact(type)


def flaw_in(message: MessageType, leaf: Callable[[FieldType], Flaw | None]) -> Flaw | None:
    """Return a test for flaws anywhere in a message; None if it can have none."""
    flaws = [(slot.attribute, flaw) for slot in message.slots if (flaw := _flaw_of(slot.type, leaf))]
    floats = [name for name, flaw in flaws if flaw is _is_inexact]
    if len(floats) > 1:
        flaws = [each for each in flaws if each[0] not in floats]
    if not flaws and not floats:
        return None
    float_flaw = _inexact_among(floats) if len(floats) > 1 else None

    def has_flaw(value: Any) -> bool:
        if float_flaw is not None and float_flaw(value):
            return True
        for attribute, flaw in flaws:  # noqa: SIM110 - a generator costs a call per field.
            if flaw(getattr(value, attribute)):
                return True
        return False

    return has_flaw


def _inexact_among(attributes: list[str]) -> Flaw:
    """Return a test of several float32 fields of a message at once."""
    fetch, packed = attrgetter(*attributes), struct.Struct(f"{len(attributes)}f")

    def test(value: Any) -> bool:
        numbers = fetch(value)
        if None in numbers:
            return any(map(_is_inexact, numbers))
        return packed.unpack(packed.pack(*numbers)) != numbers

    return test


def _flaw_of(type: FieldType, leaf: Callable[[FieldType], Flaw | None]) -> Flaw | None:
    match type:
        case field_types.Message():
            return flaw_in(type.type, leaf)
        case field_types.Array() if type.element == field_types.FLOAT32 and leaf(type.element) is not None:
            return _has_inexact
        case field_types.Array():
            flaw = _flaw_of(type.element, leaf)
            return None if flaw is None else lambda items: any(map(flaw, items))
        case _:
            return leaf(type)


def array_reader(type: field_types.Array) -> Callable[[bytes], tuple[list[Any], bool]]:
    """Return a decoder of array texts, with null as NaN and exact messages as strict Structs.

    It also returns True if the text may be passed on, and raises msgspec.MsgspecError for invalid numbers.
    """
    decode: Callable[[bytes], list[Any]] = msgspec.json.Decoder(strict_annotation(type)).decode
    if type.element == field_types.FLOAT32:
        return lambda text: _nearest(decode(text))
    if isinstance(type.element, field_types.Float):
        return lambda text: (_with_nan(decode(text)), True)
    flaw = _flaw_of(type, inexact)
    if flaw is None:
        return lambda text: (decode(text), True)

    def read(text: bytes) -> tuple[list[Any], bool]:
        numbers = decode(text)
        if flaw(numbers):
            raise msgspec.ValidationError
        return numbers, True

    return read


def _with_nan(numbers: list[float | None]) -> list[Any]:
    return [math.nan if each is None else each for each in numbers] if None in numbers else numbers


def _nearest(numbers: list[float | None]) -> tuple[list[float], bool]:
    if None in numbers:
        return float32_list(_with_nan(numbers)), not _has_inexact(numbers)
    nearest = float32_list(numbers)
    return nearest, nearest == numbers


def _has_inexact(items: list[float | None]) -> bool:
    """Return True if not all numbers are float32, in one pass of compiled code."""
    # Piece by piece, since each copy of all the numbers takes as much memory as the message.
    pieces = (
        (items,) if len(items) <= _PIECE else (items[at : at + _PIECE] for at in range(0, len(items), _PIECE))
    )
    return any(map(_piece_has_inexact, pieces))


def _piece_has_inexact(items: list[float | None]) -> bool:
    exact = are_float32(items)
    if exact is not None:
        return not exact
    numbers = [item for item in items if item is not None]
    return not are_float32(numbers) and float32_list(numbers) != numbers
