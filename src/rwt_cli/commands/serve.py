"""`rwt serve`: a rosbridge server in front of an in-memory robot graph."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import anyio

from rwt.graphs import add_backend_options, backend_options
from rwt.nodes import http_of, start_nodes
from rwt.script import stage
from rwt.server import serve
from rwt.settings.sources import DEFAULT
from rwt_access.settings import SettingsError
from rwt_cli.commands.config import add_settings_options, settings_of
from rwt_cli.console.logs import FORMATS, log_to_stderr
from rwt_cli.errors import CommandError
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.registry import Registry
from rwt_program.errors import RobotError
from rwt_transports.errors import TransportError
from rwt_transports.relay.dial import check_dial_url

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from rwt.server import Server
    from rwt.settings.models import Settings
    from rwt.workers.worker import Seat
    from rwt_graph.api import Graph
    from rwt_nodes.demo import DemoRobot
    from rwt_nodes.mesh_files import MeshFiles

_EXAMPLES = """\
examples:
  rwt serve --demo                         the demo robot on ws://127.0.0.1:9090
  rwt serve ws://0.0.0.0:9090 --distro noetic
  rwt serve ws://127.0.0.1:0               on any free port, which is printed
  rwt serve ws://[::1] tcp://127.0.0.1:9091 on several at once; also wss:, tcps:, unix:, udp:
  rwt serve --dial wss://HUB/robots/NAME   from behind a NAT, through a hub (see rwt hub)
  rwt serve stdio:                         as a child process, on standard input and output
  rwt serve --interfaces my_msgs/          with message types of your own
  rwt serve --packages /opt/ros/jazzy/share with meshes for viewers, under /packages/
  rwt serve --script robot.toml            a robot for tests, which answers what the file says
  rwt serve ws://0.0.0.0:9090 --workers 4  on four cores, as one server
  rwt serve --graph zenoh --zenoh-connect tcp/10.0.0.7:7447
                                           joined with other servers, or with a ROS 2 graph
"""


def add_serve_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `serve` to the command line."""
    parser = commands.add_parser(
        "serve",
        description=__doc__,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "url",
        nargs="*",
        metavar="URL",
        help="where to listen (default ws://127.0.0.1:9090; port 0 picks one)",
    )
    parser.add_argument(
        "--dial",
        action="append",
        metavar="URL",
        help="dial in at a hub, wss://HUB/robots/NAME, and serve the clients it passes on; may be given"
        " several times; without a URL to listen on, nothing else is served",
    )
    _add_robot_options(parser)
    parser.add_argument(
        "--record", type=Path, metavar="FILE", help="write all topics, calls and goals to an MCAP file"
    )
    parser.add_argument(
        "--introspection", action="store_true", help="publish calls and goals on topics, as ROS 2 can"
    )
    parser.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="serve the same ports with N processes, for more clients than one core can serve (default 1)",
    )
    add_backend_options(parser)
    add_settings_options(parser)
    parser.add_argument("--verbose", "-v", action="store_true", help="log what clients do wrong, and more")
    parser.add_argument(
        "--log-format",
        choices=FORMATS,
        default="text",
        help="lines for people, or one JSON object a line (default text)",
    )
    parser.set_defaults(run=_run)


def _add_robot_options(parser: argparse.ArgumentParser) -> None:
    """What there is to serve, and which names and types it has."""
    parser.add_argument("--demo", action="store_true", default=None, help="add a simulated mobile robot")
    parser.add_argument(
        "--script",
        type=Path,
        metavar="FILE",
        help="add a robot that does what a .toml or .py file says, for tests of apps",
    )
    parser.add_argument("--distro", choices=sorted(DISTROS), help="ROS distribution to speak (default jazzy)")
    parser.add_argument(
        "--interfaces",
        action="append",
        type=Path,
        metavar="DIR",
        help="folder with .msg, .srv and .action files; may be given several times",
    )
    parser.add_argument(
        "--packages",
        action="append",
        type=Path,
        metavar="DIR",
        help="folder of ROS packages, whose meshes are served under /packages/; may be given several times",
    )


def _run(arguments: argparse.Namespace) -> int:
    log_to_stderr(arguments.log_format, verbose=arguments.verbose)
    with _told_in_one_line():
        settings = _settings(arguments)
        if settings.workers > 1:
            from rwt.workers.worker import serve_by_workers  # Read only where there are several.

            return serve_by_workers(settings, arguments, partial(_serve_at, arguments))
        anyio.run(_serve, settings, arguments)
    return 0


@contextmanager
def _told_in_one_line() -> Iterator[None]:
    """Turn what can go wrong into a :exc:`CommandError`."""
    try:
        yield
    except (TransportError, RobotError) as error:
        raise CommandError(str(error)) from error
    except SettingsError as error:
        raise CommandError(str(error), exit_code=2) from error


def _serve_at(arguments: argparse.Namespace, settings: Settings, seat: Seat) -> None:
    """Serve as one of several workers."""
    with _told_in_one_line():
        anyio.run(_serve, settings, arguments, seat)


