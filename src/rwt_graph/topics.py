"""Topics in memory: who publishes, who subscribes, what is kept for late joiners.

A topic exists while it has an endpoint. Its type is established by the first publisher or typed subscriber
and is free again when the last of those has left; a subscriber without a type takes what there is and holds
nothing.

`publish` is the hot path of the whole server: one `Sample`, then one call per subscriber. The subscribers
are a tuple that is replaced when one joins or leaves, so a callback may join and leave as it likes.
Every reliability and deadline is met by a function call, so no combination of QoS is refused.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from rwt_graph.api import EndpointInfo, Publisher, Sample, Subscription, TopicInfo
from rwt_graph.clock import NANOSECONDS, Clock
from rwt_graph.errors import TypeConflict
from rwt_graph.ownership import Owner
from rwt_graph.qos import Durability, History, QoS

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.registry import Registry
    from rwt_interfaces.structs import MessageType

logger = logging.getLogger(__name__)

#: The resource limit of `History.KEEP_ALL` with transient-local durability, in samples per publisher.
KEEP_ALL_LIMIT = 1000

OnSample = Callable[[Sample], None]


def _ignore(_sample: Sample) -> None:
    """What a closed subscription does with a sample that was on its way."""


class Topic:
    """One name and its endpoints."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.type: MessageType | None = None
        self.publishers: tuple[MemoryPublisher, ...] = ()
        self.subscribers: tuple[MemorySubscription, ...] = ()

    @property
    def empty(self) -> bool:
        """Whether nobody is left."""
        return not self.publishers and not self.subscribers

    def establish(self, wanted: MessageType, registry: Registry) -> None:
        """Give the topic its type, or check that it is this one.

        Raises:
            TypeConflict: it is another one.
        """
        if self.type is None:
            self.type = wanted
        elif self.type is not wanted and self.type.name != wanted.name:
            raise TypeConflict(
                f"tried to register topic {self.name} with type {registry.type_name(wanted)} "
                f"but it is already established with type {registry.type_name(self.type)}"
            )

    def release(self) -> None:
        """Free the type when nobody holds it any more."""
        if not self.publishers and not any(s.typed for s in self.subscribers):
            self.type = None


class Kept:
    """What one transient-local publisher keeps for late joiners."""

    def __init__(self, qos: QoS, clock: Clock) -> None:
        depth = KEEP_ALL_LIMIT if qos.history is History.KEEP_ALL else max(1, qos.depth)
        self._samples: deque[Sample] = deque(maxlen=depth)
        self._clock = clock

    def add(self, sample: Sample) -> None:
        """Keep a sample, apart from the receive buffer that it came in."""
        self._forget_expired()
        self._samples.append(sample.detach())

    def samples(self) -> tuple[Sample, ...]:
        """What is kept and not older than the lifespan, oldest first."""
        self._forget_expired()
        return tuple(self._samples)

    def _forget_expired(self) -> None:
        samples = self._samples
        while samples and samples[0].expires_ns and samples[0].expires_ns < self._clock.time_ns():
            samples.popleft()


class MemoryPublisher(Publisher):
    """A publisher of one topic."""

    def __init__(self, topics: Topics, topic: Topic, interface: MessageType, qos: QoS, owner: Owner) -> None:
        self.topic = topic.name
        self.type = interface
        self.qos = qos
        self.node = owner.name
        self._owner = owner
        self._topics = topics
        self._state: Topic | None = topic
        self._now = topics.clock.time_ns
        self._lifespan_ns = round((qos.lifespan or 0) * NANOSECONDS)
        kept = qos.durability is Durability.TRANSIENT_LOCAL
        self.kept: Kept | None = Kept(qos, topics.clock) if kept else None

    def publish(self, payload: Payload) -> None:
        """Hand one message to every subscriber, in the order of the calls."""
        state = self._state
        if state is None:
            return
        if self._lifespan_ns:
            now = self._now()
            sample = Sample(self.topic, payload, now, self.node, now + self._lifespan_ns)
        else:
            sample = Sample(self.topic, payload, self._now(), self.node)
        if self.kept is not None:
            self.kept.add(sample)
        for subscriber in state.subscribers:
            try:
                subscriber.on_sample(sample)
            except Exception:
                logger.exception("a subscriber of %s failed", self.topic)

    @property
    def subscriber_count(self) -> int:
        """How many subscribers are known now."""
        return 0 if self._state is None else len(self._state.subscribers)

    def close(self) -> None:
        """Leave the topic; samples kept for late joiners go with the publisher."""
        state, self._state = self._state, None
        if state is not None:
            self.kept = None
            state.publishers = tuple(p for p in state.publishers if p is not self)
            self._owner.drop(self)
            self._topics.left(state)


