"""Options of `rwt run` and `rwt launch` for interfaces, packages and the graph that nodes join."""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from rwt.cli.errors import CommandError
from rwt.cli.verbs import Arguments
from rwt_rclpy.commands.options import add_program_options

if TYPE_CHECKING:
    from rwt_graph import MemoryGraph
    from rwt_rclpy import Which


def add_graph_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of both commands."""
    add_program_options(parser)
    parser.add_argument(
        "--serve",
        action="append",
        default=[],
        metavar="URL",
        help="serve the nodes' graph to rosbridge clients at ws://HOST:PORT; may be given several times",
    )
    parser.add_argument("--root", type=Path, metavar="DIR", help="where packages are looked for (default .)")


def install_rclpy(arguments: Arguments) -> Which:
    """Install rclpy according to the options.

    Returns:
        Name of the rclpy in use; see :func:`rwt_rclpy.install`.

    Raises:
        CommandError: the options name two graphs.
        DefinitionError: a folder of interfaces cannot be read.
    """
    import rwt_rclpy
    from rwt_rclpy.running import interface_folders, use_root

    if arguments.serve and arguments.graph:
        raise CommandError(
            "--serve serves a graph of this command, and --graph joins another: give one of them", exit_code=2
        )
    if arguments.root is not None:
        use_root(arguments.root)
    return rwt_rclpy.install(interface_folders(arguments.interfaces))


def serve_graph(arguments: Arguments, stack: ExitStack, *urls: str) -> MemoryGraph:
    """Serve a graph until the stack is closed, at the URLs of `--serve`, which are printed, and at others."""
    from rwt.cli.commands.serve import command_errors
    from rwt.server import Server, listening
    from rwt_graph import MemoryGraph
    from rwt_rclpy.messages.loaded import classes

    graph = MemoryGraph(classes().registry, dds_rules=True)
    with command_errors():
        server = Server(*urls, *arguments.serve, graph=graph)
        stack.enter_context(server)
    if arguments.serve:
        print(listening(server), file=sys.stderr)
    return graph
