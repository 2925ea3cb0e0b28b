"""Reading a script in TOML, and saying what is wrong with it: the file, the key, and what is expected."""

from __future__ import annotations

import json
import tomllib
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from rwt_testing.errors import ScriptError, instead
from rwt_testing.script.file import Recorded, Script

Key = tuple[str | int, ...]

_KINDS: Mapping[object, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a string",
}


def read_script(file: Path) -> Script:
    """Read a file.

    Raises:
        ScriptError: it cannot be read, has an unknown key or a wrong value.
    """
    try:
        values = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ScriptError(f"{file}: {error.strerror or 'cannot be read'}") from None
    except UnicodeDecodeError as error:
        raise ScriptError(f"{file}: not UTF-8 at byte {error.start}") from None
    except RecursionError:
        raise ScriptError(f"{file}: tables or lists are nested too deeply") from None
    except tomllib.TOMLDecodeError as error:
        raise ScriptError(f"{file}: not TOML: {error}") from None
    try:
        return Script.model_validate(_as_tuples(values))
    except ValidationError as error:
        raise ScriptError(f"{file}: {_fault(error)}") from None


def read_recorded(file: Path) -> tuple[Recorded, ...]:
    """Read recorded messages, one JSON object a line; empty lines are left out.

    Raises:
        ScriptError: the file cannot be read, or a line is something else.
    """
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise ScriptError(f"{file}: {error.strerror or 'cannot be read'}") from None
    except UnicodeDecodeError as error:
        raise ScriptError(f"{file}: not UTF-8 at byte {error.start}") from None
    return tuple(_line(file, number, line) for number, line in enumerate(lines, 1) if line.strip())


def _line(file: Path, number: int, line: str) -> Recorded:
    try:
        return Recorded.model_validate(json.loads(line))
    except (json.JSONDecodeError, RecursionError):
        raise ScriptError(
            f'{file}:{number}: not JSON; expected {{"at": seconds, "msg": {{…}}}} on each line'
        ) from None
    except ValidationError as error:
        raise ScriptError(f"{file}:{number}: {_fault(error, Recorded)}") from None


def dotted(key: Sequence[str | int]) -> str:
    """A key as TOML writes it: ``topics."/odom".messages[1]``."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
            continue
        bare = part.isascii() and part.replace("-", "_").isidentifier()
        text += ("." if text else "") + (part if bare else json.dumps(part, ensure_ascii=False))
    return text


def _as_tuples(value: object) -> object:
    """The models are strict, and immutable: their lists are tuples."""
    if isinstance(value, dict):
        return {key: _as_tuples(inner) for key, inner in value.items()}
    return tuple(map(_as_tuples, value)) if isinstance(value, list) else value


def _fault(error: ValidationError, model: type[BaseModel] = Script) -> str:
    """The first thing that is wrong; an unknown key goes before what is missing, which may be the same."""
    errors = error.errors(include_url=False)
    first = next((each for each in errors if each["type"] == "extra_forbidden"), errors[0])
    key, annotation = _located(model, first["loc"])
    if first["type"] == "extra_forbidden":
        table = _model_in(_at(model, key[:-1]))
        known = table.model_fields if table else ()
        return f"unknown key `{dotted(key)}`; {instead(str(key[-1]), known)}"
    if first["type"] == "value_error":
        text = str(first["ctx"]["error"])
        return f"`{dotted(key)}`: {text}" if key else text
    return f"`{dotted(key)}`: expected {_expected(annotation)}{_but_got(first)}"


def _located(model: type[BaseModel], loc: Sequence[str | int]) -> tuple[Key, object]:
    """The key of the file, without what pydantic adds for members of a union, and what is expected."""
    key: list[str | int] = []
    for part in loc:
        known = _at(model, [*key, part]) is not None
        in_table = _model_in(_at(model, key)) is not None
        if not known and not in_table:
            break  # pydantic's name for a member of a union
        key.append(part)
    return tuple(key), _at(model, key)


def _at(model: type[BaseModel], key: Sequence[str | int]) -> object:
    """The annotation of a key, with its bounds; None where there is none."""
    annotation: object = model
    for part in key:
        table = _model_in(annotation)
        plain = _plain(annotation)
        if table is not None and plain is table:
            field = table.model_fields.get(str(part))
            if field is None:
                return None
            annotation = (
                Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
            )
        elif get_origin(plain) is Mapping and isinstance(part, str):
            annotation = get_args(plain)[1]
        elif get_origin(plain) is tuple and isinstance(part, int):
            annotation = get_args(plain)[0]
        else:
            return None
    return annotation


def _plain(annotation: object) -> object:
    """A type without what annotates it and without `None`; a union of several stays one."""
    if get_origin(annotation) is Annotated:
        return _plain(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        rest = [part for part in get_args(annotation) if part is not type(None)]
        return _plain(rest[0]) if len(rest) == 1 else annotation
    return annotation


def _model_in(annotation: object) -> type[BaseModel] | None:
    plain = _plain(annotation)
    return plain if isinstance(plain, type) and issubclass(plain, BaseModel) else None


def _bounds(annotation: object) -> str:
    if get_origin(annotation) in (Union, types.UnionType):
        return "".join(_bounds(part) for part in get_args(annotation))
    if get_origin(annotation) is not Annotated:
        return ""
    inner, *metadata = get_args(annotation)
    words = {Ge: " of at least {}", Gt: " greater than {}", Le: " and at most {}"}
    said = ""
    for item in metadata:
        if type(item) in words:
            said += words[type(item)].format(getattr(item, type(item).__name__.lower()))
        said += "".join(
            words[type(each)].format(getattr(each, type(each).__name__.lower()))
            for each in getattr(item, "metadata", ())
            if type(each) in words
        )
    return _bounds(inner) + said


def _expected(annotation: object) -> str:
    plain = _plain(annotation)
    if get_origin(plain) in (Union, types.UnionType):
        return " or ".join(_expected(part) for part in get_args(plain) if part is not type(None))
    if get_origin(plain) is Literal:
        return " or ".join(f'"{choice}"' for choice in get_args(plain))
    if get_origin(plain) is tuple:
        return "a list" if _is_scalar(get_args(plain)[0]) else "a list of tables"
    return _KINDS.get(plain, "a table") + _bounds(annotation)


def _is_scalar(annotation: object) -> bool:
    return _plain(annotation) in _KINDS


def _but_got(error: ErrorDetails) -> str:
    if error["type"] == "missing":
        return ", and it is missing"
    value = error["input"]
    if isinstance(value, Mapping):
        return ", got a table"
    return ", got a list" if isinstance(value, tuple | list) else f", got {value!r}"


__all__ = ["dotted", "read_recorded", "read_script"]
