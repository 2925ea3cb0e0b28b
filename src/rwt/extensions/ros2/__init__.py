"""Graph of a live ROS 2 robot, through the `rclpy` of the ROS 2 that is installed.

Needs a sourced ROS 2 (or its wheels). A :class:`Ros2Graph` is used like a
:class:`~rwt_graph.MemoryGraph`; its nodes and endpoints are visible to all ROS 2 programs::

    async with Ros2Graph() as graph:
        node = graph.node("talker")

Messages pass as serialised bytes, without classes of `rclpy` and without an executor.
"""

from rwt.extensions.ros2.ament import add_installed
from rwt.extensions.ros2.backend import Ros2Graph
from rwt_graph.errors import Ros2Error

__all__ = ["Ros2Error", "Ros2Graph", "add_installed"]
