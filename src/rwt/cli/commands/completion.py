"""`rwt completion`: shell completion of commands, options, and names in the robot's live graph.

argcomplete parses the line and supports the shells; this module provides the values of arguments.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final, NoReturn, cast

from rwt.cli.console.output import standard_output
from rwt.cli.entities import ACTION, NODE, SERVICE, TOPIC, Entity
from rwt.cli.parser import Commands, add_commands, commands_of, leave_out_unavailable
from rwt.cli.verbs import Arguments, connecting

if TYPE_CHECKING:
    from argcomplete.completers import BaseCompleter

SHELLS: Final = ("bash", "zsh", "fish")
LIVE_SECONDS: Final = 1.5
"""Seconds that a completion waits for the robot."""

_EXAMPLES: Final = """\
examples:
  source <(rwt completion bash)                                  in ~/.bashrc
  source <(rwt completion zsh)                                   in ~/.zshrc, after compinit
  rwt completion fish > ~/.config/fish/completions/rwt.fish"""

_NAME: Final = re.compile(r"[A-Za-z0-9_/~{}.-]+")
"""Names that are offered. Others from the server could be interpreted by a shell or terminal."""

_ENTITIES: Final = {entity.noun.upper(): entity for entity in (TOPIC, SERVICE, ACTION, NODE)}
"""Entities whose names are asked of the robot, by the metavar of an argument."""


def add_completion_command(commands: Commands) -> None:
    """Add `completion` to the command line."""
    description = (
        "Print the completion script of a shell, which also completes names of the robot's live graph."
    )
    parser = commands.add_parser("completion", description=description, epilog=_EXAMPLES)
    shells = add_commands(parser, "shells", "SHELL")
    for shell in SHELLS:
        of_shell = shells.add_parser(shell, help=f"for {shell}", description=f"The script for {shell}.")
        of_shell.set_defaults(run=_print_script, shell=shell)


def _print_script(arguments: Arguments) -> int:
    from argcomplete.shell_integration import shellcode

    standard_output(json=False).text(shellcode(["rwt"], shell=arguments.shell))
    return 0


def complete() -> NoReturn:
    """Answer a shell, which runs `rwt` with the current line in its environment, and exit."""
    import argcomplete  # slow import that only completion needs

    from rwt.cli import parser_for

    typed = os.environ.get("COMP_LINE", "").split()[1:]
    command = next((word for word in typed if not word.startswith("-")), None)
    parser = parser_for(command)
    leave_out_unavailable(parser)
    for group in commands_of(parser).values():
        leave_out_unavailable(group)
    argcomplete.autocomplete(
        parser, always_complete_options=False, default_completer=cast("BaseCompleter", _values)
    )
    raise SystemExit  # only if no shell has asked


def _values(action: argparse.Action, parsed_args: argparse.Namespace, **_: object) -> Iterable[str]:
    metavar = action.metavar if isinstance(action.metavar, str) else ""
    if metavar in _ENTITIES:
        return _live(_ENTITIES[metavar], parsed_args)
    if metavar.split(" ")[0] != "TYPE":
        return ()
    from rwt.cli.type_lookup import known_names
    from rwt_interfaces.distro import JAZZY
    from rwt_interfaces.registry import Registry

    return known_names(Registry(JAZZY))


def _live(entity: Entity, given: argparse.Namespace) -> list[str]:
    """Return names of the robot's live graph; none if it does not answer in time: an error would appear
    in the middle of the command line."""
    import anyio

    from rwt.cli.errors import CommandError
    from rwt_client import ClientError

    found: list[str] = []
    options = {name: getattr(given, name, None) for name in ("url", "token", "cafile", "insecure")}
    arguments = Arguments(**options, timeout=LIVE_SECONDS)

    async def ask() -> None:
        with anyio.move_on_after(LIVE_SECONDS):
            async with connecting(arguments) as robot:
                found.extend(filter(_NAME.fullmatch, await entity.names(robot)))

    try:
        anyio.run(ask)
    except (ClientError, CommandError):
        return []
    return found
