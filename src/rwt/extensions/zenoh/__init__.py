"""Graph over Eclipse Zenoh, compatible with ROS 2's rmw_zenoh: many processes and hosts, one graph.

Needs the extra `zenoh`. A :class:`ZenohGraph` is used like a
:class:`~rwt_graph.MemoryGraph`; its nodes and endpoints are visible to all connected processes::

    async with ZenohGraph(connect=["tcp/10.0.0.7:7447"]) as graph:
        node = graph.node("talker")
"""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.zenoh.backend import ZenohGraph as ZenohGraph
    from rwt.extensions.zenoh.session import ZenohOptions as ZenohOptions
    from rwt_graph.errors import ZenohError as ZenohError

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.zenoh.backend": ("ZenohGraph"),
        "rwt.extensions.zenoh.session": ("ZenohOptions"),
        "rwt_graph.errors": ("ZenohError"),
    },
)
