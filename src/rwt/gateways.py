"""The protocols that a server speaks beside rosbridge, and how their gateways are started."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt.settings.models import GatewayName, Settings
    from rwt_access.access import Access
    from rwt_access.gateway import Gateway
    from rwt_graph.api import Graph


def _http(graph: Graph, settings: Settings, access: Access) -> Gateway:
    from rwt_http import HttpGateway

    offered = {"gateways": ["rosbridge", *settings.gateways], "nodes": list(settings.nodes)}
    return HttpGateway(graph, access, settings.api, settings.unregister_timeout, offered)


GATEWAYS: Final[Mapping[GatewayName, Callable[[Graph, Settings, Access], Gateway]]] = MappingProxyType(
    {"http": _http}
)
"""Every gateway that the setting `gateways` may name. A row imports its package when it is called, since not
every server speaks it."""


def start_gateways(graph: Graph, settings: Settings, access: Access) -> list[Gateway]:
    """Make those that the settings name, in front of a graph that runs."""
    return [GATEWAYS[name](graph, settings, access) for name in settings.gateways]
