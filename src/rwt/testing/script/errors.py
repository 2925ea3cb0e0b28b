"""Reader of scripts in TOML. Errors name the file, the key and the expected value."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ValidationError

from rwt.testing.errors import ScriptError, instead
from rwt.testing.script.file import Recorded, Script
from rwt_protocol.error_text import annotation_at, but_got, expected, first_error, locate, model_in


def read_script(file: Path) -> Script:
    """Read a script.

    Raises:
        ScriptError: the file cannot be read, or has an unknown key or an invalid value.
    """
    try:
        values = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ScriptError(f"{file}: {error.strerror or 'cannot be read'}") from None
    except UnicodeDecodeError as error:
        raise ScriptError(f"{file}: not UTF-8 at byte {error.start}") from None
    except RecursionError:
        raise ScriptError(f"{file}: tables or lists are nested too deeply") from None
    except ValueError as error:  # TOMLDecodeError, or a number with thousands of digits.
        raise ScriptError(f"{file}: not TOML: {error}") from None
    try:
        return Script.model_validate(_as_tuples(values))
    except ValidationError as error:
        raise ScriptError(f"{file}: {_explain(error)}") from None


def read_recorded(file: Path) -> tuple[Recorded, ...]:
    """Read recorded messages, one JSON object per line; empty lines are skipped.

    Raises:
        ScriptError: the file cannot be read, or a line is invalid.
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
    except ValidationError as error:
        raise ScriptError(f"{file}:{number}: {_explain(error, Recorded)}") from None
    except (ValueError, RecursionError):  # JSONDecodeError, or a number with thousands of digits.
        raise ScriptError(
            f'{file}:{number}: not JSON; expected {{"at": seconds, "msg": {{…}}}} on each line'
        ) from None


def dotted(key: Sequence[str | int]) -> str:
    """Format a key like TOML: ``topics."/odom".messages[1]``."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
            continue
        bare = part.isascii() and part.replace("-", "_").isidentifier()
        text += ("." if text else "") + (part if bare else json.dumps(part, ensure_ascii=False))
    return text


def _as_tuples(value: object) -> object:
    """Convert lists to tuples: the models are strict and immutable."""
    if isinstance(value, dict):
        return {key: _as_tuples(inner) for key, inner in value.items()}
    return tuple(map(_as_tuples, value)) if isinstance(value, list) else value


def _explain(error: ValidationError, model: type[BaseModel] = Script) -> str:
    first = first_error(error)
    key, annotation = locate(model, first["loc"])
    if first["type"] == "extra_forbidden":
        table = model_in(annotation_at(model, key[:-1]))
        known = table.model_fields if table else ()
        return f"unknown key `{dotted(key)}`; {instead(str(key[-1]), known)}"
    if first["type"] == "value_error":
        text = str(first["ctx"]["error"])
        return f"`{dotted(key)}`: {text}" if key else text
    return f"`{dotted(key)}`: expected {expected(annotation)}{but_got(first)}"
