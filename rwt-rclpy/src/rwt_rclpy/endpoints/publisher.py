"""`rclpy.publisher`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rwt_interfaces.payload import Payload
from rwt_rclpy.clocks.duration import Duration
from rwt_rclpy.destroyable import Destroyable
from rwt_rclpy.endpoints.event_watches import TopicEndpoint
from rwt_rclpy.endpoints.events import QoSPublisherEventType
from rwt_rclpy.endpoints.type_variables import MsgType as MsgType
from rwt_rclpy.exceptions import RCLError
from rwt_rclpy.messages.classes import Message

if TYPE_CHECKING:
    from rwt_graph import api
    from rwt_rclpy.endpoints.event_handler import EventHandler
    from rwt_rclpy.endpoints.qos import QoSProfile
    from rwt_rclpy.middleware.link import Link


class Publisher(TopicEndpoint):
    """Publisher of messages of one type, created by :meth:`Node.create_publisher`."""

    def __init__(
        self,
        link: Link,
        publisher: api.Publisher,
        msg_type: type[Message],
        topic: str,
        qos_profile: QoSProfile,
        event_handlers: list[EventHandler],
    ) -> None:
        super().__init__(link, msg_type, topic, qos_profile, event_handlers)
        self._handle = Destroyable(self._close)
        self._publisher = publisher
        self._type = publisher.type
        self._to_graph = msg_type._rwt_to_graph
        self._ended = False

    def _rwt_context_ended(self) -> None:
        """Refuse further messages."""
        self._ended = True

    def _close(self) -> None:
        self._link.post(self._publisher.close)

    def publish(self, msg: Any) -> None:
        """Publish a message, or bytes in CDR.

        Raises:
            TypeError: the message is of another class.
            InvalidHandle: the publisher was destroyed.
            RCLError: the context was shut down.
            InvalidMessage: the CDR does not fit the type.
        """
        if self._ended or not self._handle:
            self._handle.check()
            raise RCLError("Failed to publish: publisher's context is invalid")
        if isinstance(msg, self.msg_type):
            payload = Payload(self._type, self._to_graph(msg))
        elif isinstance(msg, bytes):
            payload = Payload.from_cdr(self._type, msg)
        else:
            raise TypeError(f"Expected {self.msg_type}, got {type(msg)}")
        self._link.publish(self._publisher, payload)
        for handler in self._watching:
            handler.active()

    def get_subscription_count(self) -> int:
        """Return the number of subscriptions that the publisher is connected to."""
        with self._handle:
            return self._link.run(lambda: self._publisher.subscriber_count)

    @property
    def topic_name(self) -> str:
        """Absolute name of the topic."""
        with self._handle:
            return self._publisher.topic

    def assert_liveliness(self) -> None:
        """Assert liveliness, as every message does."""
        self._handle.check()
        for handler in self._watching:
            if handler.event_type is QoSPublisherEventType.RCL_PUBLISHER_LIVELINESS_LOST:
                handler.active()

    def wait_for_all_acked(self, timeout: Duration | None = None) -> bool:
        """Return True: subscriptions have received everything when `publish` returns."""
        with self._handle:
            self._link.run(lambda: None)
            return True
