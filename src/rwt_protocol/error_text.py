"""How this package says what is wrong with a message: what, where, and what instead."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Final

import msgspec
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from rwt_protocol.ops import Op
from rwt_protocol.ops.base import Expected
from rwt_protocol.payloads import Decoded, JsonKind, RawJson

_LONGEST_QUOTE: Final = 40

_KIND: Final[dict[JsonKind, str]] = {
    "object": "an object",
    "array": "an array",
    "string": "a string",
    "number": "a number",
    "boolean": "a boolean",
    "null": "null",
}


def describe(value: object) -> str:
    """A JSON value in a few words: scalars as they are written, the rest by kind."""
    if value is None:
        return "null"
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
        return str(value) if abs(value) < 10**_LONGEST_QUOTE else "a very large integer"
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else "a number out of range"
    return describe_kind(value)


def describe_kind(value: object) -> str:
    """The kind of a value that nobody has looked into yet."""
    if isinstance(value, Decoded):
        return _KIND[value.kind]
    data = (
        value.data if isinstance(value, RawJson) else bytes(value) if isinstance(value, msgspec.Raw) else b"0"
    )
    return _KIND[RawJson(data).kind]


def nearest(name: str, known: Iterable[str]) -> str:
    """`` (did you mean "x"?)`` when something like `name` is known, else nothing."""
    found = difflib.get_close_matches(name, known, n=1)
    return f' (did you mean "{found[0]}"?)' if found else ""


def explain(op: str, model: type[Op], error: ValidationError) -> str:
    """The first thing that pydantic found, in our words: ``publish.topic: expected a string, got 42``."""
    first = error.errors(include_url=False, include_context=False)[0]
    path, field = _locate(model, first["loc"])
    where = ".".join((op, *path))
    expected = _expected(field)
    if first["type"] == "missing":
        return f"{where}: expected {expected}, and it is missing"
    return f"{where}: expected {expected}, got {describe(first['input'])}"


def _locate(model: type[BaseModel], loc: tuple[int | str, ...]) -> tuple[list[str], FieldInfo | None]:
    """The member that an error is about. Parts of `loc` that name a branch of a union are left out."""
    path: list[str] = []
    field: FieldInfo | None = None
    known: type[BaseModel] | None = model
    for part in loc:
        found = known.model_fields.get(str(part)) if known else None
        if found is None:
            continue
        path.append(str(part))
        field = found
        known = _model_in(found)
    return path, field


def _model_in(field: FieldInfo) -> type[BaseModel] | None:
    """The nested model that a member holds, if it does."""
    candidates: tuple[object, ...] = (field.annotation, *getattr(field.annotation, "__args__", ()))
    for candidate in candidates:
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None


def _expected(field: FieldInfo | None) -> str:
    """What a member should hold; every member of every op says so."""
    for item in field.metadata if field else ():
        if isinstance(item, Expected):
            return item.text
    return "something else"
