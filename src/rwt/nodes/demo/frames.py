"""Names of the robot's coordinate frames."""

from __future__ import annotations

from rwt_graph import Node

MAP = "map"
ODOM = "odom"


def frame(node: Node, name: str) -> str:
    """The frame `name` of the robot that `node` is.

    All robots of a graph share `/tf`, so the frames of one in a namespace begin with it: `odom` of `/anna` is
    `anna/odom`.
    """
    return node.resolve(name).removeprefix("/")
