"""The graph over Eclipse Zenoh, on the wire of ROS 2's rmw_zenoh: many processes and hosts, one graph.

Needs the extra `zenoh`. A :class:`ZenohGraph` is what :class:`~rwt_graph.memory.graph.MemoryGraph` is to the
programs in its process; whatever takes part in it is known to, and reached by, every other process that it is
connected to::

    async with ZenohGraph(connect=["tcp/10.0.0.7:7447"]) as graph:
        node = graph.node("talker")
"""

from rwt_graph.errors import ZenohError
from rwt_graph.zenoh.backend import ZenohGraph
from rwt_graph.zenoh.session import ZenohOptions

__all__ = ["ZenohError", "ZenohGraph", "ZenohOptions"]
