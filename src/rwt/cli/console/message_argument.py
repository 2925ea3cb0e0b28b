"""Messages on the command line: YAML or JSON, optionally preceded by the type."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt_interfaces.errors import InvalidName
from rwt_interfaces.names import parse_type_name
from rwt_interfaces.structs import MessageType

if TYPE_CHECKING:
    from rwt.cli.console.yaml_text import YamlValue

AUTO: Final = "auto"
"""Value of a header that gets the current time."""
STDIN: Final = "-"


def read_value(text: str, what: str) -> YamlValue:
    """Parse a value.

    Args:
        what: name of the value, for error messages.

    Raises:
        CommandError: the text is invalid; names the position.
    """
    from rwt.cli.console.yaml_text import YamlError, read_yaml  # slow import that `--help` does not need

    try:
        return read_yaml(text)
    except YamlError as error:
        raise CommandError(f"{what}: {error}", CALLED_WRONGLY) from error


def read_message(text: str) -> dict[str, YamlValue]:
    """Parse a message: `{linear: {x: 0.2}}`, `data: hello`, or JSON; ``-`` reads standard input.

    Raises:
        CommandError: the text is invalid, or not a message.
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


def add_message_argument(parser: argparse.ArgumentParser, owner: str, noun: str) -> None:
    """Add the argument `TYPE MESSAGE`, for example of a service and its request."""
    parser.add_argument(
        noun,
        metavar=f"TYPE {noun.upper()}",
        nargs="*",
        help=f"{owner} type and {noun} (YAML or JSON; `-` reads standard input). Missing fields get defaults;"
        f" `header: auto` sets the current time. Omit the type if the {owner} exists",
    )


def type_and_message(words: Sequence[str], noun: str) -> tuple[str | None, dict[str, YamlValue]]:
    """Parse `TYPE MESSAGE`, either of which may be missing: a single word is recognised as one or the other.

    Raises:
        CommandError: the message is invalid.
    """
    if len(words) > 2:
        raise CommandError(f"expected TYPE and {noun.upper()}: put the {noun} in quotes", CALLED_WRONGLY)
    if len(words) > 1:
        return words[0], read_message(words[1])
    if not words:
        return None, {}
    return (words[0], {}) if is_type_name(words[0]) else (None, read_message(words[0]))


def is_type_name(text: str) -> bool:
    """True if `text` may be the name of a type."""
    try:
        parse_type_name(text)
    except InvalidName:
        return False
    return True


def with_stamps(message_type: MessageType, message: YamlValue) -> object:
    """Return `message` without headers of value ``auto``, which the sender then stamps (PUB-05)."""
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
