"""What is raised for bytes and texts that are not rmw_zenoh's."""

from __future__ import annotations

from rwt_graph.errors import GraphError


class WireError(GraphError, ValueError):
    """A key, token or attachment that another program sent is not written as rmw_zenoh writes it."""
