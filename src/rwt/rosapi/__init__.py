"""rosapi: services about the graph, under `/rosapi`."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from rwt.rosapi import graph_services, parameter_services, type_services
from rwt.rosapi.service import CONVENTIONS
from rwt_graph.api import Graph
from rwt_graph.disclosure import Disclosure
from rwt_graph.nodes.node import Node

__all__ = ["DISCLOSURES", "Rosapi"]

_SERVICES: Final = (*graph_services.SERVICES, *type_services.SERVICES, *parameter_services.SERVICES)

DISCLOSURES: Final[Mapping[str, Disclosure]] = MappingProxyType(
    {
        f"{package}/{service.type}": service.reveals
        for package in sorted({each.package for each in CONVENTIONS.values()})
        for service in (*_SERVICES, graph_services.VERSION)
    }
)
"""Declarations of what the services of rosapi reveal, by two-part type name in each distribution."""


class Rosapi(Node):
    """Node that serves rosapi for one graph until `close`."""

    def __init__(self, graph: Graph) -> None:
        super().__init__(graph, "rosapi")
        conventions = CONVENTIONS[graph.distro.conventions]
        for service in (*_SERVICES, *((graph_services.VERSION,) if conventions.has_version else ())):
            interface = f"{conventions.package}/{service.type}"
            self.advertise_service(f"/rosapi/{service.name}", interface, service.serve(self))
