"""A robot in an empty warehouse, which says that Nav2 is there: what `nav2_simple_commander` talks to.

    python tools/upstream/robots/warehouse.py unix:///tmp/robot.sock --interfaces ../navigation2/nav2_msgs

Its examples drive further than the demo robot's house reaches. Their commander waits until the nodes `amcl`
and `bt_navigator` say that they are active, and until the first has a pose.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any, Final

from rwt import MemoryGraph, Node, Server
from rwt.extensions.demo.robot import DemoRobot
from rwt.extensions.demo.world.map import Box, World, walled
from rwt_graph import Graph
from rwt_interfaces.registry import Registry

#: Metres: what the examples of Nav2's warehouse reach.
_FLOOR: Final = Box(-10.0, -10.0, 25.0, 10.0)

_ACTIVE: Final = {"current_state": {"id": 3, "label": "active"}}


def _serve_nav2(graph: Graph) -> None:
    """The two lifecycle nodes for which the commander waits."""
    for name in ("amcl", "bt_navigator"):
        Node(graph, name).advertise_service(
            f"/{name}/get_state", "lifecycle_msgs/GetState", lambda _: _ACTIVE
        )
    localizer = Node(graph, "localizer")
    poses = localizer.advertise("/amcl_pose", "geometry_msgs/PoseWithCovarianceStamped", latch=True)

    def locate(message: Any) -> None:
        poses.publish(message)

    localizer.subscribe("/initialpose", locate, "geometry_msgs/PoseWithCovarianceStamped")


def main() -> int:
    """Serve until it is ended."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url")
    parser.add_argument("--interfaces", action="append", default=[], metavar="DIR")
    options = parser.parse_args()
    registry = Registry()
    for folder in options.interfaces:
        registry.add_directory(folder)
    graph = MemoryGraph(registry)
    with Server(options.url, graph=graph) as server:
        DemoRobot(graph, World(_FLOOR, walled(_FLOOR)))
        _serve_nav2(graph)
        server.spin()
    return 0


if __name__ == "__main__":
    sys.exit(main())
