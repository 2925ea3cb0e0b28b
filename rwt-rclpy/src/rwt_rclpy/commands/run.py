"""`rwt run`: run a ROS 2 program without ROS, in a graph that browsers and other clients can reach."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import ExitStack

from rwt.cli.errors import CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments
from rwt_rclpy.commands.joined_graph import add_graph_options, install_rclpy, serve_graph

_EXAMPLES = """\
examples:
  rwt run talker.py                                a file, as `python talker.py` on a machine with ROS
  rwt run talker.py --ros-args -r chatter:=/talk   with the arguments of ROS
  rwt run demo_nodes_py talker                     an executable of a package's source, as `ros2 run`
  rwt run --serve ws://127.0.0.1:9090 talker.py    and let browsers and roslibjs see it
  rwt run --graph ws://127.0.0.1:9090 talker.py    as a node of a server that runs already
"""


def add_run_command(commands: Commands) -> None:
    """Add `run` to the command line."""
    parser = commands.add_parser(
        "run", description=__doc__, epilog=_EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_graph_options(parser)
    parser.add_argument(
        "--distro",
        choices=("jazzy", "kilted"),
        help="release of ROS 2 whose rclpy is followed (default jazzy)",
    )
    parser.add_argument(
        "--check-fields",
        action=argparse.BooleanOptionalAction,
        help="check values when they are assigned to fields of messages, which ROS does not do by default"
        " (default: ROS_PYTHON_CHECK_FIELDS, or no)",
    )
    parser.add_argument(
        "program",
        nargs=argparse.REMAINDER,
        metavar="FILE | PACKAGE EXECUTABLE",
        help="what to run, with its arguments",
    )
    parser.set_defaults(run=_run)


def _run(arguments: Arguments) -> int:
    if arguments.distro:  # Read when rclpy is imported, here and in processes that are started.
        os.environ["ROS_DISTRO"] = arguments.distro
    if arguments.check_fields is not None:
        os.environ["ROS_PYTHON_CHECK_FIELDS"] = str(int(arguments.check_fields))
    import rwt_rclpy
    from rwt_participant.errors import RobotError
    from rwt_rclpy.running import run_program

    if not arguments.program:
        raise CommandError(
            "what to run is missing: a Python file, or a package and an executable", exit_code=2
        )
    try:
        if install_rclpy(arguments) == "ros":
            if arguments.serve:
                raise CommandError(
                    "ROS is installed, and its own rclpy would run, which --serve does not show"
                )
            print("ROS is installed, and its own rclpy runs", file=sys.stderr)
        with ExitStack() as stack:
            if arguments.serve:
                rwt_rclpy.use_graph(serve_graph(arguments, stack))
                stack.callback(rwt_rclpy.use_graph, None)
            else:
                stack.enter_context(rwt_rclpy.join(arguments.graph))
            run_program(arguments.program)
    except RobotError as error:
        raise CommandError(str(error)) from error
    return 0
