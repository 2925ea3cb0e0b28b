"""`rwt conformance`: grade any rosbridge server or client with the suite in `conformance/`."""

from __future__ import annotations

import argparse


def add_conformance_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `conformance` to the command line; all its arguments are the suite's own."""
    parser = commands.add_parser(
        "conformance",
        add_help=False,
        prefix_chars="\0",  # Nothing is an option here: the suite reads them.
    )
    parser.add_argument("arguments", nargs=argparse.REMAINDER)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from conformance.command import (
        main,
    )  # Hundreds of cases and a WebSocket client, read only where they run.

    return main(arguments.arguments)
