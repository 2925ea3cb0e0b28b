"""The ready-made nodes of `rwt serve`: which there are, and how they are started."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, closing
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Protocol

from rwt_nodes.rosapi import Rosapi
from rwt_nodes.tf import Tf2WebRepublisher

if TYPE_CHECKING:
    from rwt_bridge.pages import Page
    from rwt_bridge.settings import NodeName
    from rwt_graph.api import Graph


class ReadyNode(Protocol):
    """A node that works from its construction until it is closed.

    One that serves HTTP has an attribute `pages` besides: path → :data:`rwt_bridge.pages.Page`.
    """

    def close(self) -> None:
        """Leave the graph."""


NODES: Final[Mapping[NodeName, Callable[[Graph], ReadyNode]]] = MappingProxyType(
    {"rosapi": Rosapi, "tf2_web_republisher": Tf2WebRepublisher}
)
"""Every node that the setting `nodes` may name. A row that needs heavy libraries imports them when called."""


def start_nodes(graph: Graph, names: Iterable[NodeName], stack: ExitStack) -> Mapping[str, Page]:
    """Start nodes that `stack` closes; returns the pages that they serve."""
    pages: dict[str, Page] = {}
    for name in names:
        node = stack.enter_context(closing(NODES[name](graph)))
        pages.update(getattr(node, "pages", {}))
    return pages
