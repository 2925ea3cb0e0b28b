"""Patterns that are not constant, and caches of functions, are listed in patterns.toml with who chooses them.

`fnmatch` keeps its patterns in a cache of the process, `re` keeps those of its functions, and `lru_cache`
keeps what it is called with: a client that chooses them fills the server's memory. A pattern may also take
time that grows exponentially with the text, so that one short message holds the server.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

import pytest

# The parser of `re` has no public name.
codes: Final[Any] = import_module("re._constants")
parser: Final[Any] = import_module("re._parser")

ROOT: Final = Path(__file__).parents[1]
LIST: Final = Path(__file__).with_name("patterns.toml")

CHOOSERS: Final = ("constant", "program", "operator", "robot", "client")
"""Who may choose a pattern, or the keys of a cache; `constant`: the source, in a way this test cannot see."""

_PATTERN_CALLS: Final[Mapping[str, tuple[str, ...]]] = {
    "re": ("compile", "match", "fullmatch", "search", "split", "findall", "finditer", "sub", "subn"),
    "fnmatch": ("fnmatch", "fnmatchcase", "filter", "translate"),
    "glob": ("glob", "iglob", "translate"),
}
_METHODS: Final = ("glob", "rglob")
_CACHES: Final = ("lru_cache", "cache")

_LARGEST_CLIENT_CACHE: Final = 4096
"""Entries of a cache whose keys clients choose."""


class Use(NamedTuple):
    """Pattern or cache.

    Attributes:
        where: file, with the function or variable.
        kind: `pattern` or `cache`.
        entries: maximum entries of a cache; None without a maximum.
    """

    where: str
    kind: str
    entries: int | None = None


class _Module:
    """Names of a module: its imports and its constants."""

    def __init__(self, tree: ast.Module) -> None:
        self.imported: dict[str, str] = {}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module in ("re", "fnmatch", "glob", "functools"):
                self.imported |= {
                    each.asname or each.name: f"{node.module}.{each.name}" for each in node.names
                }
            elif isinstance(node, ast.Import):
                self.imported |= {each.asname or each.name: each.name for each in node.names}
        self._constants: dict[str, ast.expr] = {}
        for statement in tree.body:
            match statement:
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    self._constants[name] = value
                case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                    self._constants[name] = value

    def name_of(self, function: ast.expr) -> str:
        """Return the full name of a function of a module of interest, such as `re.compile`."""
        match function:
            case ast.Name(id=name):
                return self.imported.get(name, "")
            case ast.Attribute(value=ast.Name(id=module), attr=name) if module in self.imported:
                return f"{self.imported[module]}.{name}"
        return ""

    def is_constant(self, node: ast.expr) -> bool:
        match node:
            case ast.Constant():
                return True
            case ast.JoinedStr(values=parts) | ast.Tuple(elts=parts):
                return all(map(self.is_constant, parts))
            case ast.FormattedValue(value=value):
                return self.is_constant(value)
            case ast.BinOp(left=left, right=right):
                return self.is_constant(left) and self.is_constant(right)
            case ast.Name(id=name):
                return name in self._constants and self.is_constant(self._constants[name])
            case ast.Attribute(value=ast.Name(id=name), attr="pattern"):
                found = self._constants.get(name)
                return isinstance(found, ast.Call) and all(map(self.is_constant, found.args))
        return False

    def text_of(self, node: ast.expr) -> str | None:
        """Return the text of a constant string, bytes as Latin-1; None if it is computed in another way."""
        match node:
            case ast.Constant(value=str() as text):
                return text
            case ast.Constant(value=bytes() as data):
                return data.decode("latin-1")
            case ast.JoinedStr(values=parts):
                texts = [self.text_of(part) for part in parts]
            case ast.BinOp(left=left, right=right):
                texts = [self.text_of(left), self.text_of(right)]
            case ast.FormattedValue(value=value):
                return self.text_of(value)
            case ast.Name(id=name) if name in self._constants:
                return self.text_of(self._constants[name])
            case ast.Attribute(value=ast.Name(id=name), attr="pattern"):
                found = self._constants.get(name)
                return self.text_of(found.args[0]) if isinstance(found, ast.Call) else None
            case _:
                return None
        return None if None in texts else "".join(text for text in texts if text is not None)


def _is_flexible(module: _Module, call: ast.Call) -> bool:
    """Return True if a call takes a pattern that is not constant."""
    package, _, function = module.name_of(call.func).partition(".")
    if function in _PATTERN_CALLS.get(package, ()):
        is_second = package == "fnmatch" and function != "translate"
        pattern = call.args[1 if is_second else 0]
        return not module.is_constant(pattern)
    is_method = isinstance(call.func, ast.Attribute) and call.func.attr in _METHODS
    return is_method and bool(call.args) and not module.is_constant(call.args[0])


def _cache_of(module: _Module, node: ast.expr) -> tuple[bool, int | None]:
    """Return True for a cache of a function, with its size."""
    function = node.func if isinstance(node, ast.Call) else node
    name = module.name_of(function).removeprefix("functools.")
    if name not in _CACHES or not module.name_of(function).startswith("functools."):
        return False, None
    if name == "cache":
        return True, None
    sizes = [] if not isinstance(node, ast.Call) else [*node.args, *(each.value for each in node.keywords)]
    size = sizes[0] if sizes else ast.Constant(128)
    return True, size.value if isinstance(size, ast.Constant) and isinstance(size.value, int) else None


def uses(file: str, text: str) -> Iterator[Use]:
    """Yield the patterns and caches of a module."""
    tree = ast.parse(text)
    module = _Module(tree)

    def visit(node: ast.AST, names: tuple[str, ...]) -> Iterator[Use]:
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                names = (*names, name)
                caches = [each for each in node.decorator_list if _cache_of(module, each)[0]]
                for decorator in caches:
                    yield Use(f"{file}:{'.'.join(names)}", "cache", _cache_of(module, decorator)[1])
                for child in ast.iter_child_nodes(node):
                    if child not in caches:
                        yield from visit(child, names)
                return
            case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)) if (
                not names
            ):
                names = (name,)
            case ast.Call():
                is_cache, entries = _cache_of(module, node)
                if is_cache:
                    yield Use(f"{file}:{'.'.join(names)}", "cache", entries)
                elif _is_flexible(module, node):
                    yield Use(f"{file}:{'.'.join(names)}", "pattern")
        for child in ast.iter_child_nodes(node):
            yield from visit(child, names)

    yield from visit(tree, ())


def _files() -> Iterator[tuple[str, str]]:
    for folder in (ROOT / "src", *sorted(ROOT.glob("rwt-*/src"))):
        for path in sorted(folder.rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


@cache
def _listed() -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = tomllib.loads(LIST.read_text(encoding="utf-8"))["use"]
    return found


def test_patterns_and_caches_are_listed_with_who_chooses_them() -> None:
    found = {use for file, text in _files() for use in uses(file, text)}
    listed = {(each["where"], each["kind"]) for each in _listed()}
    present = {(use.where, use.kind) for use in found}
    unlisted = sorted(present - listed)
    assert unlisted == [], "use constants, or list these in tests/patterns.toml with who chooses them"
    assert sorted(listed - present) == [], "remove these from tests/patterns.toml"


def test_what_clients_choose_is_bounded() -> None:
    entries = {use.where: use.entries for file, text in _files() for use in uses(file, text)}
    for each in _listed():
        assert each["by"] in CHOOSERS, each
        assert len(each["reason"]) > 20, each
        if each["by"] == "client":
            assert each["kind"] == "cache", f"{each['where']}: match without `re` and `fnmatch`"
            size = entries[each["where"]]
            assert size is not None and size <= _LARGEST_CLIENT_CACHE, each


def test_a_new_pattern_or_cache_is_found() -> None:
    text = """
