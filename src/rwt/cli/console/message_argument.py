"""Messages as they are typed on a command line: YAML or JSON, with or without the type before them."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Final

from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt_interfaces.errors import InvalidName
from rwt_interfaces.names import parse_type_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rwt.cli.console.yaml_text import YamlValue
    from rwt_interfaces.structs import MessageType

AUTO: Final = "auto"
"""What stands for a header that is stamped with the time."""
STDIN: Final = "-"


def read_value(text: str, what: str) -> YamlValue:
    """A value as it was typed.

    Args:
        what: what it is, for the error.

    Raises:
        CommandError: it cannot be read; says where.
    """
    from rwt.cli.console.yaml_text import YamlError, read_yaml  # takes a while, and `--help` needs none of it

    try:
        return read_yaml(text)
    except YamlError as error:
        raise CommandError(f"{what}: {error}", CALLED_WRONGLY) from error


def read_message(text: str) -> dict[str, YamlValue]:
    """A message as it was typed: `{linear: {x: 0.2}}`, `data: hello`, or JSON; ``-`` reads standard input.

    Raises:
        CommandError: it cannot be read, or is no message.
    """
    value = read_value(sys.stdin.read() if text == STDIN else text, "the message")
    if value is None:
        return {}
    if isinstance(value, dict):
        return value
    example = text if len(text) < 20 else "…"
    raise CommandError(
        f"the message: expected fields, as in '{{data: {example}}}', got {text[:60]!r}", CALLED_WRONGLY
    )


def type_and_message(words: Sequence[str]) -> tuple[str | None, dict[str, YamlValue]]:
    """`TYPE MESSAGE`, either of which may be missing: a single word is recognised as one or the other.

    Raises:
        CommandError: the message cannot be read.
    """
    if len(words) > 1:
        return words[0], read_message(words[1])
    if not words:
        return None, {}
    return (words[0], {}) if is_type_name(words[0]) else (None, read_message(words[0]))


def is_type_name(text: str) -> bool:
    """Whether `text` may be the name of a type."""
    try:
        parse_type_name(text)
    except InvalidName:
        return False
    return True


def with_stamps(message_type: MessageType, message: YamlValue) -> object:
    """`message` with each header that says ``auto`` left out: the sender stamps it (PUB-05)."""
    if not isinstance(message, dict):
        return message
    nested = {field.name: field.type for field in message_type.definition.fields}
    found: dict[str, object] = {}
    for name, value in message.items():
        field = nested.get(name)
        if field is None or field.is_primitive or field.is_array:
            found[name] = value
        elif value == AUTO and field.name == "std_msgs/Header":
            found[name] = {}
        else:
            found[name] = with_stamps(message_type.registry.message(field.name), value)
    return found
