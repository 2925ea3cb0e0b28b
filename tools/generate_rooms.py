"""Write the table of packages in docs/explanation/architecture.md from the folders' docstrings.

Run it after a folder has come, gone or changed its question: ``python tools/generate_rooms.py``. A test
compares.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "explanation" / "architecture.md"

_BEGIN = "| folder | purpose |\n|---|---|\n"


def packages() -> Mapping[str, Path]:
    """Every folder of modules by its dotted name, with its `__init__`."""
    found = {}
    for top in (*sorted(ROOT.glob("rwt-*/src")), ROOT / "src", ROOT / "conformance"):
        for folder in top.iterdir():
            for init in folder.rglob("__init__.py"):
                found[".".join(init.parent.relative_to(top).parts)] = init
    return dict(sorted(found.items()))


def question(init: Path) -> str:
    """The first sentence or two of a folder's docstring."""
    text = ast.get_docstring(ast.parse(init.read_text(encoding="utf-8"))) or ""
    return " ".join(text.split("\n\n")[0].split())


def rows() -> Iterator[str]:
    """The table, row by row."""
    for name, init in packages().items():
        yield f"| `{name}` | {question(init)} |"


def with_table(page: str) -> str:
    """The page with its table of today."""
    before, begin, after = page.partition(_BEGIN)
    if not begin:
        raise SystemExit(f"{PAGE.name} has no table that begins with {_BEGIN!r}")
    rest = after[after.index("\n\n") :]
    return before + begin + "\n".join(rows()) + rest


def imports(name: str, path: Path, known: frozenset[str]) -> set[str]:
    """The modules of the project that one module imports, those for its annotations included."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in known else node.module)
        elif isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
    return (found & known) - {name}


def circles() -> list[tuple[str, ...]]:
    """The groups of modules that import each other, directly or by way of others; sorted."""
    paths = {}
    for name, init in packages().items():
        for path in init.parent.glob("*.py"):
            paths[name if path == init else f"{name}.{path.stem}"] = path
    known = frozenset(paths)
    arrows = {name: imports(name, path, known) for name, path in paths.items()}
    reached = {name: _reached(name, arrows) for name in arrows}
    groups = {
        tuple(sorted({name} | {other for other in reached[name] if name in reached[other]}))
        for name in arrows
        if name in reached[name]
    }
    return sorted(groups)


def _reached(start: str, arrows: Mapping[str, set[str]]) -> set[str]:
    reached: set[str] = set()
    ahead = list(arrows[start])
    while ahead:
        name = ahead.pop()
        if name not in reached:
            reached.add(name)
            ahead += arrows[name]
    return reached


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
