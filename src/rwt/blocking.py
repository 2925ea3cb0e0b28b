"""A node for scripts and notebooks: its methods wait, and the server runs in a thread behind it.

>>> with Server("ws://127.0.0.1:9090") as robot:
...     robot.advertise_service("/beep", "std_srvs/Trigger", lambda request: {"success": True})
...     robot.publish("/battery", {"data": 12.6}, "std_msgs/Float32")

Callbacks and handlers run in that thread; see :mod:`rwt_program.blocking`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_graph.program.node import GraphThread, Node
from rwt_program.blocking import BlockingHandle, BlockingRobot, holds

if TYPE_CHECKING:
    from rwt.server import Server


class BlockingNode(BlockingRobot[Node]):
    """A node whose verbs wait; see :class:`rwt_graph.Node`.

    Attributes:
        node: the node itself, with everything that is not here.
        server: the server whose graph it is in.
    """

    def __init__(self, node: Node, server: Server) -> None:
        super().__init__(GraphThread(node), node)
        self.node = node
        self.server = server

    advertise_action = holds(Node.advertise_action, BlockingHandle)

    def spin(self) -> None:
        """Wait until Ctrl-C is pressed or the server has nobody left to serve (see :meth:`Server.ended`).

        Raises:
            WrongThread: called in a callback, on the graph's own thread.
        """
        try:
            self._loop.wait(self.server.ended)
        except KeyboardInterrupt:
            return


__all__ = ["BlockingNode"]
