"""Content filters of subscriptions, in DDS's expressions.

An expression is the `FilterExpression` of DDS 1.4, annex B: comparisons of fields with values,
`BETWEEN … AND …`, `LIKE` with `%` and `_`, `AND`, `OR`, `NOT` and parentheses. `%0` to `%99` are
parameters.

>>> ContentFilter("speed > %0 AND name LIKE 'wheel%'", ["1.5"])
ContentFilter("speed > %0 AND name LIKE 'wheel%'", ('1.5',))
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

#: Maximum nesting of parentheses and NOT, which limits the cost of hostile expressions.
MOST_NESTED: Final = 50
#: Maximum length of an expression in characters.
LONGEST: Final = 10_000

_TOKEN = re.compile(
    r"\s*(?:(?P<number>[-+]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))"
    r"|(?P<text>'[^']*'|`[^']*')|(?P<parameter>%\d{1,2})"
    r"|(?P<word>[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z_][A-Za-z0-9_]*)*)"
    r"|(?P<mark><>|!=|<=|>=|=|<|>|\(|\)))"
)
_COMPARISONS: Final[dict[str, Callable[[Any, Any], bool]]] = {
    "=": operator.eq, "<>": operator.ne, "!=": operator.ne,
    "<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge,
}  # fmt: skip
_KEYWORDS: Final = frozenset(("AND", "OR", "NOT", "LIKE", "BETWEEN", "TRUE", "FALSE"))

Operand = Callable[[Any], Any]
Condition = Callable[[Any], bool]


class InvalidFilter(ValueError):
    """An expression is invalid, or does not fit the message; the text gives position and expectation."""


@dataclass
class ContentFilterOptions:
    """Content filter of a subscription.

    Attributes:
        filter_expression: condition; empty for all messages.
        expression_parameters: values of `%0`, `%1` and so on, in the syntax of expressions.
    """

    filter_expression: str = ""
    expression_parameters: list[str] = field(default_factory=list)


class ContentFilter:
    """Condition on messages.

    Args:
        expression: filter expression of DDS.
        parameters: values of `%0`, `%1` and so on.
        fields: names of the message's fields; None to check them only with messages.

    Raises:
        InvalidFilter: it is invalid, lacks a parameter, or names an unknown field.
    """

    def __init__(
        self, expression: str, parameters: Sequence[str] = (), fields: frozenset[str] | None = None
    ) -> None:
        self.expression = expression
        self.parameters = tuple(parameters)
        self._matches = _Parser(expression, self.parameters, fields).parse()

    def __repr__(self) -> str:
        return f"ContentFilter({self.expression!r}, {self.parameters!r})"

    def matches(self, message: Any) -> bool:
        """True if a message matches. Raises InvalidFilter for a missing field or incomparable values."""
        return self._matches(message)


class _Parser:
    """Parser of one expression, from left to right: NOT before AND before OR."""

    def __init__(self, text: str, parameters: tuple[str, ...], fields: frozenset[str] | None) -> None:
        if len(text) > LONGEST:
            raise InvalidFilter(f"the filter has {len(text)} characters: expected at most {LONGEST}")
        self._text = text
        self._parameters = parameters
        self._fields = fields
        self._tokens = list(_tokens(text))
        self._at = 0
        self._depth = 0

    def parse(self) -> Condition:
        found = self._either()
        if self._at < len(self._tokens):
            raise self._wrong("AND, OR or the end")
        return found

    def _wrong(self, expected: str) -> InvalidFilter:
        found = self._tokens[self._at][1] if self._at < len(self._tokens) else "the end"
        return InvalidFilter(f"the filter {self._text!r}: expected {expected}, got {found}")

    def _peek(self) -> str:
        kind, text = self._tokens[self._at] if self._at < len(self._tokens) else ("", "")
        return text.upper() if kind == "word" and text.upper() in _KEYWORDS else text

    def _take(self, wanted: str) -> bool:
        if self._peek() != wanted:
            return False
        self._at += 1
        return True

    def _either(self) -> Condition:
        terms = [self._both()]
        while self._take("OR"):
            terms.append(self._both())
        return terms[0] if len(terms) == 1 else lambda message: any(term(message) for term in terms)

    def _both(self) -> Condition:
        terms = [self._negation()]
        while self._take("AND"):
            terms.append(self._negation())
        return terms[0] if len(terms) == 1 else lambda message: all(term(message) for term in terms)

    def _negation(self) -> Condition:
        self._depth += 1
        if self._depth > MOST_NESTED:
            raise InvalidFilter(f"the filter is nested deeper than {MOST_NESTED}")
        try:
            if self._take("NOT"):
                negated = self._negation()
                return lambda message: not negated(message)
            if self._take("("):
                inner = self._either()
                if not self._take(")"):
                    raise self._wrong("')'")
                return inner
            return self._comparison()
        finally:
            self._depth -= 1

    def _comparison(self) -> Condition:
        left = self._operand()
        excluded = self._take("NOT")
        if self._take("BETWEEN"):
            low = self._operand()
            if not self._take("AND"):
                raise self._wrong("AND, as in BETWEEN 1 AND 2")
            high = self._operand()
            return lambda message: _is_between(low(message), left(message), high(message)) is not excluded
        if excluded:
            raise self._wrong("BETWEEN after NOT")
        if self._take("LIKE"):
            pattern = self._operand()
            return lambda message: _is_like(left(message), pattern(message))
        compare = _COMPARISONS.get(self._peek())
        if compare is None:
            raise self._wrong(f"one of {', '.join(_COMPARISONS)}, LIKE or BETWEEN")
        self._at += 1
        right = self._operand()
        return lambda message: _compare(compare, left(message), right(message))

    def _operand(self) -> Operand:
        if self._at >= len(self._tokens):
            raise self._wrong("a field or a value")
        kind, text = self._tokens[self._at]
        if kind == "mark" or (kind == "word" and text.upper() in _KEYWORDS - {"TRUE", "FALSE"}):
            raise self._wrong("a field or a value")
        self._at += 1
        if kind == "parameter":
            number = int(text[1:])
            if number >= len(self._parameters):
                raise InvalidFilter(
                    f"the filter {self._text!r} has {text}, and {len(self._parameters)} parameters were given"
                )
            value = _parameter(self._parameters[number])
            return lambda message: value
        if kind == "word" and text.upper() not in _KEYWORDS:
            return self._field(text)
        literal = _literal(kind, text)
        return lambda message: literal

    def _field(self, path: str) -> Operand:
        names = path.split(".")
        if self._fields is not None and names[0] not in self._fields:
            known = ", ".join(sorted(self._fields)) or "no field"
            raise InvalidFilter(f"the filter {self._text!r} names {path!r}; the message has {known}")

        def value(message: Any) -> Any:
            for name in names:
                message = getattr(message, name, _NOTHING)
                if message is _NOTHING:
                    raise InvalidFilter(f"the message has no field {path!r}")
            return message

        return value


_NOTHING: Final = object()


def _tokens(text: str) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    at, end = 0, len(text.rstrip())
    while at < end:
        match = _TOKEN.match(text, at)
        if match is None:
            raise InvalidFilter(
                f"the filter {text!r} cannot be read from character {at}: {text[at : at + 20]!r}"
            )
        assert match.lastgroup is not None  # Each alternative is named.
        found.append((match.lastgroup, match[match.lastgroup]))
        at = match.end()
    return found


def _literal(kind: str, text: str) -> Any:
    if kind == "text":
        return text[1:-1]
    if kind == "word":
        return text.upper() == "TRUE"
    if "x" in text.lower():
        return int(text, 16)
    return float(text) if any(mark in text for mark in ".eE") else int(text)


def _parameter(text: str) -> Any:
    """Return the value of a parameter: a number, boolean or quoted string; any other text is a string."""
    found = _TOKEN.fullmatch(text.strip())
    if found is None or found.lastgroup not in ("number", "text", "word"):
        return text
    if found.lastgroup == "word" and text.strip().upper() not in ("TRUE", "FALSE"):
        return text
    return _literal(found.lastgroup, text.strip())


def _compare(compare: Callable[[Any, Any], bool], left: Any, right: Any) -> bool:
    try:
        return bool(compare(left, right))
    except (TypeError, ValueError) as error:
        raise InvalidFilter(f"{left!r} and {right!r} cannot be compared: {error}") from None


def _is_between(low: Any, value: Any, high: Any) -> bool:
    return _compare(operator.le, low, value) and _compare(operator.le, value, high)


def _is_like(value: Any, pattern: Any) -> bool:
    if not isinstance(value, str) or not isinstance(pattern, str):
        raise InvalidFilter(f"LIKE compares texts: got {value!r} and {pattern!r}")
    return _like(value, pattern)


def _like(value: str, pattern: str) -> bool:
    """Match a string with `%` for anything and `_` for one character; costs the product of the lengths."""
    at = wild = 0
    star = -1
    index = 0
    while index < len(value):
        if at < len(pattern) and pattern[at] == "%":
            star, wild = at, index
            at += 1
        elif at < len(pattern) and pattern[at] in ("_", value[index]):
            at += 1
            index += 1
        elif star >= 0:
            wild += 1
            index, at = wild, star + 1
        else:
            return False
    return all(each == "%" for each in pattern[at:])
