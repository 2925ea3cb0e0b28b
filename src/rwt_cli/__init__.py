"""The command `rwt`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from rwt_cli.config import add_config_command
from rwt_cli.conformance import add_conformance_command
from rwt_cli.errors import CommandError
from rwt_cli.hub import add_hub_command
from rwt_cli.play import add_play_command
from rwt_cli.record import add_record_command
from rwt_cli.recording import add_recording_command
from rwt_cli.serve import add_serve_command

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 1 it failed, 2 it was called wrongly."""
    parser = argparse.ArgumentParser(
        prog="rwt", description="Robot Web Tools without ROS: rosbridge v2 for any robot."
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    add_serve_command(commands)
    add_hub_command(commands)
    add_record_command(commands)
    add_play_command(commands)
    add_recording_command(commands)
    add_conformance_command(commands)
    add_config_command(commands)
    arguments = parser.parse_args(argv)
    try:
        return int(arguments.run(arguments))
    except CommandError as error:
        print(f"rwt: {error}", file=sys.stderr)
        return error.exit_code
