"""Tests reach private names of others only as listed in private_uses.toml."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
LIST: Final = Path(__file__).with_name("private_uses.toml")
OWN: Final = ("self", "cls")


def _is_private(name: str) -> bool:
    """Return True for `_x`, and False for `__x__` and for `_x_`, as protocols of other projects are spelt."""
    return name.startswith("_") and not name.endswith("_")


def _defined(tree: ast.AST) -> Iterator[str]:
    """Yield the names that a file defines itself, as attributes of `self` too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in OWN:
            yield node.attr


def private_uses(text: str) -> Iterator[tuple[int, str]]:
    """Yield line and name of each private attribute, import or patched name that the file does not define."""
    tree = ast.parse(text)
    own = {*_defined(tree)}
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(attr=name):
                names = [name]
            case ast.ImportFrom(names=aliases):
                names = [each.name for each in aliases]
            case (
                ast.Call(func=ast.Attribute(attr="setattr" | "delattr" | "object"), args=arguments)
                | ast.Call(func=ast.Name(id="setattr" | "getattr" | "hasattr"), args=arguments)
            ):
                strings = [each.value for each in arguments[:2] if isinstance(each, ast.Constant)]
                names = [str(each).rpartition(".")[2] for each in strings]
            case _:
                continue
        yield from ((node.lineno, name) for name in names if _is_private(name) and name not in own)


def _found() -> Iterator[tuple[str, int, str]]:
    for folder in (ROOT / "tests", *ROOT.glob("rwt-*/tests")):
        for path in sorted(folder.rglob("*.py")):
            if "node_modules" not in path.parts:
                file = path.relative_to(ROOT).as_posix()
                yield from ((file, *use) for use in private_uses(path.read_text(encoding="utf-8")))


def test_private_names_of_others_are_listed_with_a_reason() -> None:
    groups = tomllib.loads(LIST.read_text(encoding="utf-8"))["group"]
    unused = {(number, name) for number, group in enumerate(groups) for name in group["names"]}
    unlisted = []
    for file, line, name in _found():
        listed = {
            (number, each)
            for number, group in enumerate(groups)
            for each in group["names"]
            if each in ("*", name) and any(fnmatchcase(file, pattern) for pattern in group["files"])
        }
        unused -= listed
        if not listed:
            unlisted.append(f"{file}:{line}: {name}")
    assert unlisted == [], "use a public name, or list this one in tests/private_uses.toml with a reason"
    assert sorted(name for _, name in unused) == [], "remove these from tests/private_uses.toml"
    assert all(len(group["reason"]) > 20 for group in groups)


def test_uses_are_found() -> None:
    text = (
        "from rwt import _one, two\nrobot._three.go()\nself._four = robot.__dict__\nrobot._four\n"
        'monkeypatch.setattr("rwt.x._five", 1)\nview._repr_mimebundle_()\nclass _Six: ...\n_Six._seven\n'
        "getattr(robot, '_eight')"
    )
    assert sorted(private_uses(text)) == [
        (1, "_one"),
        (2, "_three"),
        (5, "_five"),
        (8, "_seven"),
        (9, "_eight"),
    ]
