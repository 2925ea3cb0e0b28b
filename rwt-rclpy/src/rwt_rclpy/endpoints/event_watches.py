"""Watches of an endpoint for deadlines, liveliness and matching.

Deadlines and leases are due at a time, for which executors wait like for a timer. Changes of the endpoints
of a topic are polled :data:`LOOKS_PER_SECOND` times per second, only while a program has a callback for them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final

from rwt_rclpy.clocks.duration import S_TO_NS, Duration, Infinite
from rwt_rclpy.endpoints.event_handler import (
    EventHandler,
    OnEvent,
    QoSDeadlineInfo,
    QoSLivelinessChangedInfo,
    QoSMatchedInfo,
)
from rwt_rclpy.endpoints.qos import LivelinessPolicy

if TYPE_CHECKING:
    from rwt_rclpy.clocks.timekeeper import Timekeeper
    from rwt_rclpy.endpoints.qos import QoSProfile

#: Rate at which the endpoints of a topic are counted, in Hz.
LOOKS_PER_SECOND: Final = 10


@dataclass(frozen=True, slots=True)
class Watched:
    """Publisher or subscription as seen by handlers of its events.

    Attributes:
        profile: quality of service.
        others: returns the number of endpoints at the other end of its topic.
        timekeeper: source of time.
    """

    profile: QoSProfile
    others: Callable[[], int]
    timekeeper: Timekeeper


class DeadlineHandler(EventHandler):
    """Watch for missed deadlines between messages."""

    def __init__(self, group: Any, callback: OnEvent, kind: IntEnum, watched: Watched) -> None:
        super().__init__(callback_group=group, callback=callback, event_type=kind, parent_impl=watched)
        self._period_ns = watched.profile.deadline.nanoseconds
        self._keeper = watched.timekeeper
        self._next_ns: int | None = None
        self._missed = 0

    def active(self) -> None:
        """Handle a published or received message."""
        waited = self._next_ns is not None
        self._next_ns = self._keeper.steady_ns() + self._period_ns
        if not waited:
            self.wake()

    def has_work(self) -> bool:
        """True if a deadline was missed."""
        return self._next_ns is not None and bool(self._handle) and self._keeper.steady_ns() >= self._next_ns

    def due_in_ns(self) -> int | None:
        """Return the nanoseconds until the deadline; None before the first message."""
        return None if self._next_ns is None else self._next_ns - self._keeper.steady_ns()

    def take(self) -> Callable[[], object] | None:
        """Return the callback with the number of missed deadlines."""
        late = None if self._next_ns is None else self._keeper.steady_ns() - self._next_ns
        if late is None or late < 0 or self._next_ns is None:
            return None
        missed = late // self._period_ns + 1
        self._next_ns += missed * self._period_ns
        self._missed += missed
        info = QoSDeadlineInfo(self._missed, missed)
        return lambda: self.callback(info)


class LeaseHandler(DeadlineHandler):
    """Watch for a publisher that did not assert its liveliness in time."""

    def __init__(self, group: Any, callback: OnEvent, kind: IntEnum, watched: Watched) -> None:
        super().__init__(group, callback, kind, watched)
        self._period_ns = watched.profile.liveliness_lease_duration.nanoseconds

    def take(self) -> Callable[[], object] | None:
        """Return the callback, once for each loss."""
        if not self.has_work():
            return None
        self._next_ns = None
        self._missed += 1
        info = QoSDeadlineInfo(self._missed, 1)
        return lambda: self.callback(info)


class MatchedHandler(EventHandler):
    """Watch for the number of endpoints at the other end of the topic."""

    def __init__(self, group: Any, callback: OnEvent, kind: IntEnum, watched: Watched) -> None:
        super().__init__(callback_group=group, callback=callback, event_type=kind, parent_impl=watched)
        self._others = watched.others
        self._keeper = watched.timekeeper
        self._look_ns = self._keeper.steady_ns()
        self._told = 0
        self._now = 0
        self._total = 0

    def active(self) -> None:
        """No-op: messages do not change the number of endpoints."""

    def has_work(self) -> bool:
        """True if the number of matched endpoints has changed since the last event."""
        now = self._keeper.steady_ns()
        if now >= self._look_ns and self._handle:
            self._look_ns = now + S_TO_NS // LOOKS_PER_SECOND
            self._now = self._others()
        return self._now != self._told and bool(self._handle)

    def due_in_ns(self) -> int | None:
        """Return the nanoseconds until the next poll."""
        return self._look_ns - self._keeper.steady_ns() if self._handle else None

    def take(self) -> Callable[[], object] | None:
        """Return the callback with the new number."""
        change, self._told = self._now - self._told, self._now
        if not change:
            return None
        info = self._info(self._now, change)
        return lambda: self.callback(info)

    def _info(self, now: int, change: int) -> Any:
        more = max(0, change)
        self._total += more
        return QoSMatchedInfo(self._total, more, now, change)


class LivelinessHandler(MatchedHandler):
    """Watch for the number of live publishers, which is that of existing ones."""

    def _info(self, now: int, change: int) -> Any:
        return QoSLivelinessChangedInfo(now, change, 0, 0)


def _is_a_span(duration: Duration) -> bool:
    """True if a duration is finite: 0 and infinity mean none."""
    return 0 < duration.nanoseconds < Infinite.nanoseconds


def make_handler(group: Any, callback: OnEvent, kind: IntEnum, watched: Watched) -> EventHandler:
    """Return the handler of a kind of event; it never calls if the profile does not request the event."""
    profile = watched.profile
    made: type[DeadlineHandler] | type[MatchedHandler] | None = None
    # By name: events of publishers and of subscriptions share numbers, and so are equal.
    match kind.name:
        case "RCL_PUBLISHER_OFFERED_DEADLINE_MISSED" | "RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED":
            made = DeadlineHandler if _is_a_span(profile.deadline) else None
        case "RCL_PUBLISHER_LIVELINESS_LOST":
            by_hand = profile.liveliness is LivelinessPolicy.MANUAL_BY_TOPIC
            made = LeaseHandler if by_hand and _is_a_span(profile.liveliness_lease_duration) else None
        case "RCL_SUBSCRIPTION_LIVELINESS_CHANGED":
            made = LivelinessHandler
        case "RCL_PUBLISHER_MATCHED" | "RCL_SUBSCRIPTION_MATCHED":
            made = MatchedHandler
    if made is None:
        return EventHandler(callback_group=group, callback=callback, event_type=kind, parent_impl=watched)
    return made(group, callback, kind, watched)
