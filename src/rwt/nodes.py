"""The ready-made nodes of `rwt serve`: which there are, and how they are started."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Protocol

from rwt_nodes.rosapi import Rosapi
from rwt_nodes.tf import Tf2WebRepublisher

if TYPE_CHECKING:
    from rwt.pages import Figures, Page, Section
    from rwt.settings.models import NodeName, Settings
    from rwt_graph.api import Graph
    from rwt_nodes.video import WebVideoServer


class ReadyNode(Protocol):
    """A node that works from its construction until it is closed.

    What it shows over HTTP are attributes that it may have besides: `pages` (path →
    :data:`rwt.pages.Page`), `section` (a :data:`rwt.pages.Section`) and `figures` (a
    :data:`rwt.pages.Figures`).
    """

    def close(self) -> None:
        """Leave the graph."""


@dataclass(slots=True)
class Shown:
    """What the nodes show over HTTP, for :func:`rwt.server.serve`."""

    pages: dict[str, Page] = field(default_factory=dict)
    sections: list[Section] = field(default_factory=list)
    figures: list[Figures] = field(default_factory=list)

    def add(self, node: ReadyNode) -> None:
        """Collect what a node has."""
        self.pages.update(getattr(node, "pages", {}))
        for name, all_nodes in (("section", self.sections), ("figures", self.figures)):
            its = getattr(node, name, None)
            if its is not None:
                all_nodes.append(its)


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


def start_nodes(graph: Graph, settings: Settings, stack: ExitStack) -> Shown:
    """Start the nodes that the settings name and `stack` closes; returns what they show."""
    shown = Shown()
    for name in settings.nodes:
        shown.add(stack.enter_context(closing(NODES[name](graph, settings))))
    return shown
