"""Fields of message classes: defaults, accepted values, and their values in the graph.

The form in the graph is that of `rwt_interfaces`: octets as `bytes`, numbers as Python's, long arrays of
numbers as numpy's. The form in a message is rosidl's: `array.array` for sequences of numbers, numpy for
arrays of a fixed length, `bytes` of one octet for `byte`.
"""

from __future__ import annotations

import math
import sys
from array import array
from collections import UserList, UserString
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import contextmanager
from ctypes import c_float
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias, cast

import numpy as np

from rwt_interfaces.definitions.model import Field, WrittenType
from rwt_rclpy.messages import slot_types
from rwt_rclpy.messages.slot_types import (
    AbstractNestableType,
    Array,
    BasicType,
    BoundedSequence,
    BoundedString,
    BoundedWString,
    NamespacedType,
    SlotType,
    UnboundedSequence,
    UnboundedString,
    UnboundedWString,
)

Check: TypeAlias = Callable[[Any], Any]
"""Returns the stored form of an assigned value, or raises AssertionError like rosidl's setters."""
Convert: TypeAlias = Callable[[Any], Any]

#: IDL's names of the primitives of `.msg` files; a `char` of ROS 2 is a uint8.
#: rosidl's limit in Python, a little less than the largest value.
_FLOAT32_LIMIT = 3.402823466e38
_IDL = {"bool": "boolean", "byte": "octet", "char": "uint8", "float32": "float", "float64": "double"}
#: typecode of sequences in `array.array`, and dtype of numpy arrays, by number type.
NUMBER_CODES = {
    "float": "f",
    "double": "d",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
}
#: Length below which sequences of numbers are lists in the graph: a numpy array would cost more.
_SHORT = 32


@dataclass(frozen=True, slots=True)
class MessageField:
    """Field of a message class.

    Attributes:
        name: name in the definition.
        type: entry in `SLOT_TYPES`.
        type_text: entry in `get_fields_and_field_types()`.
        default: creates the default value.
        check: checks and converts an assigned value.
        store: converts an assigned value if checks are off.
        to_graph: converts the message's form to the graph's; None if both are equal.
        from_graph: converts the graph's form to the message's; None if both are equal.
        thaw: converts the stored form to the program's on first access; None if both are equal.
    """

    name: str
    type: SlotType
    type_text: str
    default: Callable[[], Any]
    check: Check
    store: Check
    to_graph: Convert | None
    from_graph: Convert | None
    thaw: Convert | None = None


@dataclass(frozen=True, slots=True)
class Nested:
    """Class of a nested message, with its conversions."""

    cls: type
    name: str
    namespaces: tuple[str, str]
    to_graph: Convert
    from_graph: Convert


def message_field(field: Field, nested: Callable[[str], Nested]) -> MessageField:
    """Compile a field; `nested` finds the class of a message by its two-part name."""
    written = field.type
    inner = None if written.is_primitive else nested(written.name)
    element = _element_type(written, inner)
    if not written.is_array:
        return _scalar(field, element, inner)
    if isinstance(element, BasicType) and element.typename in NUMBER_CODES:
        return _number_field(field, element)
    return _items(field, element, inner)


def _element_type(written: WrittenType, inner: Nested | None) -> AbstractNestableType:
    if inner is not None:
        return NamespacedType(inner.namespaces, inner.name)
    if written.name == "string":
        return UnboundedString() if written.string_bound is None else BoundedString(written.string_bound)
    if written.name == "wstring":
        return UnboundedWString() if written.string_bound is None else BoundedWString(written.string_bound)
    return BasicType(_IDL.get(written.name, written.name))


def _element_text(written: WrittenType, element: AbstractNestableType) -> str:
    if isinstance(element, BasicType):
        return element.typename
    if isinstance(element, NamespacedType):
        return f"{element.namespaces[0]}/{element.name}"
    text = "wstring" if isinstance(element, slot_types.AbstractWString) else "string"
    return text if written.string_bound is None else f"{text}<{written.string_bound}>"


def _sequence_type(written: WrittenType, element: AbstractNestableType) -> tuple[SlotType, str]:
    text = _element_text(written, element)
    if written.length is not None:
        return Array(element, written.length), f"{text}[{written.length}]"
    if written.bound is not None:
        return BoundedSequence(element, written.bound), f"sequence<{text}, {written.bound}>"
    return UnboundedSequence(element), f"sequence<{text}>"


