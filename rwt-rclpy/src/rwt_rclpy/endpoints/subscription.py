"""`rclpy.subscription`."""

from __future__ import annotations

import inspect
from collections import deque
from collections.abc import Callable, Sequence
from enum import Enum
from typing import TYPE_CHECKING, Any, NotRequired, TypedDict

from rwt_interfaces.errors import InvalidMessage
from rwt_rclpy.destroyable import Destroyable
from rwt_rclpy.endpoints.content_filter import ContentFilter, ContentFilterOptions, InvalidFilter
from rwt_rclpy.endpoints.event_handler import EventHandler, QoSMessageLostInfo
from rwt_rclpy.endpoints.event_watches import TopicEndpoint
from rwt_rclpy.endpoints.events import QoSSubscriptionEventType
from rwt_rclpy.endpoints.qos import HistoryPolicy, QoSProfile
from rwt_rclpy.endpoints.type_variables import MsgType as MsgType
from rwt_rclpy.exceptions import RCLError
from rwt_rclpy.execution.entity import Entity
from rwt_rclpy.logs.logger import get_logger
from rwt_rclpy.messages.classes import Message
from rwt_rclpy.middleware.topic_endpoint_info import TopicEndpointTypeEnum, endpoint_gid
from rwt_rclpy.release import FROM_KILTED

if TYPE_CHECKING:
    from rwt_graph.api import Sample
    from rwt_interfaces.payload import Payload
    from rwt_rclpy.middleware.link import Link

#: Maximum number of queued messages with `KEEP_ALL`.
KEEP_ALL_LIMIT = 100_000


class MessageInfo(TypedDict):
    """Metadata of a message: times in nanoseconds since the epoch, sequence numbers, and from Kilted on the
    id of the publisher, that of its node's first publisher on the topic.
    """

    source_timestamp: int
    received_timestamp: int
    publication_sequence_number: int | None
    reception_sequence_number: int | None
    publisher_gid: NotRequired[dict[str, str | bytes]]


class CallbackType(Enum):
    """Arguments of a callback: the message, or message and metadata."""

    MessageOnly = 0
    WithMessageInfo = 1


