"""The parser of every command: its errors are one line, with the nearest known word."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from typing import Final, NoReturn, TypeAlias

from rwt.cli.console.output import printable
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt_participant.spelling import did_you_mean

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""What commands are added to."""

_INVALID_CHOICE: Final = re.compile(r"(?:argument (.*?): )?invalid choice: '(.*)' \(choose from (.*)\)", re.S)


class Parser(argparse.ArgumentParser):
    """An :class:`argparse.ArgumentParser` that keeps the line ends of texts, and whose errors are one
    line.

    Attributes:
        unavailable: reason why the command is not available; empty if it is.
    """

    unavailable = ""

    def __init__(
        self,
        *,
        prog: str | None = None,
        usage: str | None = None,
        description: str | None = None,
        epilog: str | None = None,
        formatter_class: type[argparse.HelpFormatter] = argparse.RawDescriptionHelpFormatter,
        prefix_chars: str = "-",
        add_help: bool = True,
    ) -> None:
        super().__init__(
            prog=prog,
            usage=usage,
            description=description,
            epilog=epilog,
            formatter_class=formatter_class,
            prefix_chars=prefix_chars,
            add_help=add_help,
            # `--time` for `--timeout` today would be something else tomorrow.
            allow_abbrev=False,
        )

    def parse_known_args(  # type: ignore[override]  # the stubs' overloads come to this
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse the words of one command. Unknown ones are an error of that command, which knows its options;
        argparse leaves them to the outermost parser.

        Raises:
            CommandError: the command cannot be had.
        """
        if self.unavailable:
            raise CommandError(f"`{self.prog}` cannot be had: {self.unavailable}", CALLED_WRONGLY)
        found, left = super().parse_known_args(args, namespace)
        if left:
            self.error(self._unknown(left[0]))
        return found, left

    def _unknown(self, word: str) -> str:
        option, _, _ = word.partition("=")
        if not option.startswith("-"):
            return f"unexpected argument {word!r}"
        return f"unknown option {option!r}{did_you_mean(option, self._option_string_actions)}"

    def error(self, message: str) -> NoReturn:
        """End the program with one line on stderr and the exit code for being called wrongly."""
        said = _on_one_line(_plainly(message))
        sys.stderr.write(f"{self.prog}: {said} (`{self.prog} --help` says more)\n")
        raise SystemExit(CALLED_WRONGLY)


def add_commands(
    parser: argparse.ArgumentParser, title: str = "commands", metavar: str = "COMMAND"
) -> Commands:
    """What the commands of `parser` are added to. Without any of them it prints its help and ends with 0, as
    the ``ros2`` tool does."""

    def print_help(_: argparse.Namespace) -> int:
        parser.print_help()
        return 0

    parser.set_defaults(run=print_help)
    return parser.add_subparsers(title=title, metavar=metavar)


def add_unavailable(commands: Commands, name: str, why: str) -> None:
    """Add a command that is not available: it fails with the reason, whatever follows it.

    Args:
        commands: where to add it.
        name: name of the command, or of a verb of the ``ros2`` tool.
        why: reason, and what to use instead.
    """
    parser = commands.add_parser(name, add_help=False)
    assert isinstance(parser, Parser)  # Parsers of commands have the class of the outermost.
    parser.unavailable = why


def commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The commands that were added to `parser`, by name: the very mapping that it goes by."""
    for action in parser._actions:
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
    """An option that prints the version and ends; the version is looked up when it is asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, default=argparse.SUPPRESS, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print it."""
        from importlib.metadata import version

        sys.stdout.write(f"rwt {version('robot-web-tools')}\n")
        parser.exit()


_LONGEST_SAID: Final = 400


def _on_one_line(message: str) -> str:
    """A message with what was typed in it: short, and nothing that a terminal takes for a command."""
    if len(message) > _LONGEST_SAID:
        message = f"{message[: _LONGEST_SAID // 2]}…{message[-_LONGEST_SAID // 2 :]}"
    return printable(" ".join(message.splitlines()))


def _plainly(message: str) -> str:
    """argparse's message with the nearest word in place of all that there are."""
    found = _INVALID_CHOICE.fullmatch(message)
    if found is None:
        return message
    where, word, listed = found.groups()
    known = [each.strip(" '\"") for each in listed.split(",")]
    what = "command" if where in (None, "COMMAND") else f"value for {where}"
    meant = did_you_mean(word, known) or f": expected {', '.join(known)}"
    return f"unknown {what} {word!r}{meant}"