# Scalars


def _scalar(field: Field, element: AbstractNestableType, inner: Nested | None) -> MessageField:
    check = _element_check(field.name, element, inner)
    to_graph, from_graph = _element_conversions(element, inner)
    default = (
        _element_default(element, inner) if field.default is None else partial(_same, _held(field, element))
    )
    return MessageField(
        field.name,
        cast("SlotType", element),
        _element_text(field.type, element),
        default,
        check,
        _same,
        to_graph,
        from_graph,
    )


def _held(field: Field, element: AbstractNestableType) -> Any:
    value: Any = field.default
    if isinstance(element, BasicType):
        if element.typename == "octet":
            return bytes([value])
        if element.typename in slot_types.FLOATING_POINT_TYPES:
            return float(value)
    return value


def _same(value: Any) -> Any:
    return value


def _element_default(element: AbstractNestableType, inner: Nested | None) -> Callable[[], Any]:
    if inner is not None:
        return inner.cls
    if isinstance(element, BasicType):
        if element.typename == "octet":
            return partial(_same, b"\0")
        if element.typename == "boolean":
            return bool
        return float if element.typename in slot_types.FLOATING_POINT_TYPES else int
    return str


def _element_conversions(
    element: AbstractNestableType, inner: Nested | None
) -> tuple[Convert | None, Convert | None]:
    if inner is not None:
        return inner.to_graph, inner.from_graph
    if isinstance(element, BasicType):
        if element.typename == "octet":
            return _octet_to_graph, _octet_from_graph
        # Published values are rounded as on a wire.
        return (_float32, None) if element.typename == "float" else (None, None)
    return _text, None


def _octet_to_graph(value: Any) -> int:
    return int(value[0])


def _octet_from_graph(value: int) -> bytes:
    return bytes((value,))


def _float32(value: float) -> float:
    return c_float(value).value


def _text(value: Any) -> str:
    """Return a string that can be sent. Raises UnicodeEncodeError, or TypeError for other types."""
    if not isinstance(value, (str, UserString)):
        raise TypeError(f"expected str, got {type(value).__name__}")
    text = str(value)
    if not text.isascii():
        text.encode()
    return text


def _element_check(name: str, element: AbstractNestableType, inner: Nested | None) -> Check:
    if inner is not None:
        return partial(_check_message, name, inner.cls)
    if isinstance(element, BasicType):
        kind = element.typename
        if kind == "boolean":
            return partial(_check_bool, name)
        if kind == "octet":
            return partial(_check_octet, name)
        if kind in slot_types.FLOATING_POINT_TYPES:
            return partial(_check_float, name, _FLOAT32_LIMIT if kind == "float" else math.inf)
        return partial(_check_int, name, kind, *_range(kind))
    bound = element.maximum_size if isinstance(element, (BoundedString, BoundedWString)) else None
    return partial(_check_string, name, bound)


def _wrong(name: str, expected: str) -> AssertionError:
    return AssertionError(f"The '{name}' field must be {expected}")


def _integer(kind: str) -> str:
    return "an unsigned integer" if kind.startswith("u") else "an integer"


def _items_text(written: WrittenType, element: AbstractNestableType) -> str:
    """Return what rosidl's setters say of a sequence or an array."""
    length = ""
    if written.length is not None:
        length = f" with length {written.length}"
    elif written.bound is not None:
        length = f" with length <= {written.bound}"
    return f"a set or sequence{length} and each value of type {_each_text(element)}"


def _each_text(element: AbstractNestableType) -> str:
    if isinstance(element, NamespacedType):
        return f"'{element.name}'"
    if not isinstance(element, BasicType):
        return "'str'"
    kind = element.typename
    if kind in slot_types.FLOATING_POINT_TYPES:
        limit = f"{_FLOAT32_LIMIT if kind == 'float' else sys.float_info.max:.6f}"
        return f"'float' and each {kind} in [-{limit}, {limit}]"
    if kind in ("boolean", "octet"):
        return {"boolean": "'bool'", "octet": "'bytes'"}[kind]
    low, high = _range(kind)
    return f"'int' and each {_integer(kind).partition(' ')[2]} in [{low}, {high}]"


def _range(kind: str) -> tuple[int, int]:
    """Return the smallest and largest value of an integer type."""
    bits = int(kind.lstrip("uint"))
    return (0, (1 << bits) - 1) if kind.startswith("u") else (-(1 << bits - 1), (1 << bits - 1) - 1)


