"""`rwt master`: ROS 1 master, parameter server and log collector, in place of `roscore`."""

from __future__ import annotations

import argparse

import anyio

from rwt.cli.console.logs import add_log_options, log_to_stderr
from rwt.cli.errors import CommandError
from rwt.extensions.ros1 import Ros1Graph
from rwt.signals import STOP_SIGNALS, on_signals
from rwt_graph.errors import Ros1Error

_EXAMPLES = """\
examples:
  rwt master                                       for the programs of this machine
  rwt master 0.0.0.0:11311                         for a network
  rwt serve --graph ros1-master://0.0.0.0:11311    with a rosbridge server in the same process

ROS 1 has no access control: every host that reaches the port can command every node."""


def add_master_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `master` to the command line."""
    parser = commands.add_parser("master", description=__doc__, epilog=_EXAMPLES)
    parser.add_argument(
        "address",
        nargs="?",
        default="127.0.0.1:11311",
        metavar="HOST:PORT",
        help="where to listen (default 127.0.0.1:11311)",
    )
    add_log_options(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    log_to_stderr(arguments.log_format, verbose=arguments.verbose)
    try:
        anyio.run(_serve, arguments.address)
    except Ros1Error as error:
        raise CommandError(str(error)) from error
    return 0


async def _serve(address: str) -> None:
    stop = anyio.Event()
    async with Ros1Graph(master=f"ros1-master://{address}") as graph:
        with on_signals(dict.fromkeys(STOP_SIGNALS, stop.set)):
            print(f"listening on {graph.master}", flush=True)
            await stop.wait()
