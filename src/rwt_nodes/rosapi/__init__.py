"""rosapi: what clients ask about the graph, as services under `/rosapi` (PROTOCOL_FACTS section 16)."""

from rwt_nodes.rosapi.node import Rosapi

__all__ = ["Rosapi"]
