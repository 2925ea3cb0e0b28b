"""`rwt help`: the help of a command, as its `--help` prints it."""

from __future__ import annotations

import argparse

from rwt.cli.parser import Commands


def add_help_command(commands: Commands) -> None:
    """Add `help` to the command line."""
    parser = commands.add_parser("help", description=__doc__)
    parser.add_argument("words", metavar="COMMAND", nargs="*", help="for example `topic echo`")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from rwt.cli import parser_for

    words: list[str] = arguments.words
    parser_for(words[0] if words else None).parse_args([*words, "--help"])
    return 0
