"""The strict Struct of a message: what msgspec accepts with it is exactly what this project itself would
send, spacing and order of fields aside, and may be passed on untouched.

Every field is required, unknown ones are refused, floats may be null, octets are base64, times are spelled as
the distribution spells them. The few flaws that annotations cannot express have tests of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from rwt_interfaces import field_types as shapes
from rwt_interfaces.field_types import Shape
from rwt_interfaces.validation.mismatch import has_lone_surrogate
from rwt_interfaces.validation.numbers import float32, float32_list, float_annotation, int_annotation

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

#: Tells whether a value of some shape has a flaw that no msgspec annotation expresses.
Flaw = Callable[[Any], bool]
#: Subscripted at run time, which a checker cannot follow.
_LIST: Any = list
_UINT64_MAX = (1 << 64) - 1


def strict_struct(message: MessageType) -> type[msgspec.Struct]:
    """Compile it; nested ones are taken from their types."""
    name = message.name.partition("/")[2]
    if message.time is not None:
        return _strict_time(message.time)
    return _define(name, [(slot.attribute, slot.name, _strict(slot.shape)) for slot in message.slots])


@lru_cache(maxsize=8)
def _strict_time(shape: shapes.Time) -> type[msgspec.Struct]:
    halves = zip(shape.keys, (shape.seconds, shape.nanoseconds), strict=True)
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


def _strict(shape: Shape) -> Any:
    match shape:
        case shapes.Bool():
            return bool
        case shapes.Int():
            return int_annotation(shape)
        case shapes.Float():
            return float_annotation(shape)
        case shapes.String():
            return str if shape.bound is None else Annotated[str, msgspec.Meta(max_length=shape.bound)]
        case shapes.Time():
            return _strict_time(shape)
        case shapes.Octets():
            return _sized(bytes, shape.length, None)
        case shapes.Message():
            return shape.type.json.strict
        case shapes.Array():
            return _sized(_LIST[_strict(shape.element)], shape.length, shape.bound)


def _sized(kind: Any, length: int | None, bound: int | None) -> Any:
    if length is not None:
        return Annotated[kind, msgspec.Meta(min_length=length, max_length=length)]
    return kind if bound is None else Annotated[kind, msgspec.Meta(max_length=bound)]


def inexact(shape: Shape) -> Flaw | None:
    """The flaws of numbers.

    A uint64 above its range, since msgspec's bounds end at int64's; and in a float32 field a number that is
    no float32, since ROS sends what is left of it: 0.10000000149011612 for 0.1.
    """
    if isinstance(shape, shapes.Int) and shape.high == _UINT64_MAX:
        return lambda value: bool(value > _UINT64_MAX)
    if isinstance(shape, shapes.Float) and shape.code == "f":
        return lambda value: value is not None and float32(value) != value
    return None


def unsendable(shape: Shape) -> Flaw | None:
    """The flaws of Python's own values: lone surrogates too, which no JSON text brings."""
    if isinstance(shape, shapes.String):
        return lambda text: not text.isascii() and has_lone_surrogate(text)
    return inexact(shape)


def flaw_in(message: MessageType, leaf: Callable[[Shape], Flaw | None]) -> Flaw | None:
    """Looks for flaws anywhere in a message; None if nothing in it can have one."""
    flaws = [(slot.attribute, flaw) for slot in message.slots if (flaw := _shape_flaw(slot.shape, leaf))]
    if not flaws:
        return None
    return lambda value: any(flaw(getattr(value, attribute)) for attribute, flaw in flaws)


def _shape_flaw(shape: Shape, leaf: Callable[[Shape], Flaw | None]) -> Flaw | None:
    match shape:
        case shapes.Message():
            return flaw_in(shape.type, leaf)
        case shapes.Array() if shape.element == shapes.FLOAT32:
            return _has_inexact
        case shapes.Array():
            flaw = _shape_flaw(shape.element, leaf)
            return None if flaw is None else lambda items: any(map(flaw, items))
        case _:
            return leaf(shape)


def _has_inexact(items: list[float | None]) -> bool:
    """Whether not all of the numbers are float32s, in one pass of compiled code."""
    numbers = [item for item in items if item is not None] if None in items else items
    return float32_list(numbers) != numbers
