"""Values in frames: JSON, and the additional types of CBOR."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TypeAlias, Union, cast

Json: TypeAlias = Union[bool, int, float, str, list["Json"], dict[str, "Json"], None]  # noqa: UP007 - `|` cannot join a string
"""Result of `json.loads`."""

Value: TypeAlias = Union[bool, int, float, str, bytes, "Tagged", list["Value"], dict[str, "Value"], None]
"""Decoded value of a frame, from JSON or CBOR."""


@dataclass(frozen=True, slots=True)
class Tagged:
    """CBOR tag (RFC 8949 section 3.4) with its content."""

    tag: int
    content: Value


def as_value(value: Json) -> Value:
    """Return the same value, typed: type checkers do not accept lists and dicts as JSON values."""
    return cast(Value, value)


class NarrowFloat(float):
    """CBOR float of 16 or 32 bits (CBR-05 requires 64)."""

    __slots__ = ()


class NotJson(ValueError):
    """A text is not one JSON document; the message gives the reason."""


def _refuse_constant(token: str) -> float:
    raise NotJson(f"{token} is not a JSON token")


def read_json(text: str) -> Json:
    """Parse one JSON document without NaN and Infinity (RFC 8259).

    Raises:
        NotJson: the text is not valid.
    """
    try:
        value: Json = json.loads(text, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise NotJson(f"{error.msg} at character {error.pos}") from error
    except RecursionError as error:
        raise NotJson("nested too deeply to read") from error
    return value


def as_text(value: Value) -> str:
    """Return a value in one line for people: JSON, with a notation for bytes and tags."""
    return json.dumps(_printable(value), ensure_ascii=False)


def _printable(value: Value) -> Json:
    if isinstance(value, bytes):
        return {"$bytes": value.hex()}
    if isinstance(value, Tagged):
        return {"$tag": value.tag, "$content": _printable(value.content)}
    if isinstance(value, list):
        return [_printable(item) for item in value]
    if isinstance(value, dict):
        return {key: _printable(item) for key, item in value.items()}
    return value


def shorten(text: str) -> str:
    """Return the text of a frame in one line."""
    return text if len(text) <= 300 else f"{text[:240]}… ({len(text)} characters)"
