"""Common parts of the endpoints of topics, and of those of services."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rwt_rclpy.destroyable import Closable
from rwt_rclpy.endpoints.event_watches import DeadlineHandler
from rwt_rclpy.endpoints.introspection import ServiceIntrospectionState, StepPublisher
from rwt_rclpy.execution.entity import Entity

if TYPE_CHECKING:
    from rwt_rclpy.clocks.clock import Clock
    from rwt_rclpy.endpoints.event_handler import EventHandler
    from rwt_rclpy.endpoints.qos import QoSProfile
    from rwt_rclpy.messages.classes import Message
    from rwt_rclpy.middleware.link import Link
    from rwt_rclpy.nodes.node import Node


class TopicEndpoint(Closable):
    """Publisher or subscription.

    Attributes:
        logger_name: name of the logger of its node.
        msg_type: class of the messages.
        topic: requested name.
        qos_profile: quality of service.
        event_handlers: handlers of events.
    """

    def __init__(
        self,
        link: Link,
        msg_type: type[Message],
        topic: str,
        qos_profile: QoSProfile,
        event_handlers: list[EventHandler],
    ) -> None:
        self._link = link
        self.msg_type = msg_type
        self.topic = topic
        self.qos_profile = qos_profile
        self.logger_name = ""
        self.event_handlers = event_handlers
        self._watching = [each for each in event_handlers if isinstance(each, DeadlineHandler)]

    def destroy(self) -> None:
        """Leave the topic; see :meth:`Node.destroy_publisher` and :meth:`Node.destroy_subscription`."""
        for handler in self.event_handlers:
            handler.destroy()
        super().destroy()


class ServiceEndpoint(Entity, Closable):
    """Service or client.

    Attributes:
        logger_name: name of the logger of its node.
        srv_type: class of the service.
        srv_name: requested name.
        qos_profile: quality of service.
    """

    def __init__(
        self,
        node: Node,
        srv_type: Any,
        srv_name: str,
        full_name: str,
        qos_profile: QoSProfile,
        callback_group: Any,
    ) -> None:
        super().__init__(callback_group)
        self._node = node
        self._link = node.context._rwt_link
        self._name = full_name
        self._steps: StepPublisher | None = None
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.qos_profile = qos_profile
        self.logger_name = node.get_logger().name

    @property
    def service_name(self) -> str:
        """Absolute name of the service."""
        self._handle.check()
        return self._name

    def configure_introspection(
        self,
        clock: Clock,
        service_event_qos_profile: QoSProfile,
        introspection_state: ServiceIntrospectionState,
    ) -> None:
        """Start or stop publishing service events."""
        if self._steps is not None:
            self._node.destroy_publisher(self._steps.publisher)
            self._steps = None
        if introspection_state is not ServiceIntrospectionState.OFF:
            publisher = self._node.create_publisher(
                self.srv_type.Event, f"{self.service_name}/_service_event", service_event_qos_profile
            )
            self._steps = StepPublisher(publisher, clock, ServiceIntrospectionState(introspection_state))
