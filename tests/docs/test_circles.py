"""The circles of imports are those that the page on the architecture gives a reason for."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from tests.docs.blocks import ROOT

_SOURCES = ROOT / "src"
_ROW = re.compile(r"^\| `(\w+)` \| ((?:`[\w.]+` ?)+)\| .+ \|$", re.MULTILINE)

Graph = dict[str, set[str]]


def _name(path: Path) -> str:
    return ".".join(path.relative_to(_SOURCES).with_suffix("").parts).removesuffix(".__init__")


def _imports(path: Path, known: set[str], at_run_time: bool) -> Iterator[str]:
    """The modules of ours that one imports anywhere; those for type checkers if not `at_run_time`."""
    pending: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while pending:
        node = pending.pop()
        if at_run_time and isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        pending += ast.iter_child_nodes(node)
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in known else str(node.module)


def _graph(package: str, at_run_time: bool = False) -> Graph:
    files = {_name(path): path for path in (_SOURCES / package).rglob("*.py")}
    known = set(files)
    return {name: set(_imports(path, known, at_run_time)) & known - {name} for name, path in files.items()}


def _reached(graph: Graph, start: str) -> set[str]:
    found: set[str] = set()
    pending = [start]
    while pending:
        new = graph[pending.pop()] - found
        found |= new
        pending += new
    return found


def _circles(graph: Graph) -> set[frozenset[str]]:
    reached = {name: _reached(graph, name) for name in graph}
    return {
        frozenset(other for other in found if name in reached[other])
        for name, found in reached.items()
        if name in found
    }


def _packages() -> list[str]:
    return sorted(path.parent.name for path in _SOURCES.glob("*/__init__.py"))


def test_every_circle_has_a_reason() -> None:
    page = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    listed = set()
    for package, modules in _ROW.findall(page.partition("## Circles that remain")[2].partition("\n## ")[0]):
        names = re.findall(r"[\w.]+", modules)
        listed.add(frozenset(name if name == package else f"{package}.{name}" for name in names))
    found = {circle for package in _packages() for circle in _circles(_graph(package))}
    assert {tuple(sorted(circle)) for circle in found} == {tuple(sorted(circle)) for circle in listed}


def test_types_of_messages_are_no_circle_at_run_time() -> None:
    assert _circles(_graph("rwt_interfaces", at_run_time=True)) == set()


def test_a_circle_is_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set[str]()}
    assert _circles(graph) == {frozenset({"b", "c"})}
