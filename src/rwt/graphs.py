"""Which graph a server stands in front of."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rwt_cli.errors import CommandError
from rwt_graph.memory.graph import MemoryGraph

if TYPE_CHECKING:
    from rwt.settings.models import Settings
    from rwt.workers.worker import Seat
    from rwt_interfaces.registry import Registry


def add_backend_options(parser: argparse.ArgumentParser) -> None:
    """The options that choose a graph and connect it."""
    parser.add_argument(
        "--graph",
        choices=("memory", "zenoh"),
        help="keep the graph in this process (default), or join it with others over Zenoh",
    )
    parser.add_argument(
        "--zenoh-listen",
        action="append",
        metavar="ENDPOINT",
        help="be found by other processes at, for example, tcp/0.0.0.0:7447; may be given several times",
    )
    parser.add_argument(
        "--zenoh-connect",
        action="append",
        metavar="ENDPOINT",
        help="join the process or router at, for example, tcp/10.0.0.7:7447; may be given several times",
    )
    parser.add_argument(
        "--zenoh-config", metavar="FILE", help="a Zenoh configuration file, for TLS, access control, …"
    )
    parser.add_argument("--domain", type=int, metavar="N", help="ROS_DOMAIN_ID (default 0)")


def backend_options(arguments: argparse.Namespace) -> dict[str, object]:
    """The values of those options by the keys of their settings."""
    return {
        "graph": arguments.graph,
        "zenoh.listen": tuple(arguments.zenoh_listen or ()) or None,
        "zenoh.connect": tuple(arguments.zenoh_connect or ()) or None,
        "zenoh.config": arguments.zenoh_config,
        "zenoh.domain": arguments.domain,
    }


def make_graph(settings: Settings, registry: Registry, seat: Seat | None = None) -> MemoryGraph:
    """The graph that the settings ask for, not entered.

    Args:
        settings: of the server.
        registry: the interfaces.
        seat: of which worker it is, joined with the graphs of the others.

    Raises:
        CommandError: the extra for it is not installed, or it is told to join others and to be alone.
    """
    zenoh = settings.zenoh
    if settings.graph == "memory":
        if zenoh.listen or zenoh.connect:
            raise CommandError("to join other processes over Zenoh, give --graph zenoh too", exit_code=2)
        return MemoryGraph(registry=registry)
    try:
        from rwt_graph.zenoh import ZenohGraph, ZenohOptions  # Only who asks for it must have it.
    except ImportError as error:
        raise CommandError(
            "the graph over Zenoh needs more packages: pip install 'robot-web-tools[zenoh]'", exit_code=2
        ) from error
    options = ZenohOptions(
        zenoh.listen, zenoh.connect, zenoh.mode, zenoh.multicast, zenoh.config, zenoh.domain
    )
    if seat is not None:
        from rwt_graph.zenoh.worker_mesh import mesh_options

        options = mesh_options(options, seat.folder, seat.number, settings.workers)
    return ZenohGraph(
        registry=registry,
        listen=options.listen,
        connect=options.connect,
        mode=options.mode,
        multicast=options.multicast,
        config=options.config,
        domain=options.domain,
    )


__all__ = ["add_backend_options", "backend_options", "make_graph"]
