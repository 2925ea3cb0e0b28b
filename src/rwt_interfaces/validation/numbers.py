"""Numbers as they come (Python's, numpy's, JSON's) checked against ROS's number types (JSN-21 to JSN-24)."""

from __future__ import annotations

import math
import struct
import sys
from functools import lru_cache
from numbers import Integral, Real
from typing import TYPE_CHECKING, Annotated, Any, Final

import msgspec

from rwt_interfaces import field_types
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.validation.mismatch import describe, under

if TYPE_CHECKING:
    import numpy as np

#: msgspec keeps bounds in an int64, which uint64's upper one does not fit.
_LARGEST_BOUND = (1 << 63) - 1
#: Subscripted at run time, which a checker cannot follow.
LIST: Any = list
_FLOAT32 = struct.Struct("f")
#: Numbers from which a look at them with numpy is quicker.
_MANY = 512
_to_msgpack: Final = msgspec.msgpack.Encoder().encode
#: A float in MessagePack, its first byte, and how long the beginning of a list may be there.
_FLOAT_RECORD, _FLOAT_MARK, _LIST_HEADS = 9, 0xCB, (1, 3, 5)
#: The two zeros there.
_ZEROS: Final = (b"\xcb" + bytes(8), b"\xcb\x80" + bytes(7))
#: First bytes of doubles with the exponent of a float32 (but for the smallest), and bytes that end in zeros.
_USUAL_EXPONENT: Final = bytes(byte for byte in range(256) if byte & 0x7F > 0x38)
_SHORT_MANTISSA: Final = bytes(range(0, 256, 1 << 5))


def as_int(value: object, type: field_types.Int) -> int:
    """Return the value as an integer of that type; no float is one, not even 1.0, and no bool (JSN-22)."""
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise InvalidMessage("", f"expected {type}, got {describe(value)}")
    number = int(value)
    if not type.low <= number <= type.high:
        raise InvalidMessage("", f"expected {type}, got {describe(number)}, which is out of range")
    return number


