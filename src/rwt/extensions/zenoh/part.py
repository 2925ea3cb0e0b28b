"""Declaration of the graph over Zenoh."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from rwt.access.settings import SettingsError, Table
from rwt.declarations import GraphContext, GraphPart, Option
from rwt_graph.api import Graph

if TYPE_CHECKING:
    from rwt.settings.models import Settings

NAME = "zenoh"


class ZenohSettings(Table):
    """Connection to other processes over Zenoh. Used with `graph = "zenoh"`."""

    listen: tuple[str, ...] = Field((), description="endpoints to listen on, such as `tcp/0.0.0.0:7447`")
    connect: tuple[str, ...] = Field(
        (), description="endpoints of peers or routers; unreachable ones are retried"
    )
    mode: Literal["peer", "client", "router"] | None = Field(
        None,
        description="`client` communicates only through the router it is connected to; not set: the mode in"
        " `config`, or peer",
    )
    multicast: bool | None = Field(
        None, description="discover peers on the local network; not set: as in `config`, or no"
    )
    config: Path | None = Field(
        None, description="Zenoh's own configuration file (JSON5), for example for TLS and access control"
    )
    domain: int = Field(
        0, ge=0, le=2**32 - 1, description="ROS_DOMAIN_ID: graphs of different domains are separate"
    )


def _check(settings: Settings, own: ZenohSettings) -> None:
    is_used = NAME in (settings.graph, *settings.bridge) or settings.workers > 1
    if not is_used and (own.listen or own.connect):
        raise ValueError(
            '`zenoh`: to join other processes over Zenoh, give --graph zenoh too, or `graph = "zenoh"`'
        )


def _make(context: GraphContext, settings: ZenohSettings) -> Graph:
    try:
        from rwt.extensions.zenoh import ZenohGraph, ZenohOptions
    except ImportError as error:
        raise SettingsError(
            "`graph`: the graph over Zenoh needs more packages: pip install 'robot-web-tools[zenoh]'"
        ) from error
    options = ZenohOptions(**settings.model_dump())
    if context.worker is not None:
        from rwt.extensions.zenoh.worker_mesh import mesh_options

        options = mesh_options(options, context.worker.folder, context.worker.number, context.processes)
    return ZenohGraph(context.registry, context.clock, **asdict(options))


PART = GraphPart(
    summary="graph that processes and hosts share over Zenoh, also with ROS 2",
    settings=ZenohSettings,
    check=_check,
    make=_make,
    is_shared=True,
    options=(
        Option(
            "--zenoh-listen",
            "zenoh.listen",
            {
                "action": "append",
                "metavar": "ENDPOINT",
                "help": "listen for other processes at, for example, tcp/0.0.0.0:7447; may be given several"
                " times",
            },
        ),
        Option(
            "--zenoh-connect",
            "zenoh.connect",
            {
                "action": "append",
                "metavar": "ENDPOINT",
                "help": "connect to a process or router at, for example, tcp/10.0.0.7:7447; may be given"
                " several times",
            },
        ),
        Option(
            "--zenoh-config",
            "zenoh.config",
            {"metavar": "FILE", "help": "a Zenoh configuration file, for TLS, access control, …"},
        ),
        Option(
            "--domain",
            "zenoh.domain",
            {"type": int, "metavar": "N", "help": "ROS_DOMAIN_ID of --graph zenoh (default 0)"},
        ),
    ),
)