class Subscription(Entity, TopicEndpoint):
    """Subscription of messages of one type, created by :meth:`Node.create_subscription`.

    Attributes:
        raw: True if the callback gets CDR.
        qos_profile: quality of service; its depth limits the queue of the executor.
    """

    CallbackType = CallbackType

    def __init__(
        self,
        link: Link,
        msg_type: type[Message],
        topic: str,
        callback: Callable[..., object],
        callback_group: Any,
        qos_profile: QoSProfile,
        raw: bool,
        event_handlers: list[EventHandler],
        publisher_count: Callable[[], int],
        content_filter: ContentFilterOptions | None = None,
    ) -> None:
        Entity.__init__(self, callback_group)
        TopicEndpoint.__init__(self, link, msg_type, topic, qos_profile, event_handlers)
        self._handle = Destroyable(self._close)
        self._from_graph = msg_type._rwt_from_graph
        self._subscription: Any = None
        keep_all = qos_profile.history is HistoryPolicy.KEEP_ALL
        self._samples: deque[tuple[Sample, int]] = deque(
            maxlen=KEEP_ALL_LIMIT if keep_all else max(1, qos_profile.depth)
        )
        self._received = 0
        self._lost = 0
        self._callback = callback
        self._callback_type = _callback_type(callback)
        self.raw = raw
        self._publisher_count = publisher_count
        self._filter: ContentFilter | None = None
        if content_filter is not None:
            self.set_content_filter(
                content_filter.filter_expression, content_filter.expression_parameters or ()
            )

    def _rwt_opened(self, subscription: Any) -> None:
        """Set the endpoint of the graph."""
        self._subscription = subscription

    def _close(self) -> None:
        if self._subscription is not None:
            self._link.post(self._subscription.close)
        self._samples.clear()

    @property
    def callback(self) -> Callable[..., object]:
        """Callback of the subscription; writable."""
        return self._callback

    @callback.setter
    def callback(self, callback: Callable[..., object]) -> None:
        self._callback_type = _callback_type(callback)
        self._callback = callback

    @property
    def topic_name(self) -> str:
        """Absolute name of the topic."""
        with self._handle:
            name: str = self._subscription.topic
            return name

    def get_publisher_count(self) -> int:
        """Return the number of publishers that the subscription is connected to."""
        with self._handle:
            return self._publisher_count()

    def _rwt_on_sample(self, sample: Sample) -> None:
        """Queue a sample for the executor, on the graph's thread."""
        samples = self._samples
        if len(samples) == samples.maxlen:
            self._lost += 1
            self._tell_of_loss()
        self._received += 1
        samples.append((sample.detach(), self._received))
        for handler in self._watching:
            handler.active()
        self._rwt_wake()

    def _tell_of_loss(self) -> None:
        for handler in self.event_handlers:
            if handler.event_type is QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST:
                handler.happened(QoSMessageLostInfo(self._lost, 1))

    if FROM_KILTED:

        @property
        def is_cft_enabled(self) -> bool:
            """True if a content filter is set."""
            return self._filter is not None

        def set_content_filter(
            self, filter_expression: str, expression_parameters: Sequence[str] = ()
        ) -> None:
            """Set a DDS expression that messages must match; an empty one removes the filter.

            Raises:
                InvalidFilter: the expression is invalid, or names an unknown field.
                InvalidHandle: the subscription was destroyed.
            """
            self._handle.check()
            fields = frozenset(self.msg_type.get_fields_and_field_types())
            wanted = filter_expression.strip()
            self._filter = ContentFilter(wanted, expression_parameters, fields) if wanted else None

        def get_content_filter(self) -> ContentFilterOptions:
            """Return the content filter. Raises RCLError if none is set."""
            self._handle.check()
            if self._filter is None:
                raise RCLError(f"the subscription to {self.topic} has no content filter")
            return ContentFilterOptions(self._filter.expression, list(self._filter.parameters))

    def _is_wanted(self, wanted: ContentFilter, payload: Payload) -> bool:
        try:
            return wanted.matches(payload.value())
        except InvalidFilter as error:
            get_logger("rclpy").error(f"a message on {self.topic} is left out: {error}")
            return False

    # Interface of executors

    def _rwt_has_work(self) -> bool:
        """True if a message is pending."""
        return bool(self._samples)

    def _rwt_take(self) -> Callable[[], object] | None:
        """Return the callback with the oldest message that has not expired."""
        taken = self._take()
        if taken is None:
            return None
        callback = self._callback
        if self._callback_type is CallbackType.MessageOnly:
            message = taken[0]
            return lambda: callback(message)
        return lambda: callback(*taken)

    def _take(self) -> tuple[Any, MessageInfo] | None:
        keeper = self._link.timekeeper
        while True:
            try:
                sample, number = self._samples.popleft()
            except IndexError:
                return None
            if sample.expires_ns and sample.expires_ns < keeper.system_ns():
                continue
            try:
                payload = sample.payload
                if self._filter is not None and not self._is_wanted(self._filter, payload):
                    continue
                message = payload.cdr() if self.raw else self._from_graph(payload.value())
            except InvalidMessage as error:
                get_logger("rclpy").error(f"a message on {sample.topic} does not fit its type: {error}")
                continue
            info: MessageInfo = {
                "source_timestamp": sample.stamp_ns,
                "received_timestamp": keeper.system_ns(),
                "publication_sequence_number": number,
                "reception_sequence_number": None,
            }
            if FROM_KILTED and self._callback_type is CallbackType.WithMessageInfo:
                gid = endpoint_gid(sample.node, sample.topic, TopicEndpointTypeEnum.PUBLISHER)
                info["publisher_gid"] = {"implementation_identifier": "rwt_graph", "data": gid}
            return message, info


def _callback_type(callback: Callable[..., object]) -> CallbackType:
    """Return the type of a callback by its number of arguments. Raises RuntimeError for other numbers."""
    try:
        signature = inspect.signature(callback)
    except (TypeError, ValueError):
        return CallbackType.MessageOnly
    for arguments, kind in (
        ((None,), CallbackType.MessageOnly),
        ((None, None), CallbackType.WithMessageInfo),
    ):
        try:
            signature.bind(*arguments)
        except TypeError:
            continue
        return kind
    raise RuntimeError(
        "Subscription.__init__(): callback should be either be callable with one argument (to get only the"
        " message) or two (to get message and message info)"
    )
