"""`rclpy.service_introspection`: events of calls, published on `<service>/_service_event`."""

from __future__ import annotations

import uuid
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from rwt_rclpy.messages.loaded import message_class

if TYPE_CHECKING:
    from rwt_rclpy.clocks.clock import Clock
    from rwt_rclpy.endpoints.publisher import Publisher


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
        event = self.publisher.msg_type()
        info: Any = message_class("service_msgs/ServiceEventInfo")(
            event_type=event_type,
            stamp=self._clock.now().to_msg(),
            client_gid=self._gid,
            sequence_number=sequence,
        )
        parts: Any = event
        parts.info = info
        if self._state is ServiceIntrospectionState.CONTENTS:
            parts.request = [] if request is None else [request]
            parts.response = [] if response is None else [response]
        self.publisher.publish(event)