@contextmanager
def _as_items(name: str, text: str) -> Iterator[None]:
    """Raise the error of an element as that of the whole field."""
    try:
        yield
    except AssertionError:
        raise _wrong(name, text) from None


def _check_message(name: str, cls: type, value: Any) -> Any:
    if not isinstance(value, cls):
        raise _wrong(name, f"a sub message of type '{cls.__name__}'")
    return value


def _check_bool(name: str, value: Any) -> Any:
    if not isinstance(value, bool):
        raise _wrong(name, "of type 'bool'")
    return value


def _check_octet(name: str, value: Any) -> Any:
    if not isinstance(value, (bytes, bytearray)) or len(value) != 1:
        raise _wrong(name, "of type 'bytes' or 'ByteString' with length 1")
    return value


def _check_float(name: str, bound: float, value: Any) -> Any:
    if not isinstance(value, float):
        raise _wrong(name, "of type 'float'")
    if abs(value) > bound and not math.isinf(value):
        raise _wrong(name, f"a float in [-{bound}, {bound}]")
    return value


def _check_int(name: str, kind: str, low: int, high: int, value: Any) -> Any:
    if not isinstance(value, int):
        raise _wrong(name, "of type 'int'")
    if not low <= value <= high:
        raise _wrong(name, f"{_integer(kind)} in [{low}, {high}]")
    return value


def _check_string(name: str, bound: int | None, value: Any) -> Any:
    if not isinstance(value, (str, UserString) if bound is not None else str):
        raise _wrong(name, "of type 'str'" if bound is None else f"string value not longer than {bound}")
    if bound is not None and len(value) > bound:
        raise _wrong(name, f"string value not longer than {bound}")
    return value


# Sequences and arrays of numbers


def _number_field(field: Field, element: BasicType) -> MessageField:
    written, kind = field.type, element.typename
    code = NUMBER_CODES[kind]
    slot_type, text = _sequence_type(written, element)
    check_one, shown = _element_check(field.name, element, None), _items_text(written, element)
    octets = written.name in ("uint8", "char") and written.bound is None
    given = () if field.default is None else _as_tuple(field.default)
    if written.length is not None:
        dtype = np.dtype({"float": "float32", "double": "float64"}.get(kind, kind))
        start = np.zeros(written.length, dtype) if field.default is None else np.array(given, dtype)
        return MessageField(
            field.name,
            slot_type,
            text,
            start.copy,
            partial(_check_fixed, field.name, dtype, written.length, shown, check_one),
            partial(np.array, dtype=dtype),
            _bytes_of if octets else _list_or_numpy,
            partial(_fixed_from_graph, dtype),
        )
    sequence = partial(MessageField, field.name, slot_type, text, partial(array, code, given))
    if octets:
        check: Check = partial(_check_octets, field.name, shown, check_one)
        return sequence(check, _store_octets, _octets_to_graph, _octets_from_graph, _thawed)
    check = partial(_check_numbers, field.name, code, written.bound, shown, check_one)
    return sequence(check, partial(_numbers, code), _list_or_numpy, partial(_numbers, code))


def _as_tuple(default: object) -> tuple[Any, ...]:
    return tuple(default) if isinstance(default, (tuple, list)) else (default,)


def _numbers(code: str, value: Any) -> array[Any]:
    """Return numbers of any form as rosidl stores them."""
    if isinstance(value, np.ndarray):
        return array(code, np.ascontiguousarray(value.ravel(), np.dtype(code)).tobytes())
    return array(code, value)


def _check_numbers(
    name: str, code: str, bound: int | None, text: str, check_one: Check, value: Any
) -> array[Any]:
    if isinstance(value, array):
        if value.typecode != code:
            raise AssertionError(f"The '{name}' array.array() must have the type code of '{code}'")
        if bound is not None and len(value) > bound:
            raise AssertionError(f"The '{name}' array.array() must have a size <= {bound}")
        return value[:]
    if bound is not None and len(value) > bound:
        raise _wrong(name, text)
    if isinstance(value, (bytes, bytearray, memoryview)) and code == "B":
        return array(code, bytes(value))
    _check_sequence(name, text, value)
    with _as_items(name, text):
        for item in value:
            check_one(item)
    return array(code, value)


