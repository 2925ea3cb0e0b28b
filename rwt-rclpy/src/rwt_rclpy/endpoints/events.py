"""`rclpy.event_handler`: events of publishers and subscriptions besides messages.

See :mod:`rwt_rclpy.endpoints.event_watches`. A topic has one type: events of incompatible types never come.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import TYPE_CHECKING, Any, ClassVar

from rwt_rclpy.endpoints.event_handler import (
    EventHandler,
    OnEvent,
    QoSDeadlineInfo,
    QoSIncompatibleInfo,
    QoSLivelinessChangedInfo,
    QoSMatchedInfo,
    QoSMessageLostInfo,
)
from rwt_rclpy.endpoints.event_watches import Watched, make_handler
from rwt_rclpy.exceptions import UnsupportedEventTypeError

if TYPE_CHECKING:
    from rwt_rclpy.endpoints.event_watches import Watched

__all__ = [
    "EventHandler",
    "PublisherEventCallbacks",
    "QoSLivelinessChangedInfo",
    "QoSMessageLostInfo",
    "SubscriptionEventCallbacks",
    "UnsupportedEventTypeError",
]


class QoSPublisherEventType(IntEnum):
    """Events of a publisher."""

    RCL_PUBLISHER_OFFERED_DEADLINE_MISSED = 0
    RCL_PUBLISHER_LIVELINESS_LOST = 1
    RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS = 2
    RCL_PUBLISHER_INCOMPATIBLE_TYPE = 3
    RCL_PUBLISHER_MATCHED = 4


class QoSSubscriptionEventType(IntEnum):
    """Events of a subscription."""

    RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED = 0
    RCL_SUBSCRIPTION_LIVELINESS_CHANGED = 1
    RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS = 2
    RCL_SUBSCRIPTION_MESSAGE_LOST = 3
    RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE = 4
    RCL_SUBSCRIPTION_MATCHED = 5


QoSSubscriptionMatchedInfo = QoSPublisherMatchedInfo = QoSMatchedInfo
QoSRequestedIncompatibleQoSInfo = QoSOfferedIncompatibleQoSInfo = QoSIncompatibleInfo
QoSRequestedDeadlineMissedInfo = QoSOfferedDeadlineMissedInfo = QoSDeadlineInfo
QoSLivelinessLostInfo = QoSDeadlineInfo
IncompatibleTypeInfo = QoSDeadlineInfo

QoSEventHandler = EventHandler


class _EventCallbacks:
    """Callbacks for the events of an endpoint."""

    _types: ClassVar[Mapping[str, IntEnum]]

    def __init__(self, *, use_default_callbacks: bool = True, **callbacks: OnEvent | None) -> None:
        for name in callbacks:
            if name not in self._types:
                raise TypeError(f"no such event: {name!r}; there are {', '.join(self._types)}")
        for name in self._types:
            setattr(self, name, callbacks.get(name))
        self.use_default_callbacks = use_default_callbacks

    def create_event_handlers(self, callback_group: Any, watched: Watched) -> list[EventHandler]:
        """Return a handler for each callback."""
        defaults = {}
        if self.use_default_callbacks:
            defaults = {"incompatible_qos": watched.warn_of_incompatible, "incompatible_type": _ignore}
        callbacks = ((getattr(self, name) or defaults.get(name), kind) for name, kind in self._types.items())
        return [
            make_handler(callback_group, callback, kind, watched)
            for callback, kind in callbacks
            if callback is not None
        ]


def _ignore(event: object) -> None:
    """No-op."""


class SubscriptionEventCallbacks(_EventCallbacks):
    """Callbacks for the events of a subscription."""

    _types: ClassVar[Mapping[str, IntEnum]] = {
        "deadline": QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED,
        "liveliness": QoSSubscriptionEventType.RCL_SUBSCRIPTION_LIVELINESS_CHANGED,
        "message_lost": QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST,
        "incompatible_qos": QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS,
        "incompatible_type": QoSSubscriptionEventType.RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE,
        "matched": QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED,
    }


class PublisherEventCallbacks(_EventCallbacks):
    """Callbacks for the events of a publisher."""

    _types: ClassVar[Mapping[str, IntEnum]] = {
        "deadline": QoSPublisherEventType.RCL_PUBLISHER_OFFERED_DEADLINE_MISSED,
        "liveliness": QoSPublisherEventType.RCL_PUBLISHER_LIVELINESS_LOST,
        "incompatible_qos": QoSPublisherEventType.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS,
        "incompatible_type": QoSPublisherEventType.RCL_PUBLISHER_INCOMPATIBLE_TYPE,
        "matched": QoSPublisherEventType.RCL_PUBLISHER_MATCHED,
    }
