"""Graph of a live ROS 1 robot, without an installation of ROS: XML-RPC to the master, TCPROS to its nodes.

A :class:`Ros1Graph` is used like a :class:`~rwt_graph.MemoryGraph`; its nodes and endpoints are
visible to all ROS 1 programs::

    async with Ros1Graph(master="ros1://robot:11311") as graph:
        node = graph.node("talker")

Messages pass as serialised bytes. Types that the registry does not know are read from the wire.
"""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.ros1.backend import Ros1Graph as Ros1Graph
    from rwt_graph.errors import Ros1Error as Ros1Error

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.ros1.backend": ("Ros1Graph"),
        "rwt_graph.errors": ("Ros1Error"),
    },
)
