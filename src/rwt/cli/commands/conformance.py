"""`rwt conformance`: grade any rosbridge server or client with the suite of `rosbridge-conformance`."""

from __future__ import annotations

import argparse

from rwt.cli.errors import CommandError


def add_conformance_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `conformance` to the command line; all its arguments are the suite's own."""
    parser = commands.add_parser(
        "conformance",
        add_help=False,
        prefix_chars="\0",  # The suite parses all options itself.
    )
    parser.add_argument("arguments", nargs=argparse.REMAINDER)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    try:
        # A separate distribution, with hundreds of cases and a WebSocket client.
        from rosbridge_conformance.command import main
    except ImportError as error:
        raise CommandError(
            "the conformance suite is a distribution of its own, rosbridge-conformance: install the folder"
            " conformance of a clone of the project"
        ) from error
    return main(arguments.arguments, prog="rwt conformance")