def _settings(arguments: argparse.Namespace) -> Settings:
    """What the file, the environment and the command line say, in that order."""
    given: dict[str, object] = {
        "listen": tuple(arguments.url) or None,
        "demo": arguments.demo,
        "workers": arguments.workers,
        "distro": arguments.distro,
        "interfaces": tuple(arguments.interfaces or ()) or None,
        "packages": tuple(arguments.packages or ()) or None,
        "dial.urls": tuple(arguments.dial or ()) or None,
        **backend_options(arguments),
    }
    loaded = settings_of(arguments, given)
    settings = loaded.settings
    for url in settings.dial.urls:
        check_dial_url(url)
    if settings.dial.urls and loaded.source(("listen",)) == DEFAULT:
        # Who only dials out wants no port.
        return settings.model_copy(update={"listen": ()})
    return settings


def _registry(settings: Settings) -> Registry:
    registry = Registry(DISTROS[settings.distro])
    for folder in settings.interfaces:
        try:
            registry.add_directory(folder)
        except (InterfaceError, OSError) as error:
            raise CommandError(f"--interfaces {folder}: {error}", exit_code=2) from error
    try:
        registry.verify()
    except InterfaceError as error:
        raise CommandError(f"--interfaces: {error}", exit_code=2) from error
    return registry


def _mesh_files(settings: Settings) -> MeshFiles:
    """The files of the packages that are to be served."""
    from rwt_nodes.mesh_files import MeshFiles, MeshFilesError  # Its code is read only where it runs.

    try:
        return MeshFiles(settings.packages)
    except MeshFilesError as error:
        raise CommandError(f"--packages {error}", exit_code=2) from error


async def _serve(settings: Settings, arguments: argparse.Namespace, seat: Seat | None = None) -> None:
    graph, start_script = stage(arguments.script, _registry(settings), settings, seat)
    with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals, ExitStack() as nodes:
        async with graph:
            http = start_nodes(graph, settings, nodes)
            if settings.packages:
                http.append(_mesh_files(settings).http)
            if settings.demo:
                http += http_of(nodes.enter_context(_demo_robot(graph)))
            if arguments.record is not None or arguments.introspection:
                from rwt.recording import record_graph  # Read only where something is recorded.

                told = arguments.introspection
                record_graph(graph, arguments.record, introspection=told, stack=nodes)
            served = serve(
                graph,
                *settings.listen,
                settings=settings,
                http=http,
                around=start_script(nodes),
                together=None if seat is None else seat.figures.together,
            )
            async with served as server:
                said = _announcement(server, demo=settings.demo)
                if seat is None:
                    # Standard output belongs to the protocol where it is served.
                    over_stdio = "stdio:" in server.urls
                    print(said, flush=True, file=sys.stderr if over_stdio else sys.stdout)
                    await _signal_or_end(signals, server.ended)
                else:
                    async with seat.figures.offered(server.metrics.text):
                        seat.say(said)
                        await _signal_or_end(signals, _parent_ended)


async def _parent_ended() -> None:
    """Wait until the parent of this worker has died without a word."""
    from rwt.workers.supervisor import parent_sentinel

    await anyio.wait_readable(parent_sentinel())


async def _signal_or_end(
    signals: AsyncIterator[signal.Signals], ended: Callable[[], Awaitable[None]]
) -> None:
    """Wait for a signal, or until there is nobody any more to serve for: who started this as a child has
    closed its standard input, or is gone."""
    async with anyio.create_task_group() as tasks:

        async def watch() -> None:
            await ended()
            tasks.cancel_scope.cancel()

        tasks.start_soon(watch)
        async for _ in signals:
            break
        tasks.cancel_scope.cancel()


def _announcement(server: Server, *, demo: bool) -> str:
    """What says that the server is ready."""
    said = [f"listening on {url}" for url in server.urls]
    said += [f"dialing {relay.url}" for relay in server.dials]
    web = next((url for url in server.urls if url.startswith(("ws://", "wss://"))), None)
    if demo and web is not None:
        said.append(_next_steps(web))
    return "\n".join(said)


def _demo_robot(graph: Graph) -> closing[DemoRobot]:
    from rwt_nodes.demo import DemoRobot  # Its code is read only where it runs.

    return closing(DemoRobot(graph))


def _next_steps(url: str) -> str:
    page = url.replace("ws", "http", 1)
    return f"""
The demo robot is up. Point any rosbridge client at {url}, or open {page} in a browser.

  roslibjs   new ROSLIB.Ros({{ url: "{url}" }})
  roslibpy   roslibpy.Ros(host="{url.split("/")[2].rpartition(":")[0]}", port={url.rpartition(":")[2]}).run()

Publish geometry_msgs/Twist on /cmd_vel to drive, subscribe to /odom, /scan and /map, call /add_two_ints,
or send a goal to /navigate_to_pose. Ctrl-C ends it."""
