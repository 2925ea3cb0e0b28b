"""Common part of publishers and subscriptions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_rclpy.destroyable import Closable
from rwt_rclpy.endpoints.event_watches import DeadlineHandler

if TYPE_CHECKING:
    from rwt_rclpy.endpoints.event_handler import EventHandler
    from rwt_rclpy.endpoints.qos import QoSProfile
    from rwt_rclpy.messages.classes import Message
    from rwt_rclpy.middleware.link import Link


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
