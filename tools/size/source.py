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
        code: lines with at least one token that is neither a comment nor part of a docstring.
        comments: lines with nothing but a comment.
    """

    lines: int = 0
    code: int = 0
    comments: int = 0

    def __add__(self, other: LineCounts) -> LineCounts:
        return LineCounts(self.lines + other.lines, self.code + other.code, self.comments + other.comments)


def count_lines(text: str) -> LineCounts:
    """Count the physical lines of a module."""
    in_docstrings = {
        row
        for each in docstring_nodes(ast.parse(text))
        for row in range(each.lineno, (each.end_lineno or each.lineno) + 1)
    }
    code: set[int] = set()
    comments: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            comments.add(token.start[0])
        elif token.type not in _NO_CODE and not (
            token.type == tokenize.STRING and token.start[0] in in_docstrings
        ):
            code.update(range(token.start[0], token.end[0] + 1))
    lines = text.count("\n") + (bool(text) and not text.endswith("\n"))
    return LineCounts(lines, len(code), len(comments - code - in_docstrings))


def total(counts: Iterable[LineCounts]) -> LineCounts:
    """Add counts up."""
    return sum(counts, LineCounts())


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
