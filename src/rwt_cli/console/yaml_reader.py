"""Reads the YAML in which people write ROS messages and parameters; JSON is read by the same function.

There is no YAML library among the dependencies, and a message argument must work in every installation, so
this reads the part of YAML 1.2 that messages and parameter files are made of: block and flow collections,
plain and quoted scalars, literal and folded text. Anchors, aliases, tags, directives, several documents and
keys that are no scalars are refused by name. ``yes``, ``no``, ``on`` and ``off`` are booleans as in the
``ros2`` tool.
"""

from __future__ import annotations

import json
import math
import re
from typing import Final

YamlValue = None | bool | int | float | str | list["YamlValue"] | dict[str, "YamlValue"]

_DEEPEST: Final = 100
_LONGEST_NUMBER: Final = 400
_NULL: Final = frozenset({"", "~", "null", "Null", "NULL"})
_BOOLEANS: Final = {
    spelling: value
    for value, words in ((True, ("true", "yes", "on")), (False, ("false", "no", "off")))
    for word in words
    for spelling in (word, word.capitalize(), word.upper())
}
_INT: Final = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", re.ASCII)
_FLOAT: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", re.ASCII)
_INFINITE: Final = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_NAN: Final = frozenset({".nan", ".NaN", ".NAN"})
_ESCAPES: Final = {
    "0": "\0", "a": "\a", "b": "\b", "t": "\t", "\t": "\t", "n": "\n", "v": "\v", "f": "\f", "r": "\r",
    "e": "\x1b", " ": " ", '"': '"', "/": "/", "\\": "\\", "N": "\x85", "_": "\xa0", "L": "\u2028",
    "P": "\u2029",
}  # fmt: skip
_HEXADECIMAL: Final = {"x": 2, "u": 4, "U": 8}
_REFUSED: Final = {
    "&": "an anchor (&)", "*": "an alias (*)", "!": "a tag (!)", "%": "a directive (%)",
    "@": "a word that begins with @", "`": "a word that begins with `",
}  # fmt: skip
_BLOCK_TEXT: Final = re.compile(r"([|>])([-+]?)([1-9]?)([-+]?)[ \t]*(?:#[^\n]*)?(?:\n|$)")


class YamlError(ValueError):
    """A text that cannot be read; says on which line and column, and what was expected."""


