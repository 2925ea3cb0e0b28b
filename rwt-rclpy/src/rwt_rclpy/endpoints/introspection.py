"""`rclpy.service_introspection`: services and clients, whose events are published on request.

The events of a service are on `<service>/_service_event`.
"""

from __future__ import annotations

import uuid
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from rwt_rclpy.destroyable import Closable
from rwt_rclpy.execution.entity import Entity
from rwt_rclpy.messages.loaded import message_class

if TYPE_CHECKING:
    from rwt_rclpy.clocks.clock import Clock
    from rwt_rclpy.endpoints.publisher import Publisher
    from rwt_rclpy.endpoints.qos import QoSProfile
    from rwt_rclpy.nodes.node import Node


class ServiceIntrospectionState(IntEnum):
    """Content of the published service events."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2


class StepPublisher:
    """Publisher of the service events of one client or service."""

    def __init__(self, publisher: Publisher, clock: Clock, state: ServiceIntrospectionState) -> None:
        self.publisher = publisher
        self._clock = clock
        self._state = state
        self._gid = list(uuid.uuid4().bytes)

    def publish(self, event_type: int, sequence: int, *, request: Any = None, response: Any = None) -> None:
        """Publish one event; its type is a number of `service_msgs/ServiceEventInfo`."""
        event: Any = self.publisher.msg_type()
        event.info = message_class("service_msgs/ServiceEventInfo")(
            event_type=event_type,
            stamp=self._clock.now().to_msg(),
            client_gid=self._gid,
            sequence_number=sequence,
        )
        if self._state is ServiceIntrospectionState.CONTENTS:
            event.request = [] if request is None else [request]
            event.response = [] if response is None else [response]
        self.publisher.publish(event)


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
