"""Error texts for pydantic's errors in ops, settings and scripts: key, expectation and value."""

from __future__ import annotations

import math
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, Union, get_args, get_origin

import msgspec
from annotated_types import Ge, Gt, Le
from pydantic import BaseModel, SecretStr, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from rwt_protocol.payloads import Decoded, JsonKind, RawJson

Key = tuple[str | int, ...]
"""Path of a member from the top: names, and indices of lists."""

_LONGEST_QUOTE: Final = 40
_LONGEST_VALUE: Final = 200

_KIND: Final[Mapping[JsonKind, str]] = {
    "object": "an object",
    "array": "an array",
    "string": "a string",
    "number": "a number",
    "boolean": "a boolean",
    "null": "null",
}
_SCALARS: Final[Mapping[object, str]] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a string",
    Path: "a path",
    SecretStr: "a string",
}
_PLURALS: Final[Mapping[object, str]] = {
    int: "whole numbers",
    float: "numbers",
    str: "strings",
    Path: "paths",
}
_BOUNDS: Final[Mapping[type, tuple[str, str, Callable[[float, float], float]]]] = {
    Ge: ("ge", " of at least {}", max),
    Gt: ("gt", " greater than {}", max),
    Le: ("le", " and at most {}", min),
}
"""Kinds of bounds: attribute, text, and the function that selects the stricter of two."""


@dataclass(frozen=True, slots=True)
class Expected:
    """Metadata of a member: what errors name as expected, if its type does not say."""

    text: str


def describe(value: object) -> str:
    """Describe a JSON value briefly: scalars as written, others by kind."""
    if value is None:
        return "null"
    # Before int, of which bool is a subclass.
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list | tuple):
        return "an array"
    if isinstance(value, str):
        text = value if len(value) <= _LONGEST_QUOTE else value[:_LONGEST_QUOTE] + "…"
        return msgspec.json.encode(text).decode()
    if isinstance(value, int):
        return (
            str(value) if abs(value) < 10**_LONGEST_QUOTE else "a very large integer"
        )  # Python rejects more than 4,300 digits.
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else "a number out of range"
    return describe_kind(value)


def describe_kind(value: object) -> str:
    """Describe the kind of an undecoded value."""
    if isinstance(value, Decoded):
        return _KIND[value.kind]
    data = (
        value.data if isinstance(value, RawJson) else bytes(value) if isinstance(value, msgspec.Raw) else b"0"
    )
    return _KIND[RawJson(data).kind]


def explain(op: str, model: type[BaseModel], error: ValidationError) -> str:
    """Return the error text of a message in JSON's terms: ``publish.topic: expected a string, got 42``."""
    # One error per message: others are often consequences of the first.
    first = error.errors(include_url=False)[0]
    key, annotation = locate(model, first["loc"])
    where = ".".join(map(str, (op, *key)))
    if first["type"] == "missing":
        return f"{where}: expected {expected(annotation)}, and it is missing"
    return f"{where}: expected {_within_limit(annotation, first)}, got {describe(first['input'])}"


def _within_limit(annotation: object, error: ErrorDetails) -> str:
    """Return the expectation, with the violated limit of a number if the text lacks it."""
    text, limits = expected(annotation), error.get("ctx", {})
    if "le" in limits and not text.endswith(f" {limits['le']:.0f}"):
        return f"{text}, at most {limits['le']:.0f}"
    return f"{text}, at least {limits['ge']:.0f}" if limits.get("ge", 0) < 0 else text


def first_error(error: ValidationError) -> ErrorDetails:
    """Return the first error in a file. Unknown keys precede missing ones: they may be misspellings."""
    errors = error.errors(include_url=False)
    return next((each for each in errors if each["type"] == "extra_forbidden"), errors[0])


def but_got(error: ErrorDetails) -> str:
    """Return the end of a sentence about a file: the value found, in TOML's terms."""
    if error["type"] == "missing":
        return ", and it is missing"
    value = error["input"]
    if isinstance(value, Mapping):
        return ", got a table"
    if isinstance(value, tuple | list):
        return ", got a list"
    if isinstance(value, int) and not isinstance(value, bool):
        return f", got {describe(value)}"
    shown = repr(value)
    return f", got {shown if len(shown) <= _LONGEST_VALUE else shown[:_LONGEST_VALUE] + '…'}"


