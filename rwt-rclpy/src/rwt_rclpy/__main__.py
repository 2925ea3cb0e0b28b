"""`python -m rwt_rclpy FILE …`: run a ROS 2 program without ROS."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import rwt_rclpy
from rwt_participant.errors import RobotError
from rwt_rclpy.commands.options import add_program_options
from rwt_rclpy.running import interface_folders, run_module, run_program

_EXAMPLE = """\
example:
  python -m rwt_rclpy talker.py --ros-args -r chatter:=/talk -p rate:=2.0
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the command line, and run the program."""
    parser = argparse.ArgumentParser(
        "python -m rwt_rclpy",
        description="Run a program that was written for ROS 2's rclpy, on a machine without ROS.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_program_options(parser)
    parser.add_argument("-m", dest="module", metavar="NAME", help="run a module instead of a file")
    parser.add_argument(
        "program",
        nargs=argparse.REMAINDER,
        metavar="FILE | PACKAGE EXECUTABLE",
        help="a file, or a package's executable, and its arguments",
    )
    given = parser.parse_args(arguments)
    if not given.module and not given.program:
        parser.error("a file is missing")
    try:
        if rwt_rclpy.install(interface_folders(given.interfaces)) == "ros":
            print("rwt_rclpy: ROS is installed, and its own rclpy runs", file=sys.stderr)
        with rwt_rclpy.join(given.graph):
            if given.module:
                run_module(given.module, given.program)
            else:
                run_program(given.program)
    except RobotError as error:
        print(f"rwt_rclpy: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