def read_yaml(text: str) -> YamlValue:
    """The value that a text holds: a YAML document or a JSON text; an empty one is None.

    Raises:
        YamlError: it cannot be read; no other exception, whatever the text.
    """
    if text.lstrip()[:1] in ("{", "[", '"'):
        try:
            value: YamlValue = json.loads(text)
        except (ValueError, RecursionError):
            pass
        else:
            return value
    return _Reader(text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")).document()


def scalar(text: str) -> YamlValue:
    """What a plain scalar stands for."""
    if text in _NULL:
        return None
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    if len(text) <= _LONGEST_NUMBER:
        if _INT.fullmatch(text):
            return int(text, 0) if text[:2] in ("0x", "0o") else int(text)
        if _FLOAT.fullmatch(text):
            return float(text)
    if found := _INFINITE.fullmatch(text):
        return -math.inf if found[1] == "-" else math.inf
    return math.nan if text in _NAN else text


class _Reader:
    """Reads one document from its beginning; `self._at` is how far it has come."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0

    # -- the document --------------------------------------------------------------------------------------

    def document(self) -> YamlValue:
        self._skip()
        if self._marker("---"):
            self._at += 3
            self._skip()
        if self._peek() == "%" and self._column() == 0:
            raise self._error("a directive (%) is not read")
        value = None if self._marker("...") or self._ended() else self._node(-1, 0)
        self._skip()
        if self._marker("..."):
            self._at += 3
            self._skip()
        if not self._ended():
            raise self._error(
                "another document begins here: one is expected"
                if self._marker("---")
                else "expected the end, or the indentation of the lines above"
            )
        return value

    def _marker(self, marker: str) -> bool:
        after = self._text[self._at + 3 : self._at + 4]
        return self._column() == 0 and self._text.startswith(marker, self._at) and after in ("", " ", "\n")

    # -- block collections ---------------------------------------------------------------------------------

    def _node(self, parent: int, depth: int) -> YamlValue:
        """The node that begins here, in a collection at the column `parent`."""
        if depth > _DEEPEST:
            raise self._error(f"nested more than {_DEEPEST} deep")
        if self._peek() == "?" and self._text[self._at + 1 : self._at + 2] in ("", " ", "\n"):
            raise self._error("a key that is no scalar (?) is not read")
        column = self._column()
        if self._is_dash():
            return self._sequence(column, depth)
        if self._key_ends() is not None:
            return self._mapping(column, depth)
        return self._inline(parent, depth)

    def _sequence(self, column: int, depth: int) -> list[YamlValue]:
        items: list[YamlValue] = []
        while not self._ended() and self._column() == column and self._is_dash():
            self._at += 1
            line = self._line()
            self._skip()
            inside = not self._ended() and (self._line() == line or self._column() > column)
            items.append(self._node(column, depth + 1) if inside else None)
            self._end_of_node(column)
        return items

    def _mapping(self, column: int, depth: int) -> dict[str, YamlValue]:
        found: dict[str, YamlValue] = {}
        while not self._ended() and self._column() == column and not self._at_end_marker():
            start = self._at
            ends = self._key_ends()
            if ends is None:
                raise self._error("expected `key: value`")
            key = self._key(ends)
            if key in found:
                self._at = start
                raise self._error(f"the key {key!r} is there twice")
            self._at = ends + 1
            found[key] = self._value(column, depth)
            self._end_of_node(column)
        return found

    def _value(self, column: int, depth: int) -> YamlValue:
        """What stands after a key of a block mapping."""
        line = self._line()
        self._skip()
        if self._ended():
            return None
        if self._line() == line:
            if self._is_dash():
                raise self._error("a list begins on the line below its key")
            return self._inline(column, depth + 1)
        if self._column() > column or (self._column() == column and self._is_dash()):
            return self._node(column, depth + 1)
        return None

    def _end_of_node(self, column: int) -> None:
        """A node has ended: go to the next one, which must stand on another line and not deeper."""
        line = self._line()
        self._skip()
        if self._ended():
            return
        if self._line() == line and self._before().strip(" "):
            raise self._error("expected the end of the line")
        if self._column() > column:
            raise self._error("expected the indentation of the lines above")

    def _at_end_marker(self) -> bool:
        return self._marker("...") or self._marker("---")

    def _is_dash(self) -> bool:
        return self._peek() == "-" and self._text[self._at + 1 : self._at + 2] in ("", " ", "\n", "\t")

    def _key_ends(self) -> int | None:
        """Where the colon of the key is that begins here; None if no key begins here."""
        at = self._at
        first = self._peek()
        if first in ("'", '"'):
            try:
                self._quoted()
            except YamlError:
                return None
            else:
                end = self._at
                if "\n" in self._text[at:end]:
                    return None
                while self._text[end : end + 1] in (" ", "\t") and end < len(self._text):
                    end += 1
                return end if self._is_colon(end) else None
            finally:
                self._at = at
        if first in ("[", "{", "|", ">", "#", *_REFUSED):
            return None
        for end in range(at, len(self._text)):
            here = self._text[end]
            if here == "\n" or (here == "#" and end > at and self._text[end - 1] in " \t"):
                return None
            if here == ":" and self._is_colon(end):
                return end
        return None

    def _is_colon(self, at: int) -> bool:
        return self._text[at : at + 1] == ":" and self._text[at + 1 : at + 2] in ("", " ", "\n", "\t")

    def _key(self, ends: int) -> str:
        if self._peek() in ("'", '"'):
            return self._quoted()
        key = self._text[self._at : ends].strip(" \t")
        if not key:
            raise self._error("expected a key before the colon")
        return key

    # -- inline nodes --------------------------------------------------------------------------------------

    def _inline(self, parent: int, depth: int) -> YamlValue:
        """A scalar or flow collection in a block collection at the column `parent`."""
        first = self._peek()
        if first in ("[", "{"):
            return self._flow(depth)
        if first in ("'", '"'):
            return self._quoted()
        if first in ("|", ">"):
            return self._block_text(parent)
        self._refuse(first)
        return scalar(self._plain_in_block(parent))

    def _refuse(self, first: str) -> None:
        if first in _REFUSED:
            raise self._error(f"{_REFUSED[first]} is not read; text that begins so goes in quotes")
        if first in (",", "]", "}"):
            raise self._error(f"expected a value, got {first!r}")

    def _plain_in_block(self, parent: int) -> str:
        """A plain scalar; lines below that stand deeper than `parent` continue it."""
        words = [self._plain_line(self._at)]
        while True:
            at = self._at
            blank = self._text.count("\n", at, self._after_space(at))
            self._at = self._after_space(at)
            if self._ended() or not blank or self._column() <= parent or self._peek() == "#":
                self._at = at
                return "".join(words)
            if self._key_ends() is not None:
                raise self._error("expected the indentation of the lines above, or quotes around the text")
            words.append("\n" * (blank - 1) if blank > 1 else " ")
            words.append(self._plain_line(self._at))

    def _plain_line(self, start: int) -> str:
        end = start
        while end < len(self._text) and self._text[end] != "\n":
            if self._text[end] == "#" and end > start and self._text[end - 1] in " \t":
                break
            if self._text[end] == ":" and self._is_colon(end):
                self._at = end
                raise self._error("a second colon on the line: text with a colon in it goes in quotes")
            end += 1
        text = self._text[start:end].rstrip(" \t")
        self._at = start + len(text)
        return text

    def _after_space(self, at: int) -> int:
        while at < len(self._text) and self._text[at] in " \t\n":
            at += 1
        return at

    def _block_text(self, parent: int) -> str:
        """Literal (``|``) and folded (``>``) text, YAML 1.2 section 8.1."""
        head = _BLOCK_TEXT.match(self._text, self._at)
        if head is None:
            raise self._error("expected the text on the lines below")
        kind, before, width, after = head.groups()
        lines = self._block_lines(head.end(), parent, max(parent, 0) + int(width) if width else None)
        body = "\n".join(lines) if kind == "|" else _folded(lines)
        if not any(lines):
            body = ""
        chomp = before or after
        stripped = body.rstrip("\n")
        if chomp == "-":
            return stripped
        if chomp == "+":
            return "\n".join(lines) + "\n" if kind == "|" and lines else body + "\n"
        return f"{stripped}\n" if stripped else ""

    def _block_lines(self, start: int, parent: int, indent: int | None) -> list[str]:
        lines: list[str] = []
        at = start
        while at < len(self._text):
            end = self._text.find("\n", at)
            end = len(self._text) if end < 0 else end
            line = self._text[at:end]
            lead = len(line) - len(line.lstrip(" "))
            if line.strip(" "):
                if indent is None and lead > parent:
                    indent = lead
                if indent is None or lead < indent:
                    break
                lines.append(line[indent:])
            else:
                lines.append(line[indent or lead :])
            at = end + 1
        # At the line end before what follows: from there the next node is looked for.
        self._at = max(start - 1, min(at, len(self._text)) - 1)
        return lines

    def _quoted(self) -> str:
        quote = self._peek()
        start = self._at
        self._at += 1
        parts: list[str] = []
        while not self._ended():
            here = self._peek()
            self._at += 1
            if here == quote:
                if quote == "'" and self._peek() == "'":
                    parts.append("'")
                    self._at += 1
                    continue
                return "".join(parts)
            if here == "\\" and quote == '"':
                parts.append(self._escape())
            elif here == "\n":
                self._fold(parts)
            else:
                parts.append(here)
        self._at = start
        raise self._error(f"the text that begins here has no closing {quote}")

    def _fold(self, parts: list[str]) -> None:
        """A line end in a quoted text: one is a space, more are one fewer."""
        while parts and parts[-1] in (" ", "\t"):
            parts.pop()
        begin = self._at
        self._at = self._after_space(begin)
        more = self._text.count("\n", begin, self._at)
        parts.append("\n" * more if more else " ")

    def _escape(self) -> str:
        kind = self._peek()
        self._at += 1
        if kind == "\n":
            self._at = self._after_space(self._at)
            return ""
        if kind in _ESCAPES:
            return _ESCAPES[kind]
        digits = self._text[self._at : self._at + _HEXADECIMAL.get(kind, 0)]
        if kind not in _HEXADECIMAL or len(digits) != _HEXADECIMAL[kind]:
            raise self._error(f"no such escape: \\{kind}")
        try:
            found = chr(int(digits, 16))
        except (ValueError, OverflowError):
            raise self._error(f"no such escape: \\{kind}{digits}") from None
        self._at += len(digits)
        return found

    # -- flow collections ----------------------------------------------------------------------------------

    def _flow(self, depth: int) -> YamlValue:
        if depth > _DEEPEST:
            raise self._error(f"nested more than {_DEEPEST} deep")
        start = self._at
        closing = {"[": "]", "{": "}"}[self._peek()]
        self._at += 1
        items: list[YamlValue] = []
        fields: dict[str, YamlValue] = {}
        while True:
            self._skip()
            if self._ended():
                self._at = start
                raise self._error(f"what begins here has no closing {closing}")
            if self._peek() == closing:
                self._at += 1
                return items if closing == "]" else fields
            if closing == "]":
                items.append(self._flow_value(depth))
            else:
                self._flow_pair(fields, depth)
            self._skip()
            if self._peek() == ",":
                self._at += 1
            elif not self._ended() and self._peek() != closing:
                raise self._error(f"expected a comma or {closing}")

    def _flow_value(self, depth: int) -> YamlValue:
        first = self._peek()
        if first in ("[", "{"):
            return self._flow(depth + 1)
        if first in ("'", '"'):
            return self._quoted()
        self._refuse(first)
        return scalar(self._plain_in_flow())

    def _flow_pair(self, fields: dict[str, YamlValue], depth: int) -> None:
        start = self._at
        first = self._peek()
        if first in ("[", "{"):
            raise self._error("expected a key")
        quoted = first in ("'", '"')
        if not quoted:
            self._refuse(first)
        key = self._quoted() if quoted else self._plain_in_flow()
        if key in fields:
            self._at = start
            raise self._error(f"the key {key!r} is there twice")
        self._skip()
        if self._peek() != ":":
            if ":" in key and not quoted:
                self._at = start + key.index(":")
                raise self._error("expected a space after the colon")
            raise self._error(f"expected a colon after {key!r}")
        self._at += 1
        self._skip()
        fields[key] = None if self._peek() in (",", "}") else self._flow_value(depth)

    def _plain_in_flow(self) -> str:
        start = end = self._at
        while end < len(self._text):
            here = self._text[end]
            if here in ",[]{}" or (here == "#" and end > start and self._text[end - 1] in " \t\n"):
                break
            if here == ":" and self._text[end + 1 : end + 2] in (
                "",
                " ",
                "\n",
                "\t",
                ",",
                "]",
                "}",
                "[",
                "{",
            ):
                break
            end += 1
        self._at = end
        if start == end:
            raise self._error("expected a value")
        return " ".join(self._text[start:end].split())

    # -- places --------------------------------------------------------------------------------------------

    def _peek(self) -> str:
        return self._text[self._at : self._at + 1]

    def _ended(self) -> bool:
        return self._at >= len(self._text)

    def _line(self) -> int:
        return self._text.count("\n", 0, self._at)

    def _column(self) -> int:
        return self._at - (self._text.rfind("\n", 0, self._at) + 1)

    def _before(self) -> str:
        """What stands before this place on its line."""
        return self._text[self._at - self._column() : self._at]

    def _skip(self) -> None:
        """Go to what comes next, over spaces, line ends and comments."""
        while not self._ended():
            here = self._peek()
            if here == "#" and (self._at == 0 or self._text[self._at - 1] in " \t\n"):
                end = self._text.find("\n", self._at)
                self._at = len(self._text) if end < 0 else end
            elif here not in " \n\t":
                before = self._before()
                if "\t" in before and not before.strip(" \t"):
                    raise self._error("a tab in the indentation: YAML takes spaces")
                return
            else:
                self._at += 1

    def _error(self, text: str) -> YamlError:
        return YamlError(f"line {self._line() + 1}, column {self._column() + 1}: {text}")


def _folded(lines: list[str]) -> str:
    """Lines joined by spaces; an empty line is a line end, and lines that stand deeper stay as they are."""
    joined = ""
    empty = 0
    previous = ""
    for line in lines:
        if not line:
            empty += 1
            continue
        deeper = line[0] in " \t" or previous[:1] in (" ", "\t")
        if joined or empty:
            joined += "\n" * (empty + (1 if deeper and joined else 0)) or (" " if joined else "")
        joined += line
        previous, empty = line, 0
    return joined + "\n" * empty
