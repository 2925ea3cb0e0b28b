"""`rclpy.event_handler`: what happens to publishers and subscriptions beside messages.

Deadlines, liveliness, matching and lost messages are told of; see :mod:`rwt_rclpy.endpoints.event_watches`.
No pair of endpoints is incompatible in a graph without DDS, so that those events never come.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, ClassVar

from rwt_rclpy.destroyable import Destroyable
from rwt_rclpy.exceptions import UnsupportedEventTypeError
from rwt_rclpy.execution.entity import Entity

if TYPE_CHECKING:
    from rwt_rclpy.endpoints.event_watches import Watched

__all__ = [
    "EventHandler",
    "PublisherEventCallbacks",
    "SubscriptionEventCallbacks",
    "UnsupportedEventTypeError",
]


class QoSPublisherEventType(IntEnum):
    """What may happen to a publisher."""

    RCL_PUBLISHER_OFFERED_DEADLINE_MISSED = 0
    RCL_PUBLISHER_LIVELINESS_LOST = 1
    RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS = 2
    RCL_PUBLISHER_INCOMPATIBLE_TYPE = 3
    RCL_PUBLISHER_MATCHED = 4


class QoSSubscriptionEventType(IntEnum):
    """What may happen to a subscription."""

    RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED = 0
    RCL_SUBSCRIPTION_LIVELINESS_CHANGED = 1
    RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS = 2
    RCL_SUBSCRIPTION_MESSAGE_LOST = 3
    RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE = 4
    RCL_SUBSCRIPTION_MATCHED = 5


@dataclass
class QoSMessageLostInfo:
    """How many messages a subscription had no room for."""

    total_count: int = 0
    total_count_change: int = 0


@dataclass
class QoSMatchedInfo:
    """How many endpoints of the other side there are."""

    total_count: int = 0
    total_count_change: int = 0
    current_count: int = 0
    current_count_change: int = 0


@dataclass
class QoSIncompatibleInfo:
    """How often quality of service did not fit."""

    total_count: int = 0
    total_count_change: int = 0
    last_policy_kind: int = 0


@dataclass
class QoSDeadlineInfo:
    """How often a deadline was missed."""

    total_count: int = 0
    total_count_change: int = 0


@dataclass
class QoSLivelinessChangedInfo:
    """How many publishers are alive."""

    alive_count: int = 0
    alive_count_change: int = 0
    not_alive_count: int = 0
    not_alive_count_change: int = 0


QoSSubscriptionMatchedInfo = QoSPublisherMatchedInfo = QoSMatchedInfo
QoSRequestedIncompatibleQoSInfo = QoSOfferedIncompatibleQoSInfo = QoSIncompatibleInfo
QoSRequestedDeadlineMissedInfo = QoSOfferedDeadlineMissedInfo = QoSDeadlineInfo
QoSLivelinessLostInfo = QoSDeadlineInfo
IncompatibleTypeInfo = QoSDeadlineInfo

OnEvent = Callable[[Any], object]


class EventHandler(Entity):
    """Calls back with one kind of event."""

    def __init__(
        self, *, callback_group: Any, callback: OnEvent, event_type: IntEnum, parent_impl: Any
    ) -> None:
        super().__init__(callback_group)
        self.callback = callback
        self.event_type = event_type
        self._handle = Destroyable("event")
        self._pending: Any = None

    def active(self) -> None:
        """A message was published or received, or a publisher has said that it is alive."""

    def happened(self, info: Any) -> None:
        """Have the callback called; a newer event takes the place of one that was not taken."""
        self._pending = info
        self.wake()

    def has_work(self) -> bool:
        """Whether an event was not taken yet."""
        return self._pending is not None and bool(self._handle)

    def take(self) -> Callable[[], object] | None:
        """The callback with the event."""
        info, self._pending = self._pending, None
        return None if info is None else lambda: self.callback(info)

    def destroy(self) -> None:
        """Call back no more."""
        self._handle.destroy_when_not_in_use()


QoSEventHandler = EventHandler


class _EventCallbacks:
    """The callbacks for the events of an endpoint."""

    _types: ClassVar[Mapping[str, IntEnum]]

    def __init__(self, *, use_default_callbacks: bool = True, **callbacks: OnEvent | None) -> None:
        for name in callbacks:
            if name not in self._types:
                raise TypeError(f"no such event: {name!r}; there are {', '.join(self._types)}")
        for name in self._types:
            setattr(self, name, callbacks.get(name))
        self.use_default_callbacks = use_default_callbacks

    def create_event_handlers(self, callback_group: Any, watched: Watched) -> list[EventHandler]:
        """A handler for each callback."""
        from rwt_rclpy.endpoints.event_watches import make_handler

        callbacks = ((getattr(self, name), kind) for name, kind in self._types.items())
        return [
            make_handler(callback_group, callback, kind, watched)
            for callback, kind in callbacks
            if callback is not None
        ]


class SubscriptionEventCallbacks(_EventCallbacks):
    """The callbacks for the events of a subscription."""

    _types: ClassVar[Mapping[str, IntEnum]] = {
        "deadline": QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED,
        "liveliness": QoSSubscriptionEventType.RCL_SUBSCRIPTION_LIVELINESS_CHANGED,
        "message_lost": QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST,
        "incompatible_qos": QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS,
        "incompatible_type": QoSSubscriptionEventType.RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE,
        "matched": QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED,
    }


class PublisherEventCallbacks(_EventCallbacks):
    """The callbacks for the events of a publisher."""

    _types: ClassVar[Mapping[str, IntEnum]] = {
        "deadline": QoSPublisherEventType.RCL_PUBLISHER_OFFERED_DEADLINE_MISSED,
        "liveliness": QoSPublisherEventType.RCL_PUBLISHER_LIVELINESS_LOST,
        "incompatible_qos": QoSPublisherEventType.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS,
        "incompatible_type": QoSPublisherEventType.RCL_PUBLISHER_INCOMPATIBLE_TYPE,
        "matched": QoSPublisherEventType.RCL_PUBLISHER_MATCHED,
    }
