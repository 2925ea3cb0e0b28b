"""Large classes and functions, and functions that exist plain and in steps."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeGuard

from tools.size.source import docstring_rows
from tools.size.structure import Module

MANY_ATTRIBUTES: Final = 15
"""A class with as many attributes needs a named state, or a sentence why it has no life cycle."""

LONG_LINES: Final = 50
"""A function with more lines, its docstring not counted, is long."""

NO_LIFE_CYCLE: Final = Path(__file__).with_name("no_life_cycle.toml")
"""Sentences why a class has no life cycle, by module and name of the class."""

STEPS: Final = re.compile(r"\bSteps\b|_in_steps\b")
"""Mention of a function in steps."""

_STATE: Final = re.compile(r"(state|status|phase|stage|progress)$", re.IGNORECASE)
_FUNCTION: Final = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True, slots=True)
class LargeClass:
    """A class with many attributes of `self`.

    Attributes:
        name: module and name.
        path: file.
        line: line number.
        attributes: number of attributes.
        state: the enum of its state; empty if it has none.
    """

    name: str
    path: Path
    line: int
    attributes: int
    state: str


@dataclass(frozen=True, slots=True)
class LongFunction:
    """A long function.

    Attributes:
        name: name without its class.
        path: file.
        line: line number.
        lines: number of lines without the docstring.
    """

    name: str
    path: Path
    line: int
    lines: int


def reasons() -> Mapping[str, str]:
    """Return the sentences of :data:`NO_LIFE_CYCLE`."""
    if not NO_LIFE_CYCLE.exists():
        return {}
    return tomllib.loads(NO_LIFE_CYCLE.read_text(encoding="utf-8"))


def large_classes(modules: Iterable[Module]) -> list[LargeClass]:
    """Return the classes with many attributes, the largest first.

    The attributes of a class are what its methods assign to `self`. Its named state is an attribute that
    holds a member of an enum of these modules, also through a constant of its module, if

    - the attribute or the enum is named like a state, or
    - the module has a table of transitions: a dictionary whose keys are members of the enum.
    """
    defined = [
        (module, each)
        for module in modules
        for each in ast.walk(module.tree)
        if isinstance(each, ast.ClassDef)
    ]
    enums = {each.name for _, each in defined if any("Enum" in ast.unparse(base) for base in each.bases)}
    found = []
    for module, each in defined:
        stores = list(_stores(each))
        constants, tabled = _members(module, enums)
        names = {attribute for attribute, _ in stores}
        if len(names) >= MANY_ATTRIBUTES:
            states = sorted(
                enum
                for attribute, used in stores
                for enum in {constants.get(name, name) for name in used} & enums
                if _STATE.search(attribute) or _STATE.search(enum) or enum in tabled
            )
            state = states[0] if states else ""
            found.append(
                LargeClass(f"{module.name}.{each.name}", module.path, each.lineno, len(names), state)
            )
    return sorted(found, key=lambda each: (-each.attributes, each.name))


def _members(module: Module, enums: Container[str]) -> tuple[Mapping[str, str], set[str]]:
    """Return the enum of each constant that is one of its members, and the enums with transition tables."""
    constants: dict[str, str] = {}
    tabled: set[str] = set()
    for each in module.tree.body:
        if isinstance(each, ast.Assign | ast.AnnAssign):
            targets = each.targets if isinstance(each, ast.Assign) else [each.target]
            enum = _enum_of(each.value)
            if enum in enums:
                constants.update((target.id, enum) for target in targets if isinstance(target, ast.Name))
            elif isinstance(each.value, ast.Dict):
                keys = set(map(_enum_of, each.value.keys))
                tabled |= keys if len(keys) == 1 else set()
    return constants, tabled


def _enum_of(node: ast.expr | None) -> str:
    """Return the name before the dot of a member, such as `State.OPEN`; empty for other expressions."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return node.value.id
    return ""


def _stores(node: ast.ClassDef) -> Iterator[tuple[str, set[str]]]:
    """Yield the attributes of `self` that methods assign, each with the names in its value or annotation."""
    for each in (
        inner for method in node.body if isinstance(method, _FUNCTION) for inner in ast.walk(method)
    ):
        if isinstance(each, ast.Attribute) and isinstance(each.ctx, ast.Store) and _is_of_self(each):
            yield each.attr, set()
        elif isinstance(each, ast.Assign | ast.AnnAssign):
            targets = each.targets if isinstance(each, ast.Assign) else [each.target]
            names = {inner.id for inner in ast.walk(each) if isinstance(inner, ast.Name)}
            yield from ((target.attr, names) for target in targets if _is_of_self(target))


def _is_of_self(node: ast.expr) -> TypeGuard[ast.Attribute]:
    return isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "self"


def long_functions(modules: Iterable[Module]) -> list[LongFunction]:
    """Return the long functions, the longest first."""
    found = []
    for module in modules:
        for each in ast.walk(module.tree):
            if isinstance(each, _FUNCTION):
                lines = (each.end_lineno or each.lineno) - each.lineno + 1 - len(docstring_rows(each))
                if lines > LONG_LINES:
                    found.append(LongFunction(each.name, module.path, each.lineno, lines))
    return sorted(found, key=lambda each: (-each.lines, str(each.path), each.line))


def step_pairs(module: Module) -> Iterator[tuple[int, str]]:
    """Yield line and name of each function with a namesake in steps, in the same module or class.

    The namesake of `f` is `f_in_steps`; one of the two may begin with an underscore.
    """
    for scope in ast.walk(module.tree):
        if isinstance(scope, ast.Module | ast.ClassDef):
            lines = {each.name: each.lineno for each in scope.body if isinstance(each, _FUNCTION)}
            for name in lines:
                plain = name.removesuffix("_in_steps")
                other = plain.removeprefix("_") if plain.startswith("_") else f"_{plain}"
                if plain != name and (found := plain if plain in lines else other) in lines:
                    yield lines[found], found
