"""Messages and parameters as YAML, read and written as the ``ros2`` tool does; JSON is read, too.

Parser and emitter are PyYAML's. Values are built here from the parser's events, so that input can neither
create objects nor expand to huge values or endless recursion: anchors, aliases, tags, several documents and
keys that are not scalars are rejected. Importing this module imports PyYAML.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final, TypeAlias

import yaml
from yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
    StreamEndEvent,
)
from yaml.reader import Reader

if TYPE_CHECKING:
    from yaml._yaml import Mark as CMark
    from yaml.error import Mark as PythonMark

    Mark = CMark | PythonMark | None

YamlValue: TypeAlias = "bool | int | float | str | list[YamlValue] | dict[str, YamlValue] | None"

MAX_CHARS: Final = 10_000_000
"""Maximum characters of a YAML text."""
MAX_DEPTH: Final = 100
"""Maximum nesting depth."""

LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_DUMPER: Final = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

_MAX_CHARS_NUMBER: Final = 400
_NULL: Final = frozenset({"", "~", "null", "Null", "NULL"})
_BOOLEANS: Final = {
    spelling: value
    for value, words in ((True, ("true", "yes", "on")), (False, ("false", "no", "off")))
    for word in words
    for spelling in (word, word.capitalize(), word.upper())
}
_OCTAL: Final = re.compile(r"[-+]?0[0-7]+", re.ASCII)
_DECIMAL: Final = re.compile(r"[-+]?[0-9]+", re.ASCII)
_PREFIXED: Final = re.compile(r"[-+]?0(?:b[01]+|o[0-7]+|x[0-9a-fA-F]+)", re.ASCII)
_FLOAT: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", re.ASCII)
_INFINITE: Final = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_NAN: Final = frozenset({".nan", ".NaN", ".NAN"})
_NOT_ASCII: Final = re.compile(r"[^\n -~]")

_QUOTES: Final = "text that begins so goes in quotes"
_MEANINGS: Final = (
    ("mapping values are not allowed", "a second colon: text with a colon in it goes in quotes"),
    ("sequence entries are not allowed", "a list begins on the line below its key"),
    ("escape", "no such escape: a backslash in double quotes is \\\\, or the text goes in single quotes"),
    (
        "expected key|block end|'-' indicator",
        "expected the end of the line, or the indentation of lines above",
    ),
    ("expected ',' or ']'", "expected a comma or ]"),
    ("expected ',' or '}'", "expected a comma or }"),
    ("node content", "expected a value"),
    ("comment or line break|chomping", "expected the text on the lines below"),
    ("document start", "expected the end of the text"),
    ("directive", "a directive (%) is not read"),
)
"""Error texts by those of the parser; its C and Python implementations use different ones."""


class YamlError(ValueError):
    """Invalid text; the message has the line, the column and what was expected."""


# -- reading -----------------------------------------------------------------------------------------------


def read_yaml(text: str) -> YamlValue:
    """Parse a YAML document or a JSON text; an empty one is None.

    Raises:
        YamlError: the text is invalid. No other exception is raised, for any text.
    """
    if text.lstrip()[:1] in ("{", "[", '"'):
        try:
            value: YamlValue = json.loads(text)
        except (ValueError, RecursionError):
            pass
        else:
            return value
    return _Document(text.removeprefix("\ufeff")).value()


def scalar(text: str) -> YamlValue:
    """Return the value of a plain scalar.

    Follows YAML 1.1, as the ``ros2`` tool does (010 is 8, 1_000 is 1000, ``on`` is true), with exceptions
    that suit messages: 1e3 is a number, 12:30 and 2020-01-01 are strings.
    """
    if text in _NULL:
        return None
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    if len(text) <= _MAX_CHARS_NUMBER and text[0] != "_":
        digits = text.replace("_", "")
        for form, base in ((_OCTAL, 8), (_DECIMAL, 10), (_PREFIXED, 0)):
            if form.fullmatch(digits):
                return int(digits, base)
        if _FLOAT.fullmatch(digits):
            return float(digits)
    if found := _INFINITE.fullmatch(text):
        return -math.inf if found[1] == "-" else math.inf
    return math.nan if text in _NAN else text


class _Document:
    """Builder of the value of one text from the parser's events."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._events = self._parsed()
        self._open: list[MappingStartEvent | SequenceStartEvent] = []

    def value(self) -> YamlValue:
        self._check_characters()
        next(self._events)
        if isinstance(next(self._events), StreamEndEvent):
            return None
        value = self._node(next(self._events))
        next(self._events)
        after = next(self._events)
        if isinstance(after, DocumentStartEvent):
            raise _error(after.start_mark, "another document begins here: one is expected")
        return value

    def _check_characters(self) -> None:
        if len(self._text) > MAX_CHARS:
            raise YamlError(f"line 1, column 1: YAML of more than {MAX_CHARS} characters is not read")
        if strange := Reader.NON_PRINTABLE.search(self._text):
            at, code = strange.start(), ord(strange[0])
            line, column = self._text.count("\n", 0, at) + 1, at - self._text.rfind("\n", 0, at)
            raise YamlError(
                f'line {line}, column {column}: U+{code:04X} is written in double quotes, as "\\u{code:04x}"'
            )

    def _parsed(self) -> Iterator[Event]:
        try:
            yield from yaml.parse(self._text, Loader=LOADER)
        except yaml.MarkedYAMLError as error:
            raise self._explained(error) from error
        except OverflowError as error:  # of the parser in Python, which PyPy has
            raise YamlError("line 1, column 1: no such escape: \\U goes to 0010ffff") from error

    def _node(self, event: Event) -> YamlValue:
        _refuse_references(event)
        if isinstance(event, ScalarEvent):
            return scalar(event.value) if event.implicit[0] else event.value
        assert isinstance(event, MappingStartEvent | SequenceStartEvent)  # No other node is left.
        if len(self._open) == MAX_DEPTH:
            raise _error(event.start_mark, f"nested more than {MAX_DEPTH} deep")
        self._open.append(event)
        value = self._fields(event) if isinstance(event, MappingStartEvent) else self._items()
        self._open.pop()
        return value

    def _items(self) -> list[YamlValue]:
        items: list[YamlValue] = []
        while not isinstance(event := next(self._events), SequenceEndEvent):
            items.append(self._node(event))
        return items

    def _fields(self, start: MappingStartEvent) -> dict[str, YamlValue]:
        fields: dict[str, YamlValue] = {}
        while not isinstance(key := next(self._events), MappingEndEvent):
            _refuse_references(key)
            if not isinstance(key, ScalarEvent):
                raise _error(key.start_mark, "expected a key that is text or a number")
            if key.value in fields:
                raise _error(key.start_mark, f"the key {key.value!r} is there twice")
            fields[key.value] = value = self._node(next(self._events))
            if value is None and start.flow_style and key.implicit[0] and ":" in key.value:
                raise _error(key.start_mark, f"expected a space after the colon in {key.value!r}")
        return fields

    def _explained(self, error: yaml.MarkedYAMLError) -> YamlError:
        """Convert an error of the parser to position and expectation."""
        problem, mark = error.problem or "", error.problem_mark
        assert mark is not None  # The parser sets all marks.
        begin = error.context_mark or mark
        if self._open and self._open[-1].flow_style and not self._text[mark.index :].strip():
            brackets = "{}" if isinstance(self._open[-1], MappingStartEvent) else "[]"
            return _error(self._open[-1].start_mark, f"{brackets[0]} has no closing {brackets[1]}")
        if "unexpected" in problem:
            return _error(begin, "the text that begins here has no closing quote")
        if "find expected ':'" in problem:
            return _error(begin, "expected `key: value`")
        if "cannot start any token" in problem:
            first = self._text[mark.index : mark.index + 1]
            tab = "a tab in the indentation: YAML takes spaces"
            return _error(mark, tab if first == "\t" else f"{first}: {_QUOTES}")
        return _error(mark, next((said for found, said in _MEANINGS if re.search(found, problem)), problem))


