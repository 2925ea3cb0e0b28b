"""Command line `rwt`: a table of commands, each in a module that is imported only when it is used.

This way `rwt --help` and completion import no client, server or message type.

Other distributions add commands by entry points in the group `rwt.commands`. The name is the command, and the
value a function that adds its parser. Help shows the summary of the distribution beside the name, because an
entry point has no text of its own and is not imported before the command line names it.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final, TextIO

from rwt.cli.console.output import OutputClosed, OutputFailed, failure_line
from rwt.cli.errors import CALLED_WRONGLY, INTERRUPTED, PIPE_CLOSED, CommandError
from rwt.cli.parser import (
    Commands,
    Parser,
    ShowVersion,
    add_commands,
    add_unavailable,
    commands_of,
    leave_out_unavailable,
)
from rwt.parts import COMMANDS as PART_COMMANDS
from rwt_protocol.extensions import ExtensionError, extension_names, load_extension

__all__ = ["COMMANDS", "Command", "main", "parser_for"]


@dataclass(frozen=True, slots=True)
class Command:
    """One command.

    Attributes:
        reference: module and name of the function that adds the parser, as ``module:function``; by default
            ``add_NAME_command`` of ``rwt.cli.commands.NAME``. Empty for an entry point.
        distribution: distribution that has the entry point; empty for a command of `rwt` itself.
    """

    name: str
    help: str
    reference: str = ""
    distribution: str = ""

    def add_to(self, commands: Commands) -> None:
        """Import the command and add its parser; one that cannot be imported is added as unavailable."""
        if not self.distribution:
            reference = self.reference or f"rwt.cli.commands.{self.name}:add_{self.name}_command"
            module, _, function = reference.partition(":")
            getattr(importlib.import_module(module), function)(commands)
        elif self.name not in extension_names(_GROUP):
            why = f"it needs {self.distribution}: pip install {self.distribution}"
            add_unavailable(commands, self.name, why)
        else:
            try:
                add = load_extension(_GROUP, self.name, ())
            except ExtensionError as error:
                add_unavailable(commands, self.name, str(error))
            else:
                add(commands)


_GROUP: Final = "rwt.commands"


#: The commands of this project, in the order in which help lists them: those for a robot's graph before those
#: of parts, which do one thing each.
COMMANDS: Final = (
    Command("serve", "serve a robot to rosbridge clients"),
    Command("topic", "topics: list, echo, pub, hz and more"),
    Command("service", "services: list, info, type, call, echo, find"),
    Command("action", "actions: list, info, type, find, send_goal"),
    Command("param", "parameters: list, get, set, describe, delete, dump, load"),
    Command("node", "nodes: list, info"),
    Command("tf", "frames: echo, tree"),
    Command("top", "watch topics with their rates, nodes and clients"),
    Command("teleop", "drive with the arrow keys"),
    Command(
        "interface", "messages, services and actions: list, show, generate types for Python and TypeScript"
    ),
    Command("stop", "press or release a robot's emergency stop", "rwt.cli.commands.gate:add_stop_command"),
    Command("approve", "list or answer requests for approval", "rwt.cli.commands.gate:add_approve_command"),
    Command(
        "gate",
        "roles and gate rules of a server: explain, check",
        "rwt.cli.commands.gate.check:add_gate_command",
    ),
    Command(
        "audit",
        "read and verify the audit log of a robot's gate: show, verify",
        "rwt.cli.commands.gate.audit:add_audit_command",
    ),
    Command("doctor", "diagnose a connection"),
    Command("conformance", "grade a rosbridge server or client, this one or any other"),
    *(Command(name, *row) for name, row in PART_COMMANDS.items()),
    Command("config", "print the settings in effect"),
    Command("completion", "set up shell completion"),
    Command("help", "print the help of a command"),
)

_NAMES: Final = frozenset(command.name for command in COMMANDS)

_EXAMPLES: Final = """\
examples:
  rwt serve --demo                                  a simulated robot on ws://127.0.0.1:9090
  rwt topic list                                    its topics
  RWT_URL=ws://robot:9090 rwt topic echo /odom      another robot

exit codes: 0 success, 1 failure, 2 incorrect use, 3 no connection, 4 timeout, 130 interrupted by Ctrl-C"""


def _installed_commands() -> Iterator[Command]:
    """Yield the commands of other distributions, without importing them."""
    from importlib.metadata import entry_points  # takes a while, and the commands of `rwt` need none of it

    for entry_point in sorted(entry_points(group=_GROUP), key=lambda each: each.name):
        if entry_point.name not in _NAMES and entry_point.dist is not None:
            distribution = entry_point.dist
            summary = str(distribution.metadata.json.get("summary", "")).replace("%", "%%")
            yield Command(
                entry_point.name, f"{summary} ({distribution.name})", distribution=distribution.name
            )


def parser_for(wanted: str | None) -> Parser:
    """Return the parser of the command line: the command `wanted` in full, of the others only the names.

    Args:
        wanted: name of a command; None for none of them, ``*`` for all of `rwt` itself.
    """
    parser = Parser(
        prog="rwt", description="Robot Web Tools without ROS: rosbridge v2 for any robot.", epilog=_EXAMPLES
    )
    parser.add_argument("--version", action=ShowVersion, help="print the version and exit")
    commands = add_commands(parser)
    for command in COMMANDS if wanted in _NAMES else (*COMMANDS, *_installed_commands()):
        if wanted == command.name or (wanted == "*" and not command.distribution):
            command.add_to(commands)
        else:
            commands.add_parser(command.name, help=command.help, add_help=False)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line, and return its exit code (see :mod:`rwt.cli.errors`)."""
    if "_ARGCOMPLETE" in os.environ:
        from rwt.cli.commands.completion import complete

        complete()
    words = sys.argv[1:] if argv is None else list(argv)
    try:
        command = next((word for word in words if not word.startswith("-")), None)
        if command is not None and command not in _NAMES and command not in extension_names(_GROUP):
            _point_to_groups(command)
        arguments = parser_for(command).parse_args(words)
        with _log_of_the_command():
            return int(arguments.run(arguments))
    except CommandError as error:
        print(failure_line(error), file=sys.stderr)
        if isinstance(error, OutputFailed):
            _discard(sys.stdout)
        return error.exit_code
    except KeyboardInterrupt:
        return INTERRUPTED
    except (OutputClosed, BrokenPipeError):
        _discard(sys.stdout)
        return PIPE_CLOSED


def _point_to_groups(word: str) -> None:
    """Raise CommandError for an unknown command that is a verb of another command."""
    groups = commands_of(parser_for("*"))
    for group in groups.values():
        leave_out_unavailable(group)
    owners = [f"`rwt {name} {word}`" for name, group in groups.items() if word in commands_of(group)]
    if owners:
        raise CommandError(f"unknown command {word!r}; did you mean {' or '.join(owners)}?", CALLED_WRONGLY)


@contextmanager
def _log_of_the_command() -> Iterator[None]:
    """Remove the log handlers of a command when it ends: this process may replace its stderr afterwards."""
    import logging  # `--help` does not need it

    root = logging.getLogger()
    handlers, level = [*root.handlers], root.level
    try:
        yield
    finally:
        for handler in {*root.handlers}.difference(handlers):
            root.removeHandler(handler)
        root.setLevel(level)
        try:
            sys.stderr.flush()
        except OSError:  # A full disk: Python would fail to flush at exit, too, and exit with 120.
            _discard(sys.stderr)


def _discard(stream: TextIO) -> None:
    """Point a standard stream at the null device: its buffer cannot be written, and would raise at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
