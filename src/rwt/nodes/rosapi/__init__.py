"""rosapi: what clients ask about the graph, as services under `/rosapi`."""

from rwt.nodes.rosapi.node import DISCLOSURES, Rosapi

__all__ = ["DISCLOSURES", "Rosapi"]