def locate(model: type[BaseModel], loc: Sequence[str | int]) -> tuple[Key, object]:
    """Return the key of an error, and what is expected there.

    Args:
        loc: pydantic's location; ends with parts that are not keys, for members of a union.
    """
    key: list[str | int] = []
    for part in loc:
        known = annotation_at(model, [*key, part]) is not None
        # Below a model an unknown part is a misspelt key; below a union it is a tag of pydantic.
        if not known and model_in(annotation_at(model, key)) is None:
            break
        key.append(part)
    return tuple(key), annotation_at(model, key)


def annotation_at(model: type[BaseModel], key: Sequence[str | int]) -> object:
    """Return the type of the member under `key`, with its metadata; None if there is none.

    A part of the key may be any name where names are chosen freely.
    """
    annotation: object = model
    for part in key:
        plain = plain_type(annotation)
        if isinstance(plain, type) and issubclass(plain, BaseModel):
            field = plain.model_fields.get(str(part))
            if field is None:
                return None
            annotation = annotation_of(field)
        elif get_origin(plain) is Mapping and isinstance(part, str):
            annotation = get_args(plain)[1]
        elif get_origin(plain) in (list, tuple) and isinstance(part, int):
            annotation = get_args(plain)[0]
        else:
            return None
    return annotation


def annotation_of(field: FieldInfo) -> object:
    """Return the type of a member with its metadata."""
    return Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation


def model_in(annotation: object) -> type[BaseModel] | None:
    """Return the model that a member holds; None if it holds something else."""
    plain = plain_type(annotation)
    return plain if isinstance(plain, type) and issubclass(plain, BaseModel) else None


def plain_type(annotation: object) -> object:
    """Return a type without metadata and None; a union of several types is kept."""
    if get_origin(annotation) is Annotated:
        return plain_type(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        rest = [part for part in get_args(annotation) if part is not type(None)]
        return plain_type(rest[0]) if len(rest) == 1 else annotation
    return annotation


def expected(annotation: object) -> str:
    """Describe the values that a member accepts, for example ``a whole number of at least 1``."""
    if get_origin(annotation) is Annotated:
        for item in get_args(annotation)[1:]:
            if isinstance(item, Expected):
                return item.text
    plain = plain_type(annotation)
    if get_origin(plain) in (Union, types.UnionType):
        return " or ".join(expected(part) for part in get_args(plain) if part is not type(None))
    if get_origin(plain) is Literal:
        return " or ".join(f'"{choice}"' for choice in get_args(plain))
    if get_origin(plain) in (list, tuple):
        item = plain_type(get_args(plain)[0])
        if get_origin(item) is Literal:
            return f"a list of {expected(item)}"
        return f"a list of {_PLURALS.get(item, 'tables')}"
    return _SCALARS.get(plain, "a table") + _bounds(annotation)


def _bounds(annotation: object) -> str:
    """Describe the bounds of a number; a narrowed type has only the narrower bound."""
    limits: dict[type, float] = {}
    for bound in _bounds_within(annotation):
        attribute, _, narrower = _BOUNDS[type(bound)]
        limit = getattr(bound, attribute)
        limits[type(bound)] = narrower(limits.get(type(bound), limit), limit)
    return "".join(_BOUNDS[kind][1].format(limit) for kind, limit in limits.items())


def _bounds_within(annotation: object) -> Iterator[object]:
    if get_origin(annotation) in (Union, types.UnionType):
        for part in get_args(annotation):
            yield from _bounds_within(part)
    elif get_origin(annotation) is Annotated:
        inner, *metadata = get_args(annotation)
        yield from _bounds_within(inner)
        for item in metadata:
            yield from (each for each in (item, *getattr(item, "metadata", ())) if type(each) in _BOUNDS)
