"""rosapi: services about the graph, under `/rosapi`."""

from rwt.nodes.rosapi.node import DISCLOSURES, Rosapi

__all__ = ["DISCLOSURES", "Rosapi"]
