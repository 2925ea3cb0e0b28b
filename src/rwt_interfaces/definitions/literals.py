"""Literals in definitions: constants and ROS 2's default values."""

from __future__ import annotations

import re

from rwt_interfaces.definitions.model import WrittenType
from rwt_interfaces.errors import DefinitionError

Value = bool | int | float | str

_INTEGER = re.compile(r"[+-]?(?:0[xX][0-9a-fA-F]+|0[bB][01]+|0[oO][0-7]+|[0-9]+)", re.ASCII)
_FLOAT = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|inf|nan)", re.ASCII)
_BARE = re.compile(r"[^\s,\]#\"']+")
_QUOTED = re.compile(r"""'(?:\\.|[^'\\])*'|"(?:\\.|[^"\\])*\"""", re.DOTALL)
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r"}
_BOOLS = {"true": True, "false": False, "1": True, "0": False}

#: Smallest and largest value. `byte` and `char` changed their sign between ROS 1 and ROS 2, so both readings
#: are allowed.
_RANGES: dict[str, tuple[int, int]] = {
    "byte": (-128, 255),
    "char": (-128, 255),
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}


class Literals:
    """Parser of what follows a name: a value or a bracketed list, then an optional comment.

    `text` is the value as written, without the comment, after a value was read.
    """

    def __init__(self, line: str) -> None:
        self._line = line
        self._at = 0
        self.text = ""

    def constant(self, field_type: WrittenType) -> Value:
        """Return the value of a constant. Bare strings end at the comment or at the end of the line.

        Raises:
            DefinitionError: not a value of the type.
        """
        if field_type.name in ("string", "wstring") and not self._line.startswith(("'", '"')):
            self.text = self._line.partition("#")[0].strip()
            return _bounded(self.text, field_type)
        value = self._value(field_type)
        self._end()
        return value

    def default(self, field_type: WrittenType) -> Value | tuple[Value, ...]:
        """Return the default value of a field; a tuple for an array.

        Raises:
            DefinitionError: not a value of the type, or the wrong number of values.
        """
        if not field_type.is_array:
            return self.constant(field_type)
        values = self._list(field_type)
        self._end()
        if field_type.length is not None and len(values) != field_type.length:
            raise DefinitionError(f"expected {field_type.length} default values, got {len(values)}")
        if field_type.bound is not None and len(values) > field_type.bound:
            raise DefinitionError(f"expected at most {field_type.bound} default values, got {len(values)}")
        return values

    @staticmethod
    def format(value: object) -> str:
        """Return a value as written in a definition; the inverse of parsing."""
        if isinstance(value, tuple):
            return f"[{', '.join(Literals.format(item) for item in value)}]"
        if isinstance(value, bool):
            return "true" if value else "false"
        if isinstance(value, str):
            text = value.replace("\\", "\\\\").replace('"', '\\"')
            text = text.replace("\n", "\\n").replace("\t", "\\t").replace("\r", "\\r")
            return f'"{text}"'
        return repr(value)

    def _list(self, field_type: WrittenType) -> tuple[Value, ...]:
        if not self._take("["):
            raise DefinitionError(
                f"expected a list such as [1, 2] as default value, got {_shown(self._line)}"
            )
        values: list[Value] = []
        if self._take("]"):
            return ()
        while True:
            values.append(self._value(field_type))
            if self._take("]"):
                return tuple(values)
            if not self._take(","):
                raise DefinitionError(f'expected "," or "]" in the list {_shown(self._line)}')

    def _value(self, field_type: WrittenType) -> Value:
        if field_type.name in ("string", "wstring"):
            token = self._token(_QUOTED)
            if token is None:
                raise DefinitionError(f"expected a quoted string, got {_shown(self._line[self._at :])}")
            return _bounded(
                _ESCAPE.sub(lambda found: _ESCAPES.get(found[1], found[1]), token[1:-1]), field_type
            )
        token = self._token(_BARE)
        if token is None:
            raise DefinitionError(f"expected {field_type.name}, got {_shown(self._line[self._at :])}")
        return _scalar(token, field_type.name)

    def _token(self, pattern: re.Pattern[str]) -> str | None:
        self._skip()
        match = pattern.match(self._line, self._at)
        if match is None:
            return None
        self._at = match.end()
        return match[0]

    def _take(self, character: str) -> bool:
        self._skip()
        if not self._line.startswith(character, self._at):
            return False
        self._at += 1
        return True

    def _skip(self) -> None:
        while self._at < len(self._line) and self._line[self._at].isspace():
            self._at += 1

    def _end(self) -> None:
        self.text = self._line[: self._at].strip()
        self._skip()
        if self._at < len(self._line) and self._line[self._at] != "#":
            raise DefinitionError(f"unexpected text after the value: {_shown(self._line[self._at :])}")


def _scalar(token: str, name: str) -> Value:
    if name == "bool":
        value = _BOOLS.get(token.lower())
        if value is not None:
            return value
    elif name in ("float32", "float64"):
        if _FLOAT.fullmatch(token.lower()):
            return float(token)
    elif _INTEGER.fullmatch(token) and len(token) <= 80:
        return _integer(token, name)
    raise DefinitionError(f"expected {name}, got {_shown(token)}")


def _integer(token: str, name: str) -> int:
    # Base 10 without a prefix: int(…, 0) would reject 007.
    digits = token.lstrip("+-")[:2].lower()
    value = int(token, 0 if digits in ("0x", "0b", "0o") else 10)
    least, most = _RANGES[name]
    if not least <= value <= most:
        raise DefinitionError(f"{_shown(token)} does not fit {name}: {least} to {most}")
    return value


def _bounded(value: str, field_type: WrittenType) -> str:
    bound = field_type.string_bound
    if bound is not None and len(value) > bound:
        raise DefinitionError(f"a string of {len(value)} characters where at most {bound} are allowed")
    return value


def _shown(text: str) -> str:
    return f'"{text if len(text) <= 60 else text[:57] + "..."}"'