import fnmatch
import re
from functools import cache, lru_cache

PART = r"[a-z]+"
_CONSTANT = re.compile(rf"{PART}(?:/{PART})*")

def fits(name, glob):
    return fnmatch.fnmatchcase(name, glob) or fnmatch.fnmatchcase(name, "/rosapi/*")

class A:
    def found(self, text):
        return re.search(self.pattern, text) or re.search("a", text) or _CONSTANT.match(text)

@lru_cache(maxsize=16)
def twice(number): ...

@cache
def thrice(number): ...

of = lru_cache(maxsize=None)(A)
"""
    assert [*uses("m.py", text)] == [
        Use("m.py:fits", "pattern"),
        Use("m.py:A.found", "pattern"),
        Use("m.py:twice", "cache", 16),
        Use("m.py:thrice", "cache"),
        Use("m.py:of", "cache"),
    ]


# Patterns that take exponential time

_REPEATS: Final = (codes.MAX_REPEAT, codes.MIN_REPEAT)
_CHARACTERS: Final = frozenset(range(0x180))
"""Characters that are looked at, instead of all."""


def _characters(code: Any, value: Any) -> frozenset[int] | None:
    """Return the characters that one element matches; None if it is not a single character."""
    if code is codes.LITERAL:
        return frozenset((value,))
    if code is codes.NOT_LITERAL:
        return _CHARACTERS - {value}
    if code is codes.ANY:
        return _CHARACTERS
    if code is codes.IN:
        compiled = re.compile(_class_of(value))
        return frozenset(each for each in _CHARACTERS if compiled.fullmatch(chr(each)))
    return None


def _class_of(members: Any) -> str:
    text = ""
    words = {
        codes.CATEGORY_DIGIT: r"\d", codes.CATEGORY_SPACE: r"\s", codes.CATEGORY_WORD: r"\w",
        codes.CATEGORY_NOT_DIGIT: r"\D", codes.CATEGORY_NOT_SPACE: r"\S", codes.CATEGORY_NOT_WORD: r"\W",
    }  # fmt: skip
    for code, value in members:
        if code is codes.NEGATE:
            text += "^"
        elif code is codes.LITERAL:
            text += f"\\u{value:04x}"
        elif code is codes.RANGE:
            text += f"\\u{value[0]:04x}-\\u{value[1]:04x}"
        else:
            text += words[value]
    return f"(?s)[{text}]"


def _children(code: Any, value: Any) -> list[Any]:
    """Return the parts that can be retried: those of atomic groups and possessive repeats cannot."""
    if code in _REPEATS:
        return [value[2]]
    if code is codes.SUBPATTERN:
        return [value[3]]
    if code is codes.BRANCH:
        return list(value[1])
    if code in (codes.ASSERT, codes.ASSERT_NOT):
        return [value[1]]
    return []


def _is_unbounded(code: Any, value: Any) -> bool:
    return code in _REPEATS and value[1] == codes.MAXREPEAT


def _repeated(pattern: Any) -> Iterator[frozenset[int]]:
    """Yield the characters of each unbounded repeat in a pattern; all characters for a repeated group."""
    for code, value in pattern:
        if _is_unbounded(code, value):
            single = _characters(*value[2][0]) if len(value[2]) == 1 else None
            yield _CHARACTERS if single is None else single
        for child in _children(code, value):
            yield from _repeated(child)


def _mandatory(pattern: Any, at: int) -> frozenset[int] | None:
    """Return the characters with which each match begins (at 0) or ends (at -1); None if that varies."""
    if not len(pattern):
        return None
    code, value = pattern[at]
    if code is codes.SUBPATTERN:
        return _mandatory(value[3], at)
    if code is codes.BRANCH:
        found = [_mandatory(each, at) for each in value[1]]
        return None if None in found else frozenset(chain.from_iterable(each for each in found if each))
    if code in (*_REPEATS, codes.POSSESSIVE_REPEAT) and value[0] > 0:
        return _mandatory(value[2], at)
    return _characters(code, value)


def is_ambiguous(pattern: Any) -> bool:
    """Return True if an unbounded repeat contains another, and no character tells their rounds apart."""
    for code, value in pattern:
        if _is_unbounded(code, value) and (inner := [*_repeated(value[2])]):
            edges = [_mandatory(value[2], at) for at in (0, -1)]
            if not any(edge and not any(edge & each for each in inner) for edge in edges):
                return True
        if any(map(is_ambiguous, _children(code, value))):
            return True
    return False


def test_no_constant_pattern_takes_exponential_time() -> None:
    found = []
    for file, text in _files():
        tree = ast.parse(text)
        module = _Module(tree)
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and node.args and module.name_of(node.func).startswith("re."):
                pattern = module.text_of(node.args[0])
                if pattern is not None and is_ambiguous(parser.parse(pattern)):
                    found.append(f"{file}:{node.lineno}: {pattern}")
    assert found == [], "use a possessive repeat or an atomic group: `(?:[a-z]+/)*+`"


@pytest.mark.parametrize(
    ("pattern", "ambiguous"),
    [
        (r"(a+)+b", True),
        (r"(?:[a-z]+\d*)*!", True),
        (r"(.*,)*x", True),
        (r"(?:a|b*)*c", True),
        (r"[a-z]+(?:/[a-z]+)*", False),
        (r'"[^"\\]*(?:\\.[^"\\]*)*"', False),
        (r"(?:[a-z]+/)*x", False),
        (r"(?>(a+)+)b", False),
        (r"(a+)++b", False),
    ],
)
def test_ambiguous_repeats_are_recognised(pattern: str, ambiguous: bool) -> None:
    assert is_ambiguous(parser.parse(pattern)) is ambiguous
