"""Declarations of the graph of a live ROS 1 robot, and of its check by `rwt doctor`."""

from __future__ import annotations

from collections.abc import Callable

from rwt.declarations import CheckContext, CheckPart, Finding, GraphContext, GraphPart, NoSettings
from rwt_graph.api import Graph


def _make(context: GraphContext, settings: NoSettings) -> Graph:
    from rwt.extensions.ros1 import Ros1Graph

    master = context.address if "://" in context.address or context.address != "ros1" else None
    return Ros1Graph(context.registry, context.clock, master=master)


async def _examine(context: CheckContext, report: Callable[[Finding], None]) -> None:
    from rwt.extensions.ros1.diagnosis import examine

    await examine(context.url, report)


PART = GraphPart(summary="graph of a ROS 1 master and its nodes", make=_make, distro="noetic")

CHECK = CheckPart(summary="nodes of a ROS 1 master", examine=_examine, is_whole=True)
