"""What can be wrong with the connection to other processes."""

from __future__ import annotations

from rwt_graph.errors import GraphError


class ZenohError(GraphError):
    """The Zenoh session cannot be opened as asked; the text says what to change."""
