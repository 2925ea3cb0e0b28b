"""A graph in memory with a journal of every message that is published."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from rwt_graph.api import (
    ClientGoal,
    GoalEvents,
    OnReply,
    Participant,
    PendingCall,
    Publisher,
    Registration,
    Sample,
    ServerGoal,
    ServiceCall,
    Subscription,
)
from rwt_graph.memory.graph import MemoryGraph
from rwt_program.qos import BEST_AVAILABLE, DEFAULT_QOS, QoS
from rwt_testing.journal import Journal, Kind, Received

if TYPE_CHECKING:
    from rwt_graph.clock import Clock
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.registry import Registry
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType


class ObservedGraph(MemoryGraph):
    """A :class:`~rwt_graph.memory.graph.MemoryGraph` with a journal.

    Attributes:
        journal: every message that nodes and clients published, and what scripted robots add.
        unobserved: absolute names of nodes whose messages are not noted: those of the scripted robots.

    Args:
        registry: the interfaces; the standard ones of jazzy by default.
        clock: the wall clock by default.
    """

    def __init__(self, registry: Registry | None = None, clock: Clock | None = None) -> None:
        super().__init__(registry, clock)
        self.journal = Journal()
        self.unobserved: set[str] = set()

    def participant(self, name: str) -> Participant:
        """Join as a node of that absolute name."""
        inner = super().participant(name)
        if inner.name in self.unobserved:
            return inner
        return _ObservedParticipant(inner, self.journal, self.clock)


class _ObservedParticipant(Participant):
    """A participant whose publishers note their messages."""

    def __init__(self, inner: Participant, journal: Journal, clock: Clock) -> None:
        self.name = inner.name
        self._inner = inner
        self._journal = journal
        self._clock = clock

    def advertise(self, topic: str, type: MessageType, qos: QoS = DEFAULT_QOS) -> Publisher:
        inner = self._inner.advertise(topic, type, qos)
        return _ObservedPublisher(inner, self.name, self._journal, self._clock.time_ns)

    def subscribe(
        self,
        topic: str,
        on_sample: Callable[[Sample], None],
        type: MessageType | None = None,
        qos: QoS = BEST_AVAILABLE,
    ) -> Subscription:
        return self._inner.subscribe(topic, on_sample, type, qos)

    def advertise_service(
        self, service: str, type: ServiceType, on_call: Callable[[ServiceCall], None]
    ) -> Registration:
        return self._inner.advertise_service(service, type, on_call)

    def call_service(
        self, service: str, request: Payload, on_reply: OnReply, timeout: float | None = None
    ) -> PendingCall:
        return self._inner.call_service(service, request, on_reply, timeout)

    def advertise_action(
        self, action: str, type: ActionType, on_goal: Callable[[ServerGoal], None]
    ) -> Registration:
        return self._inner.advertise_action(action, type, on_goal)

    def send_goal(
        self, action: str, goal: Payload, events: GoalEvents, goal_id: str | None = None
    ) -> ClientGoal:
        return self._inner.send_goal(action, goal, events, goal_id)

    def cancel_goal(self, action: str, goal_id: str) -> None:
        self._inner.cancel_goal(action, goal_id)

    def close(self) -> None:
        self._inner.close()


class _ObservedPublisher(Publisher):
    """Notes a message before it is delivered, so that code that reacts to it finds it in the journal."""

    def __init__(self, inner: Publisher, node: str, journal: Journal, now_ns: Callable[[], int]) -> None:
        self.topic = inner.topic
        self.type = inner.type
        self.qos = inner.qos
        self._inner = inner
        self._node = node
        self._journal = journal
        self._now_ns = now_ns

    def publish(self, payload: Payload) -> None:
        kept = payload.detach()
        self._journal.add(Received(Kind.MESSAGE, self.topic, kept, self._node, self._now_ns()))
        self._inner.publish(payload)

    @property
    def subscriber_count(self) -> int:
        return self._inner.subscriber_count

    def close(self) -> None:
        self._inner.close()
