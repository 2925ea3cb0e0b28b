"""Graph of a live ROS 2 robot, through the `rclpy` of the ROS 2 that is installed.

Needs a sourced ROS 2 (or its wheels). A :class:`Ros2Graph` is used like a
:class:`~rwt_graph.MemoryGraph`; its nodes and endpoints are visible to all ROS 2 programs::

    async with Ros2Graph() as graph:
        node = graph.node("talker")

Messages pass as serialised bytes, without classes of `rclpy` and without an executor.
"""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.ros2.ament import add_installed as add_installed
    from rwt.extensions.ros2.backend import Ros2Graph as Ros2Graph
    from rwt_graph.errors import Ros2Error as Ros2Error

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.ros2.ament": ("add_installed"),
        "rwt.extensions.ros2.backend": ("Ros2Graph"),
        "rwt_graph.errors": ("Ros2Error"),
    },
)
