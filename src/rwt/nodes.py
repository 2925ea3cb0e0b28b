"""The ready-made nodes of `rwt serve`: which there are, and how they are started."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Protocol

from rwt_nodes.rosapi import Rosapi
from rwt_nodes.tf import Tf2WebRepublisher

if TYPE_CHECKING:
    from rwt.settings.models import NodeName, Settings
    from rwt_graph.api import Graph
    from rwt_nodes.video import WebVideoServer
    from rwt_transports.http import HttpExtension


class ReadyNode(Protocol):
    """A node that works from its construction until it is closed. What it brings to HTTP is its `http`."""

    def close(self) -> None:
        """Leave the graph."""


def http_of(*nodes: object) -> list[HttpExtension]:
    """What nodes bring to HTTP; those that bring nothing have no attribute `http`."""
    return [node.http for node in nodes if hasattr(node, "http")]


def _video(graph: Graph, settings: Settings) -> WebVideoServer:
    from rwt_nodes.video import WebVideoServer

    return WebVideoServer(graph, settings.limits.video_viewers, settings.limits.video_encoders)


NODES: Final[Mapping[NodeName, Callable[[Graph, Settings], ReadyNode]]] = MappingProxyType(
    {
        "rosapi": lambda graph, settings: Rosapi(graph),
        "tf2_web_republisher": lambda graph, settings: Tf2WebRepublisher(graph),
        "web_video_server": _video,
    }
)
"""Every node that the setting `nodes` may name. A row that needs heavy libraries imports them when called."""

ON_EVERY_WORKER: Final[frozenset[NodeName]] = frozenset({"web_video_server"})
"""Those that `rwt serve --workers` starts in each process: the ones with pages, since any may be asked."""


def start_nodes(graph: Graph, settings: Settings, stack: ExitStack) -> list[HttpExtension]:
    """Start the nodes that the settings name and `stack` closes; returns what they bring to HTTP."""
    return http_of(*[stack.enter_context(closing(NODES[name](graph, settings))) for name in settings.nodes])
