"""Keys and types of settings, and texts of errors."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, get_args, get_origin

from pydantic import BaseModel, SecretStr, ValidationError
from pydantic.fields import FieldInfo

from rwt.settings.models import Settings, full_type, type_with
from rwt_participant.spelling import nearest
from rwt_protocol.error_text import (
    annotation_at,
    but_got,
    expected,
    first_error,
    locate,
    model_in,
    plain_type,
)

Key = tuple[str, ...]
"""Path of a setting: tables, then its own name."""

_NAME: Final = "NAME"


def known_settings(model: type[BaseModel] | None = None, above: Key = ()) -> Iterator[tuple[Key, FieldInfo]]:
    """Return the keys of all settings in order, with `NAME` for names that the operator chooses.

    Args:
        model: settings or a table; None for the settings with those of all built-in parts.
    """
    model = full_type() if model is None else model
    tables: list[tuple[Key, type[BaseModel]]] = []
    for name, field in model.model_fields.items():
        kind = plain_type(field.annotation)
        is_named = get_origin(kind) is Mapping
        table = model_in(get_args(kind)[1] if is_named else kind)
        if table is None:
            yield (*above, name), field
        else:
            tables.append(((*above, name, _NAME) if is_named else (*above, name), table))
    for key, table in tables:
        yield from known_settings(table, key)


def is_list(key: Sequence[str]) -> bool:
    """Return True if the setting of this key holds several values."""
    return get_origin(kind_of(key)) is tuple


def kind_of(key: Sequence[str]) -> object:
    """Return the plain type of a setting; None if there is none."""
    return plain_type(annotation_at(type_with(key[0]), key)) if key else None


def is_secret(key: Sequence[str]) -> bool:
    """Return True if the value must not be shown."""
    return kind_of(key) is SecretStr


def explain(error: ValidationError, model: type[Settings]) -> tuple[Key, str]:
    """Return path and text of the first error of settings of this class."""
    first = first_error(error)
    found, _ = locate(model, first["loc"])
    # An item of a list: the list is the setting.
    key = tuple(str(part) for part in itertools.takewhile(lambda part: isinstance(part, str), found))
    dotted = ".".join(key)
    if first["type"] == "extra_forbidden":
        return key, f"unknown setting `{dotted}`; {_instead(key)}"
    if first["type"] == "value_error":
        text = str(first["ctx"]["error"])
        return key, f"`{dotted}`: {text}" if key else text
    # Everything below `auth.tokens` may be a secret.
    is_shown = key[:2] != ("auth", "tokens") or first["type"] == "missing"
    wanted = expected(annotation_at(model, key))
    return key, f"`{dotted}`: expected {wanted}{but_got(first) if is_shown else ''}"


def _instead(key: Key) -> str:
    """Return the nearest known key: in the same table, or with this name in another."""
    above, name = key[:-1], key[-1]
    model = model_in(annotation_at(type_with(above[0]), above)) if above else full_type()
    beside = tuple(model.model_fields) if model else ()
    near = nearest(name, beside)
    if near:
        return f"did you mean `{'.'.join((*above, near))}`?"
    anywhere = {known[-1]: known for known, _ in known_settings()}
    far = nearest(name, anywhere)
    if far:
        return f"did you mean `{'.'.join(anywhere[far])}`?"
    return f"known {'in ' + '.'.join(above) if above else 'at the top'} are {', '.join(beside)}"
