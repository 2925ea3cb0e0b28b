"""The settings in words: their keys, what each expects, and what is wrong with a value."""

from __future__ import annotations

import difflib
import types
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Final, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le
from pydantic import BaseModel, SecretStr, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from rwt.settings.models import Settings

Key = tuple[str, ...]
"""The way to a setting from the top: tables, then its own name."""

_KINDS: Final[Mapping[object, str]] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a string",
    Path: "a path",
    SecretStr: "a string",
}
_PLURALS: Final[Mapping[object, str]] = {str: "strings", Path: "paths"}
_NAME: Final = "NAME"


def known_settings(model: type[BaseModel] = Settings, above: Key = ()) -> Iterator[tuple[Key, FieldInfo]]:
    """Every setting that can be written, in order; `NAME` stands where the operator chooses a name."""
    tables: list[tuple[Key, FieldInfo]] = []
    for name, field in model.model_fields.items():
        if _model_in(field) is None:
            yield (*above, name), field
        else:
            tables.append(((*above, name), field))
    for key, field in tables:
        inner = _model_in(field)
        if inner is not None:
            yield from known_settings(inner, (*key, _NAME) if _is_mapping(field) else key)


def field_at(key: Sequence[str]) -> FieldInfo | None:
    """The setting of that key, or None where there is none."""
    model: type[BaseModel] | None = Settings
    field: FieldInfo | None = None
    named = False  # the next part is a name that the operator chose
    for part in key:
        if named:
            named = False
            continue
        field = model.model_fields.get(part) if model else None
        if field is None:
            return None
        model = _model_in(field)
        named = _is_mapping(field)
    return field


def table_at(key: Sequence[str]) -> type[BaseModel]:
    """The model of a table; of one under a chosen name, whatever the name.

    Raises:
        KeyError: there is no such table.
    """
    field = field_at(key) if key else None
    model = _model_in(field) if field else Settings if not key else None
    if model is None:
        raise KeyError(".".join(key))
    return model


def is_list(field: FieldInfo) -> bool:
    """Whether the setting holds several values."""
    return get_origin(_plain(field.annotation)) is tuple


def is_secret(key: Sequence[str]) -> bool:
    """Whether the value may not be shown."""
    field = field_at(key)
    return field is not None and _plain(field.annotation) is SecretStr


def expected(field: FieldInfo) -> str:
    """What a setting takes, for example ``a whole number of at least 1``."""
    kind = _plain(field.annotation)
    if _model_in(field) is not None:
        return "a table"
    if get_origin(kind) is tuple:
        item = get_args(kind)[0]
        return f"a list of {_choices(item) if get_origin(item) is Literal else _PLURALS[item]}"
    if get_origin(kind) is Literal:
        return _choices(kind)
    return _KINDS[kind] + "".join(_bound(item) for item in field.metadata)


def _choices(kind: object) -> str:
    return " or ".join(f'"{choice}"' for choice in get_args(kind))


def fault(error: ValidationError) -> tuple[Key, str]:
    """The first thing that is wrong: where, and one line about it that names the key.

    An unknown key goes before what is missing, which may be the same key well spelt.
    """
    errors = error.errors(include_url=False)
    first = next((each for each in errors if each["type"] == "extra_forbidden"), errors[0])
    key = tuple(str(part) for part in first["loc"])
    while key and field_at(key) is None and first["type"] != "extra_forbidden":
        key = key[:-1]  # an item of a list: the list is the setting
    dotted = ".".join(key)
    if first["type"] == "extra_forbidden":
        return key, f"unknown setting `{dotted}`; {_instead(key)}"
    if first["type"] == "value_error":
        text = str(first["ctx"]["error"])
        return key, f"`{dotted}`: {text}" if key else text
    field = field_at(key)
    wanted = expected(field) if field else "a table"
    return key, f"`{dotted}`: expected {wanted}{_but_got(key, first)}"


def _instead(key: Key) -> str:
    """The nearest known key: beside it, or of the same name in another table."""
    above, name = key[:-1], key[-1]
    field = field_at(above) if above else None
    model = Settings if not above else _model_in(field) if field else None
    beside = tuple(model.model_fields) if model else ()
    elsewhere = {known[-1]: known for known, _ in known_settings()}
    near = difflib.get_close_matches(name, beside, n=1, cutoff=0.6)
    if near:
        return f"did you mean `{'.'.join((*above, near[0]))}`?"
    far = difflib.get_close_matches(name, elsewhere, n=1, cutoff=0.6)
    if far:
        return f"did you mean `{'.'.join(elsewhere[far[0]])}`?"
    return f"known {'in ' + '.'.join(above) if above else 'at the top'} are {', '.join(beside)}"


def _but_got(key: Key, error: ErrorDetails) -> str:
    """The value that was found, unless it may be a secret: everything below `auth.tokens` may."""
    if error["type"] == "missing":
        return ", and it is missing"
    if key[:2] == ("auth", "tokens"):
        return ""
    value = error["input"]
    return f", got {'a table' if isinstance(value, Mapping) else repr(value)}"


def _bound(item: object) -> str:
    if isinstance(item, Ge):
        return f" of at least {item.ge}"
    if isinstance(item, Gt):
        return f" greater than {item.gt}"
    if isinstance(item, Le):
        return f" and at most {item.le}"
    return ""


def _plain(annotation: object) -> object:
    """A type without `None` and without what annotates it."""
    if get_origin(annotation) is Annotated:
        return _plain(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        return next(_plain(part) for part in get_args(annotation) if part is not type(None))
    return annotation


def _is_mapping(field: FieldInfo) -> bool:
    return get_origin(_plain(field.annotation)) is Mapping


def _model_in(field: FieldInfo) -> type[BaseModel] | None:
    """The table that a setting is, or that each of its named entries is."""
    kind = _plain(field.annotation)
    if _is_mapping(field):
        kind = get_args(kind)[1]
    return kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None
