"""`rclpy.time_source`: source of a node's time, `/clock` while its parameter `use_sim_time` is true."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any, Final

from rwt_rclpy.clocks.clock import ROSClock
from rwt_rclpy.clocks.time import ClockType, Time
from rwt_rclpy.endpoints.qos import QoSProfile, ReliabilityPolicy
from rwt_rclpy.messages.loaded import message_class
from rwt_rclpy.parameters.node_parameters import result
from rwt_rclpy.parameters.parameter import Parameter, ParameterKind

if TYPE_CHECKING:
    from rwt_rclpy.endpoints.subscription import Subscription
    from rwt_rclpy.nodes.node import Node

CLOCK_TOPIC: Final = "/clock"
USE_SIM_TIME_NAME: Final = "use_sim_time"


class TimeSource:
    """Time source of the attached clocks."""

    def __init__(self, *, node: Node | None = None) -> None:
        self._clock_sub: Subscription | None = None
        self._node_weak_ref: weakref.ref[Node] | None = None
        self._associated_clocks: set[ROSClock] = set()
        self._last_time_set = Time(clock_type=ClockType.ROS_TIME)
        self._ros_time_is_active = False
        if node is not None:
            self.attach_node(node)

    @property
    def ros_time_is_active(self) -> bool:
        """True if the clocks follow `/clock`; writable."""
        return self._ros_time_is_active

    @ros_time_is_active.setter
    def ros_time_is_active(self, enabled: bool) -> None:
        if self._ros_time_is_active == enabled:
            return
        self._ros_time_is_active = enabled
        for clock in self._associated_clocks:
            self._follow(clock)
        if enabled:
            self._subscribe()
        else:
            node = self._get_node()
            if node is not None and self._clock_sub is not None:
                node.destroy_subscription(self._clock_sub)
                self._clock_sub = None

    def _subscribe(self) -> None:
        node = self._get_node()
        if node is not None and self._clock_sub is None:
            self._clock_sub = node.create_subscription(
                message_class("rosgraph_msgs/Clock"),
                CLOCK_TOPIC,
                self.clock_callback,
                QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
            )

    def attach_node(self, node: Node) -> None:
        """Follow the parameter of a node; declare it if necessary."""
        if self._node_weak_ref is not None:
            self.detach_node()
        self._node_weak_ref = weakref.ref(node)
        if not node.has_parameter(USE_SIM_TIME_NAME):
            node.declare_parameter(USE_SIM_TIME_NAME, False)
        parameter = node.get_parameter(USE_SIM_TIME_NAME)
        if parameter.type_ is ParameterKind.BOOL:
            self.ros_time_is_active = parameter.value
        else:
            node.get_logger().error(
                f"Invalid type for parameter '{USE_SIM_TIME_NAME}' {parameter.type_!r} should be bool"
            )
        node.add_on_set_parameters_callback(self._on_parameter_event)
        if self._ros_time_is_active:
            self._subscribe()

    def detach_node(self) -> None:
        """Stop following the node's parameter."""
        node = self._get_node()
        if node is not None:
            if self._clock_sub is not None:
                node.destroy_subscription(self._clock_sub)
            node.remove_on_set_parameters_callback(self._on_parameter_event)
        self._clock_sub = None
        self._node_weak_ref = None

    def attach_clock(self, clock: ROSClock) -> None:
        """Attach a clock. Raises ValueError if it is not of ROS time."""
        if not isinstance(clock, ROSClock):
            raise ValueError("Only clocks with type ROS_TIME can be attached.")
        self._follow(clock)
        self._associated_clocks.add(clock)

    def clock_callback(self, msg: Any) -> None:
        """Handle a message of `/clock`."""
        self._last_time_set = Time.from_msg(msg.clock)
        for clock in self._associated_clocks:
            clock.set_ros_time_override(self._last_time_set)

    def _follow(self, clock: ROSClock) -> None:
        clock.set_ros_time_override(self._last_time_set)
        clock._set_ros_time_is_active(self._ros_time_is_active)

    def _on_parameter_event(self, parameters: list[Parameter]) -> Any:
        for parameter in parameters:
            if parameter.name != USE_SIM_TIME_NAME:
                continue
            if parameter.type_ is not ParameterKind.BOOL:
                return result(f"{USE_SIM_TIME_NAME} parameter set to something besides a bool")
            self.ros_time_is_active = parameter.value
        return result()

    def _get_node(self) -> Node | None:
        return None if self._node_weak_ref is None else self._node_weak_ref()
