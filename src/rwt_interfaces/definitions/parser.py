"""Parser and formatter of ``.msg``, ``.srv`` and ``.action`` texts.

One grammar serves all distributions; fields of :class:`Distro` settle the three differences:

* a string constant is the rest of its line, ``#`` and quotes included (1), or a quoted or bare word with an
  optional comment (2);
* a time is a primitive (1) or ``builtin_interfaces/Time`` (2); the other spelling is translated, so that
  packages are usable in both;
* the parts of services and actions are called ``SetBoolRequest`` (1) or ``SetBool_Request`` (2).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

from rwt_interfaces.definitions.literals import Literals, Value
from rwt_interfaces.definitions.model import (
    PRIMITIVES,
    ActionDefinition,
    Constant,
    Field,
    MessageDefinition,
    ServiceDefinition,
    WrittenType,
)
from rwt_interfaces.distro import JAZZY, Distro
from rwt_interfaces.errors import DefinitionError, InvalidName
from rwt_interfaces.names import Kind, is_word, parse_type_name

#: Maximum characters of a definition.
LONGEST_TEXT: Final = 1024 * 1024

#: Maximum length of a fixed array, which every message of the type contains.
MOST_ELEMENTS: Final = 1024 * 1024

#: Maximum characters of a type or field name.
_LONGEST_WORD: Final = 255

_LONGEST_SEQUENCE: Final = 2**32 - 1

#: Maximum characters of an error text, which may quote the line.
_LONGEST_COMPLAINT: Final = 300

_TYPE = re.compile(
    r"(?P<base>[A-Za-z][A-Za-z0-9_/]*)(?:<=(?P<chars>[0-9]+))?(?P<array>\[(?:<=(?P<bound>[0-9]+)|(?P<length>[0-9]+))?\])?",
    re.ASCII,
)
_AFTER_TYPE = re.compile(r"(?P<name>[^\s=#\"'\[]+)\s*(?P<rest>.*)", re.DOTALL)

#: Spellings of times to translate, keyed by whether the target distribution has time primitives.
_TIMES: dict[bool, dict[str, str]] = {
    True: {"builtin_interfaces/Time": "time", "builtin_interfaces/Duration": "duration"},
    False: {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"},
}


def parse_message(text: str, name: str, *, source: str = "", distro: Distro = JAZZY) -> MessageDefinition:
    """Parse a message definition.

    Args:
        text: the definition, with any line ending.
        name: name of the message, two-part or three-part.
        source: name of the text in errors, usually a path; empty: `name`.
        distro: distribution whose rules apply.

    Raises:
        DefinitionError: invalid text; the error names the line of `source`.
        InvalidName: `name` is not a type name.
    """
    package, _, short = parse_type_name(name)
    source = source or f"{package}/{short}.msg"
    lines = list(enumerate(_lines(text, source), start=1))
    return _MessageParser(package, source, distro).read(short, lines)


def parse_service(text: str, name: str, *, source: str = "", distro: Distro = JAZZY) -> ServiceDefinition:
    """Parse a service: request, a line ``---``, response. See :func:`parse_message`."""
    return ServiceDefinition(*_parse_parts(text, name, ("Request", "Response"), source, "srv", distro))


def parse_action(text: str, name: str, *, source: str = "", distro: Distro = JAZZY) -> ActionDefinition:
    """Parse an action: goal, result and feedback between lines ``---``. See :func:`parse_message`."""
    return ActionDefinition(
        *_parse_parts(text, name, ("Goal", "Result", "Feedback"), source, "action", distro)
    )


def _parse_parts(
    text: str, name: str, parts: tuple[str, ...], source: str, kind: Kind, distro: Distro
) -> Iterator[Any]:
    """Yield the two-part name of a service or action, and the definitions of its parts."""
    package, _, short = parse_type_name(name)
    source = source or f"{package}/{short}.{kind}"
    reader = _MessageParser(package, source, distro)
    yield f"{package}/{short}"
    for part, lines in zip(parts, _sections(text, source, tuple(map(str.lower, parts))), strict=True):
        yield reader.read(f"{short}{distro.part_separator}{part}", lines)


def format_type(field_type: WrittenType) -> str:
    """Return a field type as written in a definition."""
    text = field_type.name
    if field_type.string_bound is not None:
        text += f"<={field_type.string_bound}"
    if field_type.length is not None:
        return f"{text}[{field_type.length}]"
    if field_type.bound is not None:
        return f"{text}[<={field_type.bound}]"
    return f"{text}[]" if field_type.is_array else text


def format_message(definition: MessageDefinition) -> str:
    """Return a definition as text without comments; parsing it gives an equal definition."""
    lines = [f"{format_type(item.type)} {item.name}={item.text}" for item in definition.constants]
    for item in definition.fields:
        default = "" if item.default is None else f" {Literals.format(item.default)}"
        lines.append(f"{format_type(item.type)} {item.name}{default}")
    return "".join(f"{line}\n" for line in lines)


_Lines = list[tuple[int, str]]


def _lines(text: str, source: str) -> list[str]:
    """Split a text with any line ending, without its byte order mark.

    Unlike splitlines(), it keeps form feeds and other separators, which may stand in comments.
    """
    if len(text) > LONGEST_TEXT:
        raise DefinitionError(too_long(source))
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _sections(text: str, source: str, parts: tuple[str, ...]) -> Iterator[_Lines]:
    sections: list[_Lines] = [[]]
    for number, line in enumerate(_lines(text, source), start=1):
        if line.startswith("---"):
            sections.append([])
            if len(sections) > len(parts):
                raise DefinitionError(
                    f'{source}:{number}: one "---" too many; the parts are {", ".join(parts)}'
                )
        else:
            sections[-1].append((number, line))
    if len(sections) < len(parts):
        raise DefinitionError(
            f'{source}: {len(sections) - 1} lines "---"; expected {len(parts) - 1} between {", ".join(parts)}'
        )
    return iter(sections)


class _MessageParser:
    def __init__(self, package: str, source: str, distro: Distro) -> None:
        self.package = package
        self.source = source
        self.distro = distro
        self.translated = False

    def read(self, name: str, lines: _Lines) -> MessageDefinition:
        """Parse the lines of a message, or of a part of a service or action."""
        self.translated = False
        fields: dict[str, Field] = {}
        constants: dict[str, Constant] = {}
        for number, line in lines:
            try:
                item = self._line(line.strip(), f"{self.source}:{number}")
                if item is None:
                    continue
                if item.name in fields or item.name in constants:
                    raise DefinitionError(f'the name "{item.name}" is used twice')
            except DefinitionError as error:
                raise DefinitionError(f"{self.source}:{number}: {_short(str(error))}") from None
            if isinstance(item, Field):
                fields[item.name] = item
            else:
                constants[item.name] = item
        definition = MessageDefinition(
            f"{self.package}/{name}", tuple(fields.values()), tuple(constants.values()), _tidy(lines)
        )
        if not self.translated:
            return definition
        # The text has the other distribution's spelling of times.
        # Viewers that parse the text (API-06) need the fields on the wire.
        return MessageDefinition(
            definition.name, definition.fields, definition.constants, format_message(definition)
        )

    def _line(self, line: str, where: str) -> Field | Constant | None:
        if not line or line.startswith("#"):
            return None
        written, *following = line.split(maxsplit=1)
        field_type = self._type(written)
        match = _AFTER_TYPE.fullmatch(following[0]) if following else None
        if match is None:
            raise DefinitionError(f'expected a name after "{written[:80]}"')
        name, rest = match["name"], match["rest"]
        if not is_word(name) or len(name) > _LONGEST_WORD:
            raise DefinitionError(
                f'"{name[:80]}" cannot be a name: up to {_LONGEST_WORD} letters, digits and _, a letter first'
            )
        if rest.startswith("="):
            return self._constant(field_type, name, rest[1:].strip())
        if not rest or rest.startswith("#"):
            return Field(name, field_type, where=where)
        return Field(name, field_type, self._default(field_type, rest), where)

    def _type(self, written: str) -> WrittenType:
        match = _TYPE.fullmatch(written) if len(written) <= _LONGEST_WORD else None
        if match is None:
            raise DefinitionError(f'"{written[:80]}" is not a type')
        base = self._base(match["base"])
        chars = match["chars"]
        if chars is not None and base not in ("string", "wstring"):
            raise DefinitionError(f'"{written}": only string and wstring can have a longest length')
        return WrittenType(
            base,
            string_bound=None if chars is None else _size(chars, written),
            is_array=match["array"] is not None,
            length=None if match["length"] is None else _size(match["length"], written, MOST_ELEMENTS),
            bound=None if match["bound"] is None else _size(match["bound"], written),
        )

    def _base(self, base: str) -> str:
        if "/" not in base:
            if base == "Header":
                return "std_msgs/Header"
            if base not in PRIMITIVES:
                return f"{self.package}/{base}"
        else:
            try:
                package, kind, name = parse_type_name(base)
            except InvalidName as error:
                raise DefinitionError(str(error)) from None
            if kind not in ("", "msg"):
                raise DefinitionError(f'"{base}": a field holds a message, not the kind "{kind}"')
            base = f"{package}/{name}"
        other = _TIMES[self.distro.has_time_primitives].get(base)
        if other is None:
            return base
        self.translated = True
        return other

    def _constant(self, field_type: WrittenType, name: str, rest: str) -> Constant:
        if field_type.is_array or not field_type.is_primitive or field_type.name in ("time", "duration"):
            raise DefinitionError(
                f'constant "{name}" cannot be of type {format_type(field_type)}: only of plain types'
            )
        if not self.distro.quotes_strings and field_type.name == "string":
            return Constant(name, field_type, rest, rest)
        literals = Literals(rest)
        value = literals.constant(field_type)
        return Constant(name, field_type, value, literals.text)

    def _default(self, field_type: WrittenType, rest: str) -> Value | tuple[Value, ...]:
        if not field_type.is_primitive or field_type.name in ("time", "duration"):
            raise DefinitionError(f"a field of type {format_type(field_type)} cannot have a default value")
        return Literals(rest).default(field_type)


def _size(digits: str, written: str, most: int = _LONGEST_SEQUENCE) -> int:
    size = int(digits) if len(digits) <= 10 else most + 1
    if not 0 < size <= most:
        raise DefinitionError(f'"{written[:80]}": a length is a number from 1 to {most}')
    return size


def too_long(source: str) -> str:
    """Return the error text for a definition that is too long."""
    return f"{source}: a definition has {LONGEST_TEXT} characters at most, and this one has more"


def _short(complaint: str) -> str:
    return complaint if len(complaint) <= _LONGEST_COMPLAINT else f"{complaint[:_LONGEST_COMPLAINT]}…"


def _tidy(lines: _Lines) -> str:
    """Return the lines as text, without surrounding blank lines, ending in a line feed unless empty."""
    text = "\n".join(line.rstrip() for _, line in lines).strip("\n")
    return f"{text}\n" if text else ""
