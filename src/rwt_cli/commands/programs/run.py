"""`rwt run`: run a ROS 2 program without ROS, in a graph that browsers and other clients can reach."""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from rwt_cli.errors import CommandError
from rwt_cli.parser import Commands
from rwt_cli.verbs import Arguments

if TYPE_CHECKING:
    from rwt_interfaces.registry import Registry

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
    parser.add_argument(
        "--interfaces",
        action="append",
        default=[],
        metavar="DIR",
        help="folder with .msg, .srv and .action files; may be given several times",
    )
    parser.add_argument(
        "--serve", metavar="URL", help="serve the program's graph to rosbridge clients at ws://HOST:PORT"
    )
    parser.add_argument(
        "--graph",
        metavar="WHERE",
        help="the graph to join: memory (default), ws://HOST:PORT or unix:///PATH of a server, zenoh, or"
        " zenoh:ENDPOINT; without it what RWT_RCLPY_GRAPH says",
    )
    parser.add_argument("--root", type=Path, metavar="DIR", help="where packages are looked for (default .)")
    parser.add_argument(
        "program",
        nargs=argparse.REMAINDER,
        metavar="FILE | PACKAGE EXECUTABLE",
        help="what to run, with its arguments",
    )
    parser.set_defaults(run=_run)


def _run(arguments: Arguments) -> int:
    import rwt_rclpy
    from rwt_program.errors import RobotError
    from rwt_rclpy.running import interface_folders, run_program, use_root

    if not arguments.program:
        raise CommandError(
            "what to run is missing: a Python file, or a package and an executable", exit_code=2
        )
    try:
        if rwt_rclpy.install(interface_folders(arguments.interfaces)) == "ros":
            if arguments.serve:
                raise CommandError(
                    "ROS is installed, and its own rclpy would run, which --serve does not show"
                )
            print("ROS is installed, and its own rclpy runs", file=sys.stderr)
        with ExitStack() as stack:
            if arguments.serve and arguments.graph:
                raise CommandError(
                    "--serve serves a graph of this process, and --graph joins another: give one of them",
                    exit_code=2,
                )
            if arguments.serve:
                _serve(arguments.serve, stack)
            else:
                stack.enter_context(rwt_rclpy.join(arguments.graph))
            if arguments.root is not None:
                use_root(arguments.root)
            run_program(arguments.program)
    except RobotError as error:
        raise CommandError(str(error)) from error
    return 0


def _serve(url: str, stack: ExitStack) -> None:
    """Serve one graph to clients, and let the program's nodes join it."""
    import rwt_rclpy
    from rwt.server import Server, listening
    from rwt_cli.commands.serve import command_errors
    from rwt_graph.memory.graph import MemoryGraph
    from rwt_rclpy.messages.loaded import classes

    registry: Registry = classes().registry
    graph = MemoryGraph(registry)
    with command_errors():
        server = Server(url, graph=graph)
        stack.enter_context(server)
    rwt_rclpy.use_graph(graph)
    stack.callback(rwt_rclpy.use_graph, None)
    print(listening(server), file=sys.stderr)
