"""Lines of Python source by kind, and its docstrings."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

FIRST_WORDS: Final = re.compile(r"(What|Whether|It|They|There|Nobody|Nothing|How|Who|Never)\b")
"""Words with which no docstring begins."""

_DIRECTIVE: Final = re.compile(r"#\s*(type:|noqa|mypy:|pragma:|!)")

_DOCUMENTED: Final = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)

_NO_CODE: Final = frozenset(
    {
        tokenize.COMMENT,
        tokenize.NL,
        tokenize.NEWLINE,
        tokenize.INDENT,
        tokenize.DEDENT,
        tokenize.ENCODING,
        tokenize.ENDMARKER,
    }
)


@dataclass(frozen=True, slots=True)
class LineCounts:
    """Lines of some source.

    Attributes:
        lines: all lines.
        code: lines with at least one token that is neither a comment nor part of the docstring of a module,
            class or function.
        comments: lines with a comment that is no directive of a checker, also behind code.
    """

    lines: int = 0
    code: int = 0
    comments: int = 0

    def __add__(self, other: LineCounts) -> LineCounts:
        return LineCounts(self.lines + other.lines, self.code + other.code, self.comments + other.comments)

    @property
    def commented(self) -> float:
        """Lines with a comment, in percent."""
        return round(100 * self.comments / self.lines, 2) if self.lines else 0.0


def count_lines(text: str) -> LineCounts:
    """Count the physical lines of a module."""
    in_docstrings = {
        row
        for node in ast.walk(ast.parse(text))
        if isinstance(node, _DOCUMENTED)
        for row in docstring_rows(node)
    }
    code: set[int] = set()
    comments: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            if not _DIRECTIVE.match(token.string):
                comments.add(token.start[0])
        elif token.type not in _NO_CODE and not (
            token.type == tokenize.STRING and token.start[0] in in_docstrings
        ):
            code.update(range(token.start[0], token.end[0] + 1))
    lines = text.count("\n") + (bool(text) and not text.endswith("\n"))
    return LineCounts(lines, len(code), len(comments))


def total(counts: Iterable[LineCounts]) -> LineCounts:
    """Add counts up."""
    return sum(counts, LineCounts())


def is_alias(text: str) -> bool:
    """Return true if a module is only a deprecated alias, as the first word of its docstring says."""
    return (ast.get_docstring(ast.parse(text)) or "").startswith("Deprecated")


def docstring_rows(node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> range:
    """Return the numbers of the lines of a docstring, none if there is no docstring."""
    if ast.get_docstring(node, clean=False) is None:
        return range(0)
    return range(node.body[0].lineno, (node.body[0].end_lineno or node.body[0].lineno) + 1)


def docstring_nodes(tree: ast.AST) -> Iterator[ast.Constant]:
    """Yield every string that is a statement by itself: docstrings, and those below attributes."""
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            yield node.value


def rejected_docstrings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line number and first line of each docstring that begins with one of :data:`FIRST_WORDS`."""
    for node in docstring_nodes(tree):
        text = str(node.value).lstrip()
        if FIRST_WORDS.match(text):
            yield node.lineno, text.partition("\n")[0]
