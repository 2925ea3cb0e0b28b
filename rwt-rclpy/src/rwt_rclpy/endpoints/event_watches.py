"""Endpoints of topics, and watches of them for deadlines, liveliness and matching.

Deadlines and leases are due at a time, for which executors wait like for a timer. Changes of the endpoints
of a topic are polled :data:`LOOKS_PER_SECOND` times per second, only while a program has a callback for them.
Incompatible endpoints are noticed when the executor next wakes after a change of the graph.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final

from rwt_rclpy.clocks.duration import S_TO_NS, Duration, Infinite
from rwt_rclpy.destroyable import Closable
from rwt_rclpy.endpoints.event_handler import (
    EventHandler,
    LostHandler,
    OnEvent,
    QoSDeadlineInfo,
    QoSIncompatibleInfo,
    QoSLivelinessChangedInfo,
    QoSMatchedInfo,
)
from rwt_rclpy.endpoints.qos import LivelinessPolicy, QoSPolicyKind, graph_qos

if TYPE_CHECKING:
    from rwt_rclpy.clocks.timekeeper import Timekeeper
    from rwt_rclpy.endpoints.qos import QoSProfile
    from rwt_rclpy.logs.logger import RcutilsLogger
    from rwt_rclpy.messages.classes import Message
    from rwt_rclpy.middleware.link import Link
    from rwt_rclpy.nodes.graph_queries import GraphQueries

#: Rate at which the endpoints of a topic are counted, in Hz.
LOOKS_PER_SECOND: Final = 10


@dataclass(frozen=True, slots=True)
class Watched:
    """Publisher or subscription as seen by handlers of its events.

    Attributes:
        profile: quality of service.
        name: the absolute name of its topic.
        topic: the name that was asked for.
        publishers: True if it is a subscription, whose others are publishers.
        queries: answers questions about the graph.
        timekeeper: source of time.
        logger: the logger of its node.
    """

    profile: QoSProfile
    name: str
    topic: str
    publishers: bool
    queries: GraphQueries
    timekeeper: Timekeeper
    logger: RcutilsLogger

    def incompatible(self) -> list[tuple[str, ...]]:
        """Return the incompatible policies of each endpoint that it is not connected to."""
        return self.queries.incompatible(self.name, graph_qos(self.profile), publishers=self.publishers)

    def matched(self) -> int:
        """Return the number of endpoints that it is connected to."""
        return len(self.queries.ends(self.name, publishers=self.publishers)) - len(self.incompatible())

    def warn_of_incompatible(self, event: QoSIncompatibleInfo) -> None:
        """Log a warning about an endpoint that it is not connected to."""
        other, verb, way = (
            ("publisher", "offering", "received from")
            if self.publishers
            else ("subscription", "requesting", "sent to")
        )
        self.logger.warning(
            f"New {other} discovered on topic '{self.topic}', {verb} incompatible QoS."
            f" No messages will be {way} it."
            f" Last incompatible policy: {QoSPolicyKind(event.last_policy_kind).name}"
        )


class DeadlineHandler(EventHandler):
    """Watch for missed deadlines between messages."""

    _policy = "deadline"

    def __init__(self, *, parent_impl: Watched, **handler: Any) -> None:
        super().__init__(parent_impl=parent_impl, **handler)
        watched = parent_impl
        self._period_ns = getattr(watched.profile, self._policy).nanoseconds
        self._keeper = watched.timekeeper
        self._next_ns: int | None = None
        self._missed = 0

    def active(self) -> None:
        """Handle a published or received message."""
        waited = self._next_ns is not None
        self._next_ns = self._keeper.steady_ns() + self._period_ns
        if not waited:
            self._rwt_wake()

    def _rwt_has_work(self) -> bool:
        """True if a deadline was missed."""
        return self._next_ns is not None and bool(self._handle) and self._keeper.steady_ns() >= self._next_ns

    def _rwt_due_in_ns(self) -> int | None:
        """Return the nanoseconds until the deadline; None before the first message."""
        return None if self._next_ns is None else self._next_ns - self._keeper.steady_ns()

    def _rwt_take(self) -> Callable[[], object] | None:
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

    _policy = "liveliness_lease_duration"

    def _rwt_take(self) -> Callable[[], object] | None:
        """Return the callback, once for each loss."""
        if not self._rwt_has_work():
            return None
        self._next_ns = None
        self._missed += 1
        info = QoSDeadlineInfo(self._missed, 1)
        return lambda: self.callback(info)


class MatchedHandler(EventHandler):
    """Watch for the number of endpoints at the other end of the topic."""

    def __init__(self, *, parent_impl: Watched, **handler: Any) -> None:
        super().__init__(parent_impl=parent_impl, **handler)
        watched = parent_impl
        self._others = watched.matched
        self._keeper = watched.timekeeper
        self._look_ns = self._keeper.steady_ns()
        self._told = 0
        self._now = 0
        self._total = 0

    def _rwt_has_work(self) -> bool:
        """True if the number of matched endpoints has changed since the last event."""
        now = self._keeper.steady_ns()
        if now >= self._look_ns and self._handle:
            self._look_ns = now + S_TO_NS // LOOKS_PER_SECOND
            self._now = self._others()
        return self._now != self._told and bool(self._handle)

    def _rwt_due_in_ns(self) -> int | None:
        """Return the nanoseconds until the next poll."""
        return self._look_ns - self._keeper.steady_ns() if self._handle else None

    def _rwt_take(self) -> Callable[[], object] | None:
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


class IncompatibleHandler(EventHandler):
    """Reports endpoints with incompatible quality of service."""

    def __init__(self, *, parent_impl: Watched, **handler: Any) -> None:
        super().__init__(parent_impl=parent_impl, **handler)
        watched = parent_impl
        self._watched = watched
        self._version = -1
        self._now = 0
        self._total = 0
        self._told = 0

    def _rwt_has_work(self) -> bool:
        """True if an incompatible endpoint has joined since the last event."""
        version = self._watched.queries.version
        if version != self._version:
            self._version = version
            self._look()
        return super()._rwt_has_work()

    def _look(self) -> None:
        found = self._watched.incompatible()
        joined, self._now = len(found) - self._now, len(found)
        if joined > 0:
            self._total += joined
            kind = QoSPolicyKind[found[-1][-1].upper()]
            self._pending = QoSIncompatibleInfo(self._total, self._total - self._told, kind)

    def _rwt_take(self) -> Callable[[], object] | None:
        """Return the callback with the number of incompatible endpoints."""
        self._told = self._total
        return super()._rwt_take()


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
    made: type[EventHandler] = EventHandler
    # By name: events of publishers and of subscriptions share numbers, and so are equal.
    match kind.name:
        case "RCL_PUBLISHER_OFFERED_DEADLINE_MISSED" | "RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED":
            made = DeadlineHandler if _is_a_span(profile.deadline) else EventHandler
        case "RCL_PUBLISHER_LIVELINESS_LOST":
            by_hand = profile.liveliness is LivelinessPolicy.MANUAL_BY_TOPIC
            is_leased = by_hand and _is_a_span(profile.liveliness_lease_duration)
            made = LeaseHandler if is_leased else EventHandler
        case "RCL_SUBSCRIPTION_LIVELINESS_CHANGED":
            made = LivelinessHandler if _is_a_span(profile.liveliness_lease_duration) else EventHandler
        case "RCL_PUBLISHER_MATCHED" | "RCL_SUBSCRIPTION_MATCHED":
            made = MatchedHandler
        case "RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS" | "RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS":
            made = IncompatibleHandler
        case "RCL_SUBSCRIPTION_MESSAGE_LOST":
            made = LostHandler
    return made(callback_group=group, callback=callback, event_type=kind, parent_impl=watched)


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
