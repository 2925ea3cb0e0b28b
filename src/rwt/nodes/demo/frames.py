"""Names of the robot's coordinate frames."""

from __future__ import annotations

from rwt_graph import Node

MAP = "map"
ODOM = "odom"


def frame(node: Node, name: str) -> str:
    """Return the robot's frame `name` with the node's namespace: `odom` of `/anna` is `anna/odom`."""
    return node.resolve(name).removeprefix("/")
