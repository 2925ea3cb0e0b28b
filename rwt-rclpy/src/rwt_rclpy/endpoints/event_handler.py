"""Events of an endpoint, and their handlers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from rwt_rclpy.destroyable import Destroyable, Owner
from rwt_rclpy.execution.entity import Entity


@dataclass
class _Total:
    total_count: int = 0
    total_count_change: int = 0


@dataclass
class QoSMessageLostInfo(_Total):
    """Number of messages that a subscription dropped."""


@dataclass
class QoSMatchedInfo(_Total):
    """Number of matched endpoints."""

    current_count: int = 0
    current_count_change: int = 0


@dataclass
class QoSIncompatibleInfo(_Total):
    """Number of endpoints with incompatible quality of service."""

    last_policy_kind: int = 0


@dataclass
class QoSDeadlineInfo(_Total):
    """Number of missed deadlines."""


@dataclass
class QoSLivelinessChangedInfo:
    """Number of publishers that are alive."""

    alive_count: int = 0
    alive_count_change: int = 0
    not_alive_count: int = 0
    not_alive_count_change: int = 0


OnEvent = Callable[[Any], object]


class EventHandler(Entity, Owner):
    """Handler of one kind of event."""

    def __init__(
        self, *, callback_group: Any, callback: OnEvent, event_type: IntEnum, parent_impl: Any
    ) -> None:
        super().__init__(callback_group)
        self.callback = callback
        self.event_type = event_type
        self._handle = Destroyable()
        self._pending: Any = None

    def happened(self, info: Any) -> None:
        """Schedule the callback; a newer event replaces a pending one."""
        self._pending = info
        self._rwt_wake()

    def _rwt_has_work(self) -> bool:
        """True if an event is pending."""
        return self._pending is not None and bool(self._handle)

    def _rwt_take(self) -> Callable[[], object] | None:
        """Return the callback with the event."""
        info, self._pending = self._pending, None
        return None if info is None else lambda: self.callback(info)


class LostHandler(EventHandler):
    """Reports dropped messages."""