def _check_sequence(name: str, text: str, value: Any) -> None:
    if not isinstance(value, (Sequence, Set, UserList)) or isinstance(value, (str, UserString)):
        raise _wrong(name, text)


def _check_fixed(
    name: str, dtype: np.dtype[Any], length: int, text: str, check_one: Check, value: Any
) -> np.ndarray:
    if isinstance(value, np.ndarray):
        if value.dtype != dtype:
            raise AssertionError(f"The '{name}' numpy.ndarray() must have the dtype of 'numpy.{dtype}'")
        if value.size != length:
            raise AssertionError(f"The '{name}' numpy.ndarray() must have a size of {length}")
        return value.copy()
    if isinstance(value, (bytes, bytearray, memoryview, array)):
        value = list(value)
    _check_sequence(name, text, value)
    if len(value) != length:
        raise _wrong(name, text)
    with _as_items(name, text):
        return np.array([check_one(item) for item in value], dtype)


# Octets, such as the pixels of an image, are stored as the received bytes, which are immutable
# and therefore shared by the publishing program, the graph and all subscriptions. A program that
# reads the field gets rosidl's `array.array`, which is created then.


def _octets(value: Any) -> bytes | None:
    """Return a value that holds octets only as bytes; None for others."""
    if isinstance(value, (bytes, bytearray, memoryview)):
        return bytes(value)
    return value.tobytes() if isinstance(value, np.ndarray) and value.dtype == np.uint8 else None


def _store_octets(value: Any) -> bytes | array[Any]:
    octets = _octets(value)
    return _numbers("B", value) if octets is None else octets


def _check_octets(name: str, text: str, check_one: Check, value: Any) -> bytes | array[Any]:
    octets = _octets(value)
    return _check_numbers(name, "B", None, text, check_one, value) if octets is None else octets


def _octets_to_graph(value: bytes | array[Any]) -> bytes:
    return value if isinstance(value, bytes) else value.tobytes()


def _octets_from_graph(value: Any) -> bytes | array[Any]:
    return value if isinstance(value, bytes) else _numbers("B", value)


def _thawed(value: bytes | array[Any]) -> array[Any]:
    return array("B", value) if isinstance(value, bytes) else value


def _bytes_of(value: Any) -> bytes:
    """Return a copy of the octets: the program may still change its array."""
    return bytes(value.tobytes())


def _list_or_numpy(value: Any) -> Any:
    """Return a copy of numbers for the graph: a list if there are few, otherwise a numpy array."""
    if len(value) < _SHORT:
        return value.tolist()
    if isinstance(value, array):
        return np.frombuffer(value.tobytes(), np.dtype(value.typecode))
    return value.ravel().copy()


def _fixed_from_graph(dtype: np.dtype[Any], value: Any) -> np.ndarray:
    if isinstance(value, bytes):
        return np.frombuffer(value, dtype).copy()
    return np.array(value, dtype)


# Sequences and arrays of anything else


def _items(field: Field, element: AbstractNestableType, inner: Nested | None) -> MessageField:
    written = field.type
    slot_type, text = _sequence_type(written, element)
    to_graph, from_graph = _element_conversions(element, inner)
    given = None if field.default is None else [_item(each, element) for each in _as_tuple(field.default)]
    make_one, length = _element_default(element, inner), written.length or 0

    def default() -> list[Any]:
        return [make_one() for _ in range(length)] if given is None else list(given)

    check_one = _element_check(field.name, element, inner)
    return MessageField(
        field.name,
        slot_type,
        text,
        default,
        partial(
            _check_items, field.name, written.length, written.bound, _items_text(written, element), check_one
        ),
        _same,
        list if to_graph is None else partial(_each, to_graph),
        list if from_graph is None else partial(_each, from_graph),
    )


def _item(value: Any, element: AbstractNestableType) -> Any:
    return bytes([value]) if isinstance(element, BasicType) and element.typename == "octet" else value


def _each(convert: Convert, values: Any) -> list[Any]:
    return [convert(value) for value in values]


def _check_items(
    name: str, length: int | None, bound: int | None, text: str, check_one: Check, value: Any
) -> Any:
    _check_sequence(name, text, value)
    if length is not None and len(value) != length:
        raise _wrong(name, text)
    if bound is not None and len(value) > bound:
        raise _wrong(name, text)
    with _as_items(name, text):
        for item in value:
            check_one(item)
    return value
