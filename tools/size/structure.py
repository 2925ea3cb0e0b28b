"""Modules, classes and protocols of the packages, as the syntax trees show them.

Every import statement counts, those for annotations included; imports by a string do not.

A class implements a protocol if

- it, or an ancestor of it in the packages, names the protocol as a base, or
- it defines every method and property of the protocol, or every attribute if there are neither: as a method,
  as a class attribute or as an attribute of `self`.

Signatures are not compared, so unrelated classes match a protocol of few methods. Functions and the classes
of tests are not counted.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

from tools.generate_rooms import imports

SMALL_LINES: Final = 80
"""A module with fewer lines is small."""

MOST_MODULES: Final = 15
"""Largest number of modules that a folder should have."""

ClassId = tuple[str, str]
"""Module and qualified name of a class."""


@dataclass(frozen=True)
class Module:
    """A module of one of the packages.

    Attributes:
        name: dotted name.
        path: file.
        text: source.
    """

    name: str
    path: Path
    text: str = field(repr=False)

    @classmethod
    def read(cls, name: str, path: Path) -> Module:
        """Read a file."""
        return cls(name, path, path.read_text(encoding="utf-8"))

    @cached_property
    def tree(self) -> ast.Module:
        """Syntax tree."""
        return ast.parse(self.text)

    @cached_property
    def imported(self) -> Mapping[str, str]:
        """Dotted names by the names under which the module imports them."""
        found: dict[str, str] = {}
        for node in ast.walk(self.tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                found.update((each.asname or each.name, f"{node.module}.{each.name}") for each in node.names)
            elif isinstance(node, ast.Import):
                for each in node.names:
                    name = each.asname or each.name.partition(".")[0]
                    found[name] = each.name if each.asname else name
        return found


@dataclass(frozen=True)
class ClassFacts:
    """A class definition.

    Attributes:
        id: module and name.
        line: line number.
        bases: names of the bases, as written.
        methods: names of its own methods.
        properties: names of its own properties.
        members: names of its own methods, properties, class attributes and attributes of `self`.
    """

    id: ClassId
    line: int
    bases: tuple[str, ...]
    methods: frozenset[str]
    properties: frozenset[str]
    members: frozenset[str]

    @property
    def is_protocol(self) -> bool:
        """True if the class itself is a protocol."""
        return any(base.rpartition(".")[2] == "Protocol" for base in self.bases)


@dataclass(frozen=True)
class ProtocolUse:
    """A protocol and the classes that implement it.

    Attributes:
        protocol: its definition.
        data_only: true if it has no methods but properties, as protocols of messages.
        named: classes that name it, or a class that names it, as a base.
        structural: other classes that define all of its methods.
    """

    protocol: ClassFacts
    data_only: bool
    named: tuple[ClassId, ...]
    structural: tuple[ClassId, ...]

    @property
    def implementations(self) -> int:
        """Number of classes that implement it."""
        return len(self.named) + len(self.structural)


def small_modules(modules: Iterable[Module], importers: Iterable[Module]) -> list[tuple[Module, str]]:
    """Return the small modules with exactly one importer, and the importer; packages are left out."""
    known = frozenset(each.name for each in importers)
    by: defaultdict[str, list[str]] = defaultdict(list)
    for each in importers:
        for target in imports(each.name, each.path, known):
            by[target].append(each.name)
    return [
        (each, by[each.name][0])
        for each in modules
        if len(by[each.name]) == 1
        and each.path.stem not in ("__init__", "__main__")
        and each.text.count("\n") < SMALL_LINES
    ]


def full_folders(modules: Iterable[Module]) -> dict[Path, int]:
    """Return the folders with more modules than a folder should have, and how many they have."""
    counts: defaultdict[Path, int] = defaultdict(int)
    for each in modules:
        counts[each.path.parent] += 1
    return {folder: count for folder, count in sorted(counts.items()) if count > MOST_MODULES}


def classes(module: Module) -> Iterator[ClassFacts]:
    """Yield the classes of a module, inner ones included."""
    for node in ast.walk(module.tree):
        if isinstance(node, ast.ClassDef):
            functions = [
                each for each in node.body if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)
            ]
            properties = {each.name for each in functions if any(map(_is_property, each.decorator_list))}
            methods = {each.name for each in functions} - properties
            yield ClassFacts(
                (module.name, node.name),
                node.lineno,
                tuple(
                    ast.unparse(each.value if isinstance(each, ast.Subscript) else each)
                    for each in node.bases
                ),
                frozenset(methods),
                frozenset(properties),
                frozenset(methods | properties | _attributes(node)),
            )


def _is_property(decorator: ast.expr) -> bool:
    return ast.unparse(decorator).rpartition(".")[2] in ("property", "cached_property", "setter")


def _attributes(node: ast.ClassDef) -> set[str]:
    """Return the names that the body of a class, or an assignment to `self.NAME` in it, binds."""
    found: set[str] = set()
    for statement in node.body:
        if isinstance(statement, ast.Assign | ast.AnnAssign):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            found.update(each.id for each in targets if isinstance(each, ast.Name))
    for each in ast.walk(node):
        if isinstance(each, ast.Attribute) and isinstance(each.ctx, ast.Store):
            found.update({each.attr} if ast.unparse(each.value) == "self" else ())
    return found


def shared_names(modules: Iterable[Module]) -> dict[str, list[str]]:
    """Return the names of classes that several modules define, with these modules."""
    by: defaultdict[str, set[str]] = defaultdict(set)
    for module in modules:
        for each in classes(module):
            by[each.id[1]].add(module.name)
    return {name: sorted(where) for name, where in sorted(by.items()) if len(where) > 1}


class Protocols:
    """Classes of some modules, with their ancestors among these modules.

    Args:
        modules: all modules whose classes are looked at.
    """

    def __init__(self, modules: Iterable[Module]) -> None:
        self._modules = {each.name: each for each in modules}
        self._classes = {each.id: each for module in self._modules.values() for each in classes(module)}

    def uses(self, packages: Iterable[str]) -> list[ProtocolUse]:
        """Return the protocols that the packages define, those with the fewest implementations first."""
        wanted = frozenset(packages)
        found = [
            self._use(each)
            for each in self._classes.values()
            if each.is_protocol and each.id[0].partition(".")[0] in wanted
        ]
        return sorted(found, key=lambda use: (use.implementations, use.protocol.id))

    def _use(self, protocol: ClassFacts) -> ProtocolUse:
        lineage = [protocol, *(each for each in self._ancestors(protocol) if each.is_protocol)]
        methods = frozenset[str]().union(*(each.methods for each in lineage))
        required = methods.union(*(each.properties for each in lineage))
        required = required or required.union(*(each.members for each in lineage))
        named = []
        structural = []
        for each in self._classes.values():
            if each.is_protocol:
                continue
            ancestors = self._ancestors(each)
            if protocol in ancestors:
                named.append(each.id)
            elif required and required <= each.members.union(*(one.members for one in ancestors)):
                structural.append(each.id)
        return ProtocolUse(protocol, not methods, tuple(named), tuple(structural))

    def _ancestors(self, start: ClassFacts) -> list[ClassFacts]:
        found: list[ClassFacts] = []
        ahead = [start]
        while ahead:
            current = ahead.pop()
            for base in current.bases:
                parent = self._resolve(current.id[0], base)
                if parent is not None and parent not in found and parent is not start:
                    found.append(parent)
                    ahead.append(parent)
        return found

    def _resolve(self, module: str, name: str) -> ClassFacts | None:
        """Return the class that a name means in a module, through the imports of the packages."""
        for _ in range(len(self._modules)):
            if (module, name) in self._classes:
                return self._classes[module, name]
            head, _, rest = name.partition(".")
            target = self._modules[module].imported.get(head) if module in self._modules else None
            if target is None:
                return None
            module, _, name = f"{target}.{rest}".strip(".").rpartition(".")
        return None
