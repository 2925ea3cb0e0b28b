"""Error texts for values that do not fit their type."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping, Sequence

import msgspec

from rwt_interfaces.errors import InvalidMessage

_LONGEST_QUOTE = 40


def describe(value: object) -> str:
    """Return a short value as JSON, others by kind."""
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case str():
            return quote(value)
        case int():
            return str(value) if value.bit_length() <= 128 else "a very large integer"
        case float():
            return float.__repr__(value)
        case list() | tuple():
            return "a list"
        case Mapping():
            return "an object"
        case bytes() | bytearray() | memoryview():
            return "bytes"
        case _:
            return type(value).__name__.removesuffix("_")  # `bool_` is `bool` since NumPy 2.


def quote(text: str) -> str:
    """Quote a string, truncated and encodable in UTF-8."""
    short = text if len(text) <= _LONGEST_QUOTE else text[:_LONGEST_QUOTE] + "…"
    return json.dumps(short.encode("utf-8", "replace").decode(), ensure_ascii=False)


def under(segment: str, error: InvalidMessage) -> InvalidMessage:
    """Return the mismatch as seen from one level further out: ``x`` under ``linear`` is ``linear.x``."""
    joined = segment + error.path if error.path[:1] in ("", "[") else f"{segment}.{error.path}"
    return InvalidMessage(joined, error.reason)


def with_article(name: str) -> str:
    """Return the name with ``a`` or ``an`` before it."""
    return f"an {name}" if name[:1].lower() in "aeiou" else f"a {name}"


def unknown_field(message: str, names: Sequence[str], given: Iterable[str]) -> str:
    """Return a sentence about the first field, in the alphabet, that the message does not have (JSN-25)."""
    stranger = min(str(key) for key in given if key not in names)
    has = f"it has {', '.join(names)}" if names else "it has no fields"
    return f"{message} has no field {quote(stranger)}; {has}"


def fields_of(value: object) -> Mapping[str, object] | None:
    """Return the fields of a mapping, Struct or dataclass instance by ROS name; None for others."""
    if isinstance(value, Mapping):
        return value
    if isinstance(value, msgspec.Struct):
        attributes = zip(value.__struct_encode_fields__, value.__struct_fields__, strict=True)
        return {name: getattr(value, attribute) for name, attribute in attributes}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    return None


def has_lone_surrogate(text: str) -> bool:
    """Return True if the text cannot be encoded, as in JSON escapes and Python's file names."""
    try:
        # Same result as encoding to UTF-8, in a tenth of the time.
        text.encode("utf-16-le")
    except UnicodeEncodeError:
        return True
    return False


def check_length(count: int, length: int | None, bound: int | None) -> None:
    """Reject a list of the wrong size (JSN-30)."""
    if length is not None and count != length:
        raise InvalidMessage("", f"expected {length} elements, got {count}")
    if bound is not None and count > bound:
        raise InvalidMessage("", f"expected at most {bound} elements, got {count}")
