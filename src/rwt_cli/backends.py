"""Which graph a server stands in front of."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rwt_cli.errors import CommandError
from rwt_graph.memory import MemoryGraph

if TYPE_CHECKING:
    from rwt_bridge.settings import Settings
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


def make_graph(settings: Settings, registry: Registry) -> MemoryGraph:
    """The graph that the settings ask for, not entered.

    Raises:
        CommandError: the extra for it is not installed, or it is told to join others and to be alone.
    """
    zenoh = settings.zenoh
    if settings.graph == "memory":
        if zenoh.listen or zenoh.connect:
            raise CommandError("to join other processes over Zenoh, give --graph zenoh too", exit_code=2)
        return MemoryGraph(registry=registry)
    try:
        from rwt_graph.zenoh import ZenohGraph  # Only who asks for it must have it.
    except ImportError as error:
        raise CommandError(
            "the graph over Zenoh needs more packages: pip install 'robot-web-tools[zenoh]'", exit_code=2
        ) from error
    return ZenohGraph(
        registry=registry,
        listen=zenoh.listen,
        connect=zenoh.connect,
        mode=zenoh.mode,
        multicast=zenoh.multicast,
        config=zenoh.config,
        domain=zenoh.domain,
    )


__all__ = ["add_backend_options", "backend_options", "make_graph"]
