"""Write docs/reference/settings.md from the models of the settings.

Run it after a change of `rwt.settings.models`: ``python tools/generate_settings.py``. A test compares.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import get_origin

from pydantic.fields import FieldInfo

from rwt.settings.errors import Key, known_settings
from rwt.settings.models import full_type
from rwt_protocol.error_text import annotation_at, annotation_of, expected, model_in, plain_type

TARGET = Path(__file__).parents[1] / "docs" / "reference" / "settings.md"

_HEAD = """\
# Settings

This page is generated from the program by `tools/generate_settings.py`.

A setting comes from a TOML file (`--config FILE`, or the file named by `RWT_CONFIG`), from the
environment, or from the command line; the later of these wins. Three ways to set `limits.connections`:

- `connections = 20` under `[limits]` in the file,
- `RWT_LIMITS__CONNECTIONS=20` in the environment,
- `--set limits.connections=20` on the command line.

In the environment and after `--set`, write a list with commas or as in TOML. Names that you choose
(`NAME` below) are in lower case in the environment. `rwt config show` prints each value and its source.
An unknown key is rejected with the nearest known one. Examples: [secure a server](../how-to/secure.md).
"""

_ROLES = """
Two roles are built in: `admin` may do everything, and `viewer` is `read_only`. A configured role of the
same name replaces them.
"""


def page() -> str:
    """The whole page."""
    return "\n".join(_lines())


def _lines() -> Iterator[str]:
    yield _HEAD
    above: Key | None = None
    for key, field in known_settings():
        if key[:-1] != above:
            above = key[:-1]
            yield from _section(above)
        cells = (
            f"`{key[-1]}`",
            _cell(expected(annotation_of(field))),
            _default(field),
            _cell(field.description or ""),
        )
        yield f"| {' | '.join(cells)} |"
    yield ""


def _section(table: Key) -> Iterator[str]:
    if table:
        yield f"\n## `[{'.'.join(table)}]`\n"
        annotation = annotation_at(full_type(), table)
        if get_origin(plain_type(annotation)) is Mapping:
            annotation = annotation_at(full_type(), (*table, "NAME"))
        model = model_in(annotation)
        yield inspect.cleandoc((model and model.__doc__) or "")
    else:
        yield "## Top level of the file"
    if table[:1] == ("roles",):
        yield _ROLES.rstrip()
    yield "\n| setting | value | default | meaning |\n|---|---|---|---|"


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    return "not set" if value is None else f"`{json.dumps(value)}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    TARGET.write_text(page(), encoding="utf-8")
