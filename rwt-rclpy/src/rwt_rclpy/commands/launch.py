"""`rwt launch`: start the nodes of a ROS 2 launch file in Python, without ROS, in one graph."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from rwt.cli.errors import CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments
from rwt_rclpy.commands.joined_graph import add_graph_options, install_rclpy, serve_graph

if TYPE_CHECKING:
    from rwt_rclpy.launch.entities import LaunchDescription

_EXAMPLES = """\
examples:
  rwt launch bringup.launch.py                            a file
  rwt launch my_robot bringup.launch.py speed:=0.5        a file of a package's source, with an argument
  rwt launch --show-args bringup.launch.py                which arguments it takes
  rwt launch --serve ws://127.0.0.1:9090 bringup.launch.py    and let browsers and roslibjs see the nodes
"""


def add_launch_command(commands: Commands) -> None:
    """Add `launch` to the command line."""
    parser = commands.add_parser(
        "launch", description=__doc__, epilog=_EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_graph_options(parser)
    parser.add_argument("-s", "--show-args", action="store_true", help="say which arguments it takes")
    parser.add_argument(
        "-n",
        "--noninteractive",
        action="store_true",
        default=not sys.stdin.isatty(),
        help="pass Ctrl-C on to the nodes, which a terminal does by itself (default: without a terminal)",
    )
    parser.add_argument(
        "program",
        nargs="+",
        metavar="FILE | PACKAGE FILE",
        help="the launch file, and its arguments as NAME:=VALUE",
    )
    parser.set_defaults(run=_run)


def _run(arguments: Arguments) -> int:
    from rwt_participant.errors import RobotError

    words = [each for each in arguments.program if ":=" not in each]
    given = dict(each.split(":=", 1) for each in arguments.program if ":=" in each)
    if not 1 <= len(words) <= 2 or "" in given:
        raise CommandError(
            "expected a launch file, or a package and a file, and arguments as NAME:=VALUE; got"
            f" {' '.join(arguments.program)}",
            exit_code=2,
        )
    try:
        if install_rclpy(arguments) == "ros":
            raise CommandError("ROS is installed: use ros2 launch")
        from rwt_rclpy.launch.sources import description_of_file, find_launch_file

        description = description_of_file(find_launch_file(*words))
        if arguments.show_args:
            _show(description)
            return 0
        return _launch(description, given, arguments)
    except RobotError as error:
        raise CommandError(str(error)) from error


def _launch(description: LaunchDescription, given: dict[str, str], arguments: Arguments) -> int:
    """Run a launch description. Its nodes are processes, which join one graph."""
    from rwt_rclpy.launch.service import run_description
    from rwt_rclpy.middleware.joining import VARIABLE

    with ExitStack() as stack:
        where = arguments.graph or ("" if arguments.serve else os.environ.get(VARIABLE, ""))
        if where in ("", "memory"):
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="rwt-launch-"))
            where = f"unix://{Path(folder) / 'graph.sock'}"
            serve_graph(arguments, stack, where)
        os.environ[VARIABLE] = where
        return run_description(
            description, given, argv=arguments.program, noninteractive=arguments.noninteractive
        )


def _show(description: LaunchDescription) -> None:
    arguments = description.get_launch_arguments()
    print("Arguments (NAME:=VALUE):" if arguments else "It takes no arguments.")
    for each in arguments:
        default = "required" if each.default_value is None else f"default {each.default_value!r}"
        print(f"  {each.name} ({default})" + (f": {each.description}" if each.description else ""))