def as_float(value: object, type: field_types.Float) -> float:
    """Return the value as a float: integers are accepted (JSN-21), and null is NaN, as JSON writes it."""
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InvalidMessage("", f"expected {type}, got {describe(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
        value = "a very large integer"
    else:
        if type.code == "d":
            return number
        if not abs(number) > field_types.FLOAT32_LIMIT or math.isinf(number):
            return float32(number)
    raise InvalidMessage("", f"expected {type}, got {describe(value)}, which is out of range")


def float32(number: float) -> float:
    """Return the float32 nearest to a number in its range."""
    nearest: float = _FLOAT32.unpack(_FLOAT32.pack(number))[0]
    return nearest


def float32_list(numbers: list[Any]) -> list[float]:
    """Return the float32s nearest to numbers in its range, infinities and NaN among them."""
    nearest: list[Any] = memoryview(struct.pack(f"{len(numbers)}f", *numbers)).cast("f").tolist()
    return nearest


def are_float32(numbers: list[Any]) -> bool | None:
    """Return True if all numbers, within float32's range, are float32; None if that takes a closer look.

    The bits of doubles in MessagePack show it: the last 29 of a float32 are zero. Taking every ninth byte is
    ten times as fast as converting the numbers.
    """
    data = _to_msgpack(numbers)
    begin = len(data) - _FLOAT_RECORD * len(numbers)
    if begin not in _LIST_HEADS:  # Not all are floats.
        return None
    zeros = bytes(len(numbers))
    last = begin + _FLOAT_RECORD - 1
    if (
        data[last::_FLOAT_RECORD] != zeros
        or data[last - 1 :: _FLOAT_RECORD] != zeros
        or data[last - 2 :: _FLOAT_RECORD] != zeros
        or data[last - 3 :: _FLOAT_RECORD].translate(None, _SHORT_MANTISSA)
    ):
        return False
    unusual = data[begin + 1 :: _FLOAT_RECORD].translate(None, _USUAL_EXPONENT)
    return True if not unusual or len(unusual) == sum(map(data.count, _ZEROS)) else None


def loaded_doubles(numbers: list[Any]) -> np.ndarray | None:
    """Return the numbers of a list as an array, if they are many, numpy is loaded and all are floats.

    MessagePack writes a float as a byte that says so and eight of the number, which takes a quarter of the
    time that numpy needs for a list.
    """
    from_buffer = getattr(sys.modules.get("numpy"), "frombuffer", None)
    if from_buffer is None or len(numbers) <= _MANY:
        return None
    try:
        data = _to_msgpack(numbers)
    except (TypeError, ValueError, OverflowError, RecursionError):
        return None
    begin = len(data) - _FLOAT_RECORD * len(numbers)
    if begin not in _LIST_HEADS:
        return None
    records = from_buffer(data, [("kind", "u1"), ("value", ">f8")], offset=begin)
    values: np.ndarray = records["value"]
    return values if (records["kind"] == _FLOAT_MARK).all() else None


def int_annotation(type: field_types.Int) -> object:
    """Return the integer as msgspec checks it; uint64's upper bound is checked by the decoder."""
    if type.high > _LARGEST_BOUND:
        return Annotated[int, msgspec.Meta(ge=type.low)]
    return Annotated[int, msgspec.Meta(ge=type.low, le=type.high)]


def float_annotation(type: field_types.Float, *, has_nulls: bool = True) -> object:
    """Return the float as msgspec checks it; None stands for null, if there may be any."""
    limit = field_types.FLOAT32_LIMIT
    kind: Any = float if type.code == "d" else Annotated[float, msgspec.Meta(ge=-limit, le=limit)]
    return kind | None if has_nulls else kind


@lru_cache(maxsize=32)
def _list_annotation(type: field_types.Int | field_types.Float) -> Any:
    return LIST[int_annotation(type) if isinstance(type, field_types.Int) else float_annotation(type)]


def number_list(value: Any, type: field_types.Int | field_types.Float) -> list[Any]:
    """Return a new list of checked numbers, in one pass of compiled code if all are plain."""
    doubles = loaded_doubles(value) if type.code == "f" and value.__class__ is list else None
    if doubles is not None:
        sizes = abs(doubles)
        if not ((sizes > field_types.FLOAT32_LIMIT) & (sizes < math.inf)).any():
            nearest: list[Any] = doubles.astype("f4").tolist()
            return nearest
    try:
        numbers: list[Any] = msgspec.convert(value, _list_annotation(type))
    except (msgspec.ValidationError, TypeError, UnicodeEncodeError):  # by half a surrogate
        if type.code == "f":
            return _float32_list(value, type)
        return _one_by_one(value, type)
    if isinstance(type, field_types.Float):
        if None in numbers:
            numbers = [math.nan if number is None else number for number in numbers]
        return float32_list(numbers) if type.code == "f" else numbers
    if type.high > _LARGEST_BOUND and numbers and max(numbers) > type.high:
        return _one_by_one(value, type)
    return numbers


def _float32_list(value: Any, type: field_types.Int | field_types.Float) -> list[Any]:
    """Check float32 numbers with infinities, which laser scans contain and range checks reject."""
    try:
        numbers: list[Any] = msgspec.convert(value, list[float | None])
        if None in numbers:
            numbers = [math.nan if number is None else number for number in numbers]
        struct.pack(f"<{len(numbers)}f", *numbers)
    except (msgspec.ValidationError, TypeError, OverflowError, UnicodeEncodeError):
        return _one_by_one(value, type)
    return float32_list(numbers)


def _one_by_one(value: Any, type: field_types.Int | field_types.Float) -> list[Any]:
    numbers: list[Any] = []
    for index, item in enumerate(value):
        try:
            numbers.append(as_int(item, type) if isinstance(type, field_types.Int) else as_float(item, type))
        except InvalidMessage as error:
            raise under(f"[{index}]", error) from None
    return numbers


_MOST_WIDENED: Final = 1 << 24
"""Bytes of an array of numbers more than twice as wide as received; filling more takes too long."""


def is_numpy_array(value: object) -> bool:
    """Return True for a numpy array, without importing numpy."""
    # Another thread may be halfway through importing it, and no value is of a class that is not there yet.
    array = getattr(sys.modules.get("numpy"), "ndarray", None)
    return array is not None and isinstance(value, array)


def array_from_numpy(value: Any, type: field_types.Int | field_types.Float | field_types.Bool) -> np.ndarray:
    """Return a flat, read-only copy in exactly the element's type; raises InvalidMessage if a value does not
    fit.

    Integers may become floats, floats never integers, and bool stays by itself, as for single values.
    """
    import numpy as np

    kind = value.dtype.kind
    code = "?" if isinstance(type, field_types.Bool) else type.code
    accepted = {"?": "b", "f": "iuf", "d": "iuf"}.get(code, "iu")
    if kind not in accepted:
        raise InvalidMessage("", f"expected {type} elements, got a numpy array of {value.dtype}")
    target = np.dtype(code)
    if isinstance(type, field_types.Int) and value.size and not np.can_cast(value.dtype, target):
        _refuse_outside(value, int(value.min()) < type.low or int(value.max()) > type.high, type)
    if code == "f" and not np.can_cast(value.dtype, target):
        finite = value[np.isfinite(value)]
        _refuse_outside(value, finite.size and float(np.abs(finite).max()) > field_types.FLOAT32_LIMIT, type)
    if target.itemsize > 2 * value.dtype.itemsize and value.size * target.itemsize > _MOST_WIDENED:
        raise InvalidMessage(
            "", f"expected {type} elements, got {value.size} of {value.dtype}: send so many as {target}"
        )
    copy = np.array(value, dtype=target, order="C", copy=True).reshape(-1)
    copy.setflags(write=False)
    return copy


def _refuse_outside(
    value: Any, outside: object, type: field_types.Int | field_types.Float | field_types.Bool
) -> None:
    if outside:
        raise InvalidMessage("", f"expected {type} elements, got a numpy array with values out of range")


def little_endian(items: Any, code: str) -> bytes:
    """Return checked numbers, a list or array, as packed little-endian elements of a :mod:`struct` letter."""
    if code == "?":
        return bytes(items)
    if is_numpy_array(items):
        packed: bytes = items.astype(f"<{code}", copy=False).tobytes()
        return packed
    return struct.pack(f"<{len(items)}{code}", *items)