def _refuse_references(event: Event) -> None:
    if isinstance(event, AliasEvent):
        raise _error(event.start_mark, f"an alias (*) is not read; {_QUOTES}")
    if getattr(event, "anchor", None) is not None:
        raise _error(event.start_mark, f"an anchor (&) is not read; {_QUOTES}")
    if getattr(event, "tag", None) is not None:
        raise _error(event.start_mark, f"a tag (!) is not read; {_QUOTES}")


def _error(mark: Mark, text: str) -> YamlError:
    assert mark is not None  # The parser sets all marks.
    return YamlError(f"line {mark.line + 1}, column {mark.column + 1}: {text}")


# -- writing -----------------------------------------------------------------------------------------------


class _Dumper(_DUMPER):  # type: ignore[misc,valid-type]  # the C dumper if PyYAML was built with it
    """Dumper of text that :func:`read_yaml` and the ``ros2`` tool both read as the same value."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _represent_text(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    style = '"' if not text.isprintable() else None if isinstance(scalar(text), str) else "'"
    node: yaml.ScalarNode = dumper.represent_scalar("tag:yaml.org,2002:str", text, style)
    return node


_Dumper.add_representer(str, _represent_text)


def block(value: YamlValue) -> str:
    """Return a value as lines, one for each member and item, each with its line end."""
    return _dumped(value, flow_style=False)


def flow(value: YamlValue) -> str:
    """Return a value on one line, without a line end."""
    return _dumped(value, flow_style=True).rstrip("\n")


def _dumped(value: YamlValue, *, flow_style: bool) -> str:
    text: str = yaml.dump(
        value,
        Dumper=_Dumper,
        default_flow_style=flow_style,
        sort_keys=False,
        allow_unicode=True,
        width=1_000_000_000,
    )
    # Unprintable characters are in double quotes, where they can be written as escapes.
    return _NOT_ASCII.sub(_escaped, text.removesuffix("...\n"))


def _escaped(found: re.Match[str]) -> str:
    character = found[0]
    if character.isprintable():
        return character
    code = ord(character)
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
