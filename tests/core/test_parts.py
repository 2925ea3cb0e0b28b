"""Parts: the core names none of them, and each is declared."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from rwt import parts
from rwt.declarations import Part
from rwt.parts import Kind

SOURCE: Final = Path(parts.__file__).parents[1]

CORE: Final = (
    "rwt/composition",
    "rwt/settings",
    "rwt/server.py",
    "rwt/cli/commands/doctor",
    "rwt_transports",
)
"""Folders and files that may not know a part."""

ROWS: Final = [(kind, name) for kind, rows in parts.BUILT_IN.items() for name in rows]


def _modules() -> Iterator[Path]:
    for each in CORE:
        path = SOURCE / each
        yield from path.rglob("*.py") if path.is_dir() else [path]


def _strings(module: ast.Module) -> Iterator[str]:
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(module)
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    attributes = {
        id(node.args[1])
        for node in ast.walk(module)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "hasattr"
    }
    for node in ast.walk(module):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in docstrings | attributes
        ):
            yield node.value


def test_the_core_has_no_name_of_an_extension() -> None:
    names = {
        name
        for rows in parts.BUILT_IN.values()
        for name, row in rows.items()
        if not row.reference.startswith("rwt.rosapi")
    }
    found = [
        (path.relative_to(SOURCE).as_posix(), text)
        for path in _modules()
        for text in _strings(ast.parse(path.read_text(encoding="utf-8")))
        if text in names or "rwt.extensions." in text or "rwt_webrtc" in text
    ]
    assert found == []


@pytest.mark.parametrize(("kind", "name"), ROWS)
def test_each_row_is_a_declaration_with_its_settings(kind: Kind, name: str) -> None:
    part = parts.load(kind, name)
    row = parts.row(kind, name)
    assert isinstance(part, Part)
    assert part.summary
    fields = tuple(part.settings.model_fields)
    assert (row.settings == fields) if part.at_top_level else (len(row.settings) == bool(fields))


def test_every_command_of_a_part_exists() -> None:
    for name, row in parts.COMMANDS.items():
        module, _, function = row.reference.partition(":")
        if module:
            assert (SOURCE / (module.replace(".", "/") + ".py")).is_file() or (
                SOURCE / module.replace(".", "/")
            ).is_dir(), name
            assert function == f"add_{name}_command"
