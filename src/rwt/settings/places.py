"""Lines of settings in TOML files, for errors: the parser does not report them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

#: Maximum number of lines of a file that is searched: each is parsed with all before it.
_MAX_LINES: Final = 2000


def line_of(path: Path, key: Sequence[str]) -> int | None:
    """Return the line at which a setting or its table begins, from 1; None if it is not found.

    Growing parts of the file are parsed until one contains the setting.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, ValueError):
        return None
    begins = 0  # Start of the statement after the last valid part.
    for number in range(min(len(lines), _MAX_LINES)):
        try:
            values = tomllib.loads("".join(lines[: number + 1]))
        except (ValueError, RecursionError):
            continue  # Inside a list or a string of several lines.
        if _has(values, key):
            return begins + 1
        begins = number + 1
    return None


def _has(values: object, key: Sequence[str]) -> bool:
    for part in key:
        if not isinstance(values, Mapping) or part not in values:
            return False
        values = values[part]
    return True
