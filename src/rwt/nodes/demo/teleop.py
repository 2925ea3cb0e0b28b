"""Teleoperation: velocity commands on `/cmd_vel`, which expire."""

from __future__ import annotations

import math

from rwt.nodes.demo.drive import Velocity
from rwt_graph import Node
from rwt_participant.messages import Message


class Teleop:
    """The last velocity command.

    Attributes:
        timeout: seconds after which a command expires.
    """

    timeout = 0.5

    def __init__(self, node: Node) -> None:
        self._node = node
        self._last: Velocity | None = None
        self._since = 0.0
        node.subscribe("cmd_vel", self._on_twist, "geometry_msgs/Twist")

    @property
    def velocity(self) -> Velocity | None:
        """Return the current command, or None if it has expired."""
        # A step that ends with the timeout still belongs to the command, despite rounding.
        if self._last is not None and self._node.clock.monotonic() - self._since > self.timeout + 1e-6:
            self._last = None
        return self._last

    def forget(self) -> None:
        """Drop the command."""
        self._last = None

    def _on_twist(self, twist: Message) -> None:
        if not (math.isfinite(twist.linear.x) and math.isfinite(twist.angular.z)):
            topic = self._node.resolve("cmd_vel")
            text = f"{topic}: linear.x or angular.z is not a finite number; ignored"
            self._node.log.warning(text)
            return
        self._last = Velocity(twist.linear.x, twist.angular.z)
        self._since = self._node.clock.monotonic()