class MemorySubscription(Subscription):
    """A subscriber of one topic. `typed` tells whether it came with a type, and so holds the topic's."""

    def __init__(
        self, topics: Topics, topic: Topic, on_sample: OnSample, typed: bool, qos: QoS, owner: Owner
    ) -> None:
        self.topic = topic.name
        self.on_sample = on_sample
        self.typed = typed
        self.qos = qos
        self.node = owner.name
        self._owner = owner
        self._topics = topics
        self._state: Topic | None = topic

    @property
    def type(self) -> MessageType | None:
        """The topic's type; None while there is none, and after `close`."""
        return None if self._state is None else self._state.type

    def history(self) -> tuple[Sample, ...]:
        """What a transient-local subscriber that joins now would receive, in the order of publishing."""
        if self._state is None:
            return ()
        kept = [p.kept.samples() for p in self._state.publishers if p.kept is not None]
        if len(kept) == 1:
            return kept[0]
        return tuple(sorted((s for samples in kept for s in samples), key=lambda s: s.stamp_ns))

    def replay(self) -> None:
        """Deliver the history, unless the subscriber only wants what is new."""
        if self.qos.durability is Durability.VOLATILE:
            return
        for sample in self.history():
            try:
                self.on_sample(sample)
            except Exception:
                logger.exception("a subscriber of %s failed", self.topic)

    def close(self) -> None:
        """Leave the topic; no callback comes after this."""
        state, self._state = self._state, None
        if state is not None:
            self.on_sample = _ignore
            state.subscribers = tuple(s for s in state.subscribers if s is not self)
            self._owner.drop(self)
            self._topics.left(state)


class Topics:
    """Every topic of one graph."""

    def __init__(self, registry: Registry, clock: Clock) -> None:
        self.registry = registry
        self.clock = clock
        self._topics: dict[str, Topic] = {}

    def advertise(self, name: str, interface: MessageType, qos: QoS, owner: Owner) -> MemoryPublisher:
        """Add a publisher. Raises :exc:`TypeConflict`."""
        topic = self._topics.get(name) or Topic(name)
        topic.establish(interface, self.registry)
        self._topics[name] = topic
        publisher = MemoryPublisher(self, topic, interface, qos, owner)
        owner.add(publisher, publisher.close)
        topic.publishers = (*topic.publishers, publisher)
        return publisher

    def subscribe(
        self,
        name: str,
        on_sample: OnSample,
        interface: MessageType | None,
        qos: QoS,
        owner: Owner,
    ) -> MemorySubscription:
        """Add a subscriber and give it what is kept. Raises :exc:`TypeConflict`."""
        topic = self._topics.get(name) or Topic(name)
        if interface is not None:
            topic.establish(interface, self.registry)
        self._topics[name] = topic
        subscription = MemorySubscription(self, topic, on_sample, interface is not None, qos, owner)
        owner.add(subscription, subscription.close)
        topic.subscribers = (*topic.subscribers, subscription)
        subscription.replay()
        return subscription

    def left(self, topic: Topic) -> None:
        """Note that an endpoint of `topic` has gone."""
        topic.release()
        if topic.empty:
            self._topics.pop(topic.name, None)

    def info(self, name: str) -> TopicInfo | None:
        """A snapshot of one topic."""
        topic = self._topics.get(name)
        if topic is None:
            return None
        type_name = "" if topic.type is None else self.registry.type_name(topic.type)
        return TopicInfo(
            name,
            topic.type,
            tuple(EndpointInfo(p.node, type_name, p.qos) for p in topic.publishers),
            tuple(EndpointInfo(s.node, type_name, s.qos) for s in topic.subscribers),
        )

    def names(self) -> list[str]:
        """Every topic's name, sorted."""
        return sorted(self._topics)

    def of_node(self, node: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The names of what a node publishes, and of what it subscribes."""
        publishing = (t.name for t in self._topics.values() if any(p.node == node for p in t.publishers))
        subscribing = (t.name for t in self._topics.values() if any(s.node == node for s in t.subscribers))
        return tuple(sorted(publishing)), tuple(sorted(subscribing))


__all__ = ["KEEP_ALL_LIMIT", "MemoryPublisher", "MemorySubscription", "Topics"]
