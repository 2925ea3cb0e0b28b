"""Argument parser of all commands: errors are one line, and name the nearest known word."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from typing import Any, Final, NoReturn, TypeAlias

from rwt.cli.console.output import printable
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt_participant.spelling import did_you_mean

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""Commands of a parser, to which further ones are added."""

_INVALID_CHOICE: Final = re.compile(r"(?:argument (.*?): )?invalid choice: '(.*)' \(choose from (.*)\)", re.S)


class Parser(argparse.ArgumentParser):
    """Parser that keeps the line breaks of descriptions, and whose errors are one line.

    Attributes:
        unavailable: reason why the command is not available; empty if it is.
        passes: prefix of options that the command passes on to another program, as ``arguments.passed``.
    """

    unavailable = ""
    passes = ""

    def __init__(self, **keywords: Any) -> None:
        keywords.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        # An abbreviation such as `--time` could become ambiguous with a later option.
        super().__init__(allow_abbrev=False, **keywords)

    def parse_known_args(  # type: ignore[override]  # one signature for the overloads of typeshed
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse the words of one command, and reject unknown ones here, where the options are known; argparse
        leaves them to the outermost parser.

        Raises:
            CommandError: the command is not available.
        """
        if self.unavailable:
            raise CommandError(f"`{self.prog}` is not available: {self.unavailable}", CALLED_WRONGLY)
        found, left = super().parse_known_args(args, namespace)
        if self.passes:
            found.passed = [word for word in left if word.startswith(self.passes)]
            left = [word for word in left if not word.startswith(self.passes)]
        if left:
            self.error(self._unknown(left[0]))
        return found, left

    def _unknown(self, word: str) -> str:
        option, _, _ = word.partition("=")
        if not option.startswith("-"):
            return f"unexpected argument {word!r}"
        return f"unknown option {option!r}{did_you_mean(option, self._option_string_actions)}"

    def error(self, message: str) -> NoReturn:
        """Exit with one line on stderr and the exit code for incorrect use."""
        said = _on_one_line(_with_nearest(message))
        sys.stderr.write(f"{self.prog}: {said} (see `{self.prog} --help`)\n")
        raise SystemExit(CALLED_WRONGLY)


def add_commands(
    parser: argparse.ArgumentParser, title: str = "commands", metavar: str = "COMMAND"
) -> Commands:
    """Return the object to which the commands of `parser` are added. Without a command it prints its help and
    exits with 0, as the ``ros2`` tool does."""

    def print_help(_: argparse.Namespace) -> int:
        parser.print_help()
        return 0

    parser.set_defaults(run=print_help)
    return parser.add_subparsers(title=title, metavar=metavar)


def add_unavailable(commands: Commands, name: str, why: str) -> None:
    """Add a command that is not available: it fails with the reason, whatever follows it.

    Args:
        name: name of the command, or of a verb of the ``ros2`` tool.
        why: reason, and what to use instead.
    """
    parser = commands.add_parser(name, add_help=False)
    assert isinstance(parser, Parser)  # Parsers of commands have the class of the outermost.
    parser.unavailable = why


def actions_of(parser: argparse.ArgumentParser) -> Sequence[argparse.Action]:
    """Return the arguments and options of `parser`, for which argparse has no public name."""
    return tuple(parser._actions)


def commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the commands of `parser` by name, as the mapping that the parser itself uses."""
    for action in actions_of(parser):
        if isinstance(action, argparse._SubParsersAction):
            found: dict[str, argparse.ArgumentParser] = action.choices
            return found
    return {}


def leave_out_unavailable(group: argparse.ArgumentParser) -> None:
    """Remove the commands of a group that are not available."""
    verbs = commands_of(group)
    for name in [name for name, verb in verbs.items() if isinstance(verb, Parser) and verb.unavailable]:
        del verbs[name]


class ShowVersion(argparse.Action):
    """Option that prints the version and exits. The version is looked up only then."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, default=argparse.SUPPRESS, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print the version."""
        from rwt.observability.build import version_line

        sys.stdout.write(f"rwt {version_line()}\n")
        parser.exit()


_MAX_ERROR_CHARS: Final = 400


def _on_one_line(message: str) -> str:
    """Return a message with user input as one short line without control characters."""
    if len(message) > _MAX_ERROR_CHARS:
        message = f"{message[: _MAX_ERROR_CHARS // 2]}…{message[-_MAX_ERROR_CHARS // 2 :]}"
    return printable(" ".join(message.splitlines()))


def _with_nearest(message: str) -> str:
    """Return argparse's message with the nearest word instead of all choices."""
    found = _INVALID_CHOICE.fullmatch(message)
    if found is None:
        return message
    where, word, listed = found.groups()
    known = [each.strip(" '\"") for each in listed.split(",")]
    what = "command" if where in (None, "COMMAND") else f"value for {where}"
    meant = did_you_mean(word, known) or f": expected {', '.join(known)}"
    return f"unknown {what} {word!r}{meant}"
