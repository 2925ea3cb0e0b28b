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
    """A CBOR tag (RFC 8949 section 3.4) and what it is put on."""

    tag: int
    content: Value


def as_value(value: Json) -> Value:
    """The same value: every JSON value is one, though lists and dicts do not say so to a type checker."""
    return cast(Value, value)


class NarrowFloat(float):
    """A CBOR float that came in 16 or 32 bits (CBR-05 wants 64)."""

    __slots__ = ()


class NotJson(ValueError):
    """Text that is not one JSON document; the text says why."""


def _refuse_constant(token: str) -> float:
    raise NotJson(f"{token} is not a JSON token")


def read_json(text: str) -> Json:
    """One JSON document, with NaN and Infinity refused as RFC 8259 says.

    Raises:
        NotJson: it is something else.
    """
    try:
        value: Json = json.loads(text, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise NotJson(f"{error.msg} at character {error.pos}") from error
    except RecursionError as error:
        raise NotJson("nested too deeply to read") from error
    return value


def as_text(value: Value) -> str:
    """A value in one line, for people: JSON, with bytes and tags in a notation of their own."""
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
    """The text of a frame for one line."""
    return text if len(text) <= 300 else f"{text[:240]}… ({len(text)} characters)"
