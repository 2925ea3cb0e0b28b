"""Topics in memory: publishers, subscribers, and samples retained for late joiners.

A topic exists while it has an endpoint. Its type is established by the first publisher or typed subscriber,
and is free again when the last of those has left. A subscriber without a type does not establish one.

The robot comes first: endpoints of nodes for clients establish a type for other such endpoints only. When an
endpoint of the robot brings another type, here or in another process, theirs are displaced.

`publish` is the hot path of the whole server: one `Sample`, then one call per subscriber. The subscribers
are a tuple that is replaced when one joins or leaves, so callbacks may join and leave. A function call meets
every reliability and deadline, so all combinations of QoS are compatible, unless DDS's rules are followed.

A topic may have endpoints in other processes (:class:`RemoteEndpoint`). Remote publishers hold its type as
local ones do. Remote subscribers do not: they may have taken it from this process, and two processes would
keep each other's type established forever. They only prevent that the first publisher has another type, and
displace clients' endpoints of another type.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from operator import is_not
from typing import Protocol

from rwt_graph.api import EndpointInfo, Publisher, Sample, Subscription, TopicInfo
from rwt_graph.clock import Clock
from rwt_graph.errors import TypeConflict
from rwt_graph.memory.tables import Changes, NodeResources, displace
from rwt_graph.names import is_for_clients
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.qos import Durability, History, QoS, incompatible_policies

logger = logging.getLogger(__name__)

#: Maximum retained samples per publisher with `History.KEEP_ALL` and transient-local durability.
KEEP_ALL_LIMIT = 1000

OnSample = Callable[[Sample], None]


def _ignore(_sample: Sample) -> None:
    """Drop a sample that was in delivery when its subscription closed."""


#: Maximum serialised bytes of large retained messages whose converted forms are cached.
_CACHED_BYTES = 16 * 1024 * 1024
_LARGE_BYTES = 64 * 1024


class LatelyRead:
    """Large retained messages that were read last; all others keep only one form.

    A message that was read in every encoding takes ten times its original memory.
    """

    def __init__(self) -> None:
        self._payloads: dict[Payload, int] = {}
        self._size = 0

    def note(self, payload: Payload) -> None:
        """Note that a retained message was read or made."""
        known = self._payloads.pop(payload, None)
        if known is None:
            known = payload.kept_size
            if known < _LARGE_BYTES:
                return
            self._size += known
        self._payloads[payload] = known
        while self._size > _CACHED_BYTES and len(self._payloads) > 1:
            oldest = next(iter(self._payloads))
            self._size -= self._payloads.pop(oldest)
            oldest.forget_forms()

    def forget(self, payload: Payload) -> None:
        self._size -= self._payloads.pop(payload, 0)


class TransientLocalCache:
    """Samples that one transient-local publisher retains for late joiners."""

    def __init__(self, qos: QoS, clock: Clock, lately_read: LatelyRead | None = None) -> None:
        depth = KEEP_ALL_LIMIT if qos.history is History.KEEP_ALL else max(1, qos.depth)
        self._samples: deque[Sample] = deque(maxlen=depth)
        self._lately_read = lately_read or LatelyRead()
        self._clock = clock

    def add(self, sample: Sample) -> None:
        """Retain a sample, detached from its receive buffer."""
        self._forget_expired()
        if len(self._samples) == self._samples.maxlen:
            self._lately_read.forget(self._samples.popleft().payload)
        kept = sample.detach()
        self._lately_read.note(kept.payload)
        self._samples.append(kept)

    def samples(self) -> tuple[Sample, ...]:
        """Return the retained samples within the lifespan, oldest first."""
        self._forget_expired()
        for sample in self._samples:
            self._lately_read.note(sample.payload)
        return tuple(self._samples)

    def clear(self) -> None:
        while self._samples:
            self._lately_read.forget(self._samples.popleft().payload)

    def _forget_expired(self) -> None:
        samples = self._samples
        while samples and samples[0].expires_ns and samples[0].expires_ns < self._clock.time_ns():
            self._lately_read.forget(samples.popleft().payload)


@dataclass(eq=False, slots=True)
class RemoteEndpoint:
    """Publisher or subscription in another process.

    Attributes:
        type_name: name of its type, as the distribution writes it.
        type: message type; None if the registry does not know it.
        cache: samples of a transient-local publisher, while this process subscribes to it.
    """

    node: str
    type_name: str
    type: MessageType | None
    qos: QoS
    cache: TransientLocalCache | None = None

    @property
    def for_clients(self) -> bool:
        """True if its node acts for clients of a server."""
        return is_for_clients(self.node)


def received_sample(topic: str, payload: Payload, stamp_ns: int, publisher: RemoteEndpoint | None) -> Sample:
    """Return a sample of another process, with the lifespan that its publisher offers."""
    if publisher is None:
        return Sample(topic, payload, stamp_ns, "")
    lifespan = publisher.qos.lifespan
    expires = stamp_ns + round(lifespan * NANOSECONDS) if lifespan else 0
    return Sample(topic, payload, stamp_ns, publisher.node, expires)


class RemoteTopics(Protocol):
    """Announcer of this process's topics to others."""

    def changed(self, topic: Topic) -> None:
        """Called when an endpoint of this process joined or left, or the topic's type changed."""


class Topic:
    """Topic with its endpoints.

    Attributes:
        is_reserved: True if samples of other processes are ignored.
    """

    def __init__(self, name: str, *, is_reserved: bool = False) -> None:
        self.name = name
        self.is_reserved = is_reserved
        self.type: MessageType | None = None
        self.publishers: tuple[MemoryPublisher, ...] = ()
        self.subscribers: tuple[MemorySubscription, ...] = ()
        self.remote_publishers: tuple[RemoteEndpoint, ...] = ()
        self.remote_subscribers: tuple[RemoteEndpoint, ...] = ()
        self._info: TopicInfo | None = None
        self._info_of: tuple[object, ...] = ()

    def info(self, registry: Registry) -> TopicInfo:
        parts = (
            self.known_type,
            self.publishers,
            self.subscribers,
            self.remote_publishers,
            self.remote_subscribers,
        )
        if self._info is None or any(map(is_not, parts, self._info_of)):
            self._info = self._make_info(registry)
            self._info_of = parts
        return self._info

    def _make_info(self, registry: Registry) -> TopicInfo:
        known = self.known_type
        type_name = "" if known is None else registry.type_name(known)
        publishers = tuple(EndpointInfo(p.node, type_name, p.qos) for p in self.publishers)
        subscribers = tuple(EndpointInfo(s.node, type_name, s.qos) for s in self.subscribers)
        return TopicInfo(
            self.name,
            known,
            publishers + tuple(EndpointInfo(p.node, p.type_name, p.qos) for p in self.remote_publishers),
            subscribers + tuple(EndpointInfo(s.node, s.type_name, s.qos) for s in self.remote_subscribers),
        )

    @property
    def empty(self) -> bool:
        return not (self.publishers or self.subscribers or self.remote_publishers or self.remote_subscribers)

    @property
    def known_type(self) -> MessageType | None:
        """Return the type, or else that of a remote subscriber, the robot's before the clients'."""
        if self.type is not None:
            return self.type
        announced = [s for s in self.remote_subscribers if s.type is not None]
        of_robot = (s.type for s in announced if not s.for_clients)
        return next(of_robot, announced[0].type if announced else None)

    @property
    def _local(self) -> tuple[MemoryPublisher | MemorySubscription, ...]:
        return (*self.publishers, *self.subscribers)

    def _held_by_robot(self) -> list[MessageType]:
        """Return the types that endpoints of the robot hold: those of this process, or else publishers."""
        local = [
            end.held_type for end in self._local if end.held_type is not None and not end.is_displaceable
        ]
        return local or [p.type for p in self.remote_publishers if p.type is not None and not p.for_clients]

    def _held_by_clients(self) -> list[MessageType]:
        local = [end.held_type for end in self.of_clients]
        remote = [p.type for p in self.remote_publishers if p.for_clients]
        return [type for type in (*local, *remote) if type is not None]

    def _announced_by_robot(self) -> MessageType | None:
        """Return the type of the robot's remote subscribers.

        None if it may have been taken from clients: a subscriber may follow what they publish.
        """
        announced = [s for s in self.remote_subscribers if s.type is not None]
        of_robot = [s.type for s in announced if not s.for_clients]
        if not of_robot:
            return None
        of_clients = (*self._held_by_clients(), *(s.type for s in announced if s.for_clients))
        clients = {type.name for type in of_clients if type is not None}
        is_own = not any(type.name in clients for type in of_robot if type is not None)
        return of_robot[0] if is_own else None

    @property
    def of_clients(self) -> tuple[MemoryPublisher | MemorySubscription, ...]:
        """Endpoints in this process that the robot may displace."""
        return tuple(end for end in self._local if end.is_displaceable)

    @property
    def announced_subscribers(self) -> tuple[MemorySubscription, ...]:
        """Return the subscriptions that receive the samples of other processes."""
        return () if self.is_reserved else tuple(s for s in self.subscribers if not s.owner.private)

    @property
    def all_publishers(self) -> tuple[MemoryPublisher | RemoteEndpoint, ...]:
        return (*self.publishers, *self.remote_publishers)

    @property
    def all_subscribers(self) -> tuple[MemorySubscription | RemoteEndpoint, ...]:
        return (*self.subscribers, *self.remote_subscribers)

    def establish(self, wanted: MessageType, registry: Registry, *, for_clients: bool) -> None:
        """Set the type of the topic, for an endpoint that is about to join.

        Raises:
            TypeConflict: it has another type, which for the robot only the robot's own endpoints establish.
        """
        known = self.known_type
        if known is not None and known is not wanted and known.name != wanted.name:
            if not for_clients:
                known = next(iter(self._held_by_robot()), None) or self._announced_by_robot()
            if known is not None and known.name != wanted.name:
                raise TypeConflict(self.name, registry.type_name(wanted), registry.type_name(known))
            self.type = wanted
        elif self.type is None:
            self.type = wanted

    def settle(self) -> None:
        """Take the type that endpoints of the robot hold, or else those of clients; release it if none do."""
        held = self._held_by_robot()
        if not held and self._announced_by_robot() is None:
            held = self._held_by_clients()
        # A subscriber holds a name, and only a publisher knows which of its definitions is in use.
        holds_name = (
            not self.publishers and self.type is not None and self.type.name in {t.name for t in held}
        )
        if self.type not in held and not holds_name:
            self.type = held[0] if held else None
        if self.type is not None and not self.publishers:
            remote = (each.type for each in self.remote_publishers if each.type is not None)
            same = [type for type in remote if type.name == self.type.name]
            if same and self.type not in same:
                self.type = same[0]

    def misfits(self) -> list[MemoryPublisher | MemorySubscription]:
        """Return the clients' endpoints whose type is no longer that of the topic."""
        known = self.known_type
        return [
            end
            for end in self.of_clients
            if known is not None and end.held_type is not None and end.held_type.name != known.name
        ]


class MemoryPublisher(Publisher):
    """Publisher of one topic.

    Attributes:
        subscribers: subscriptions of this process that receive its samples.
        cache: samples retained for late joiners; None unless it is transient-local.
        on_publish_remote: sends every sample to other processes; set by a backend over a network.
    """

    def __init__(
        self, topics: Topics, topic: Topic, interface: MessageType, qos: QoS, owner: NodeResources
    ) -> None:
        self.topic = topic.name
        self.type = interface
        self.qos = qos
        self.node = owner.name
        self.owner = owner
        self._topics = topics
        self._state: Topic | None = topic
        self.subscribers: tuple[MemorySubscription, ...] = ()
        self._now = topics.clock.time_ns
        self._lifespan_ns = round((qos.lifespan or 0) * NANOSECONDS)
        latched = qos.durability is Durability.TRANSIENT_LOCAL
        self.cache: TransientLocalCache | None = (
            TransientLocalCache(qos, topics.clock, topics.lately_read) if latched else None
        )
        self.on_publish_remote: OnSample | None = None

    @property
    def is_closed(self) -> bool:
        return self._state is None

    @property
    def is_displaceable(self) -> bool:
        """True if it is displaced when the robot gives the topic another type."""
        return self.owner.for_clients or self.on_displaced is not None

    @property
    def held_type(self) -> MessageType | None:
        """Type that it holds: of a publisher, its own."""
        return self.type

    def connect_remote(self, send: OnSample, send_if_matched: OnSample) -> None:
        """Send samples to other processes: those that are retained now, and all later ones.

        Args:
            send: sends a sample; used if samples are retained, for subscribers that come later.
            send_if_matched: sends a sample if another process subscribes, and does not encode it otherwise.
        """
        if self.cache is None:
            self.on_publish_remote = send_if_matched
            return
        for sample in self.cache.samples():
            send(sample)
        self.on_publish_remote = send

    def publish(self, payload: Payload) -> None:
        if self._state is None:
            return
        if self._lifespan_ns:
            now = self._now()
            sample = Sample(self.topic, payload, now, self.node, now + self._lifespan_ns)
        else:
            sample = Sample(self.topic, payload, self._now(), self.node)
        if self.cache is not None:
            self.cache.add(sample)
        for subscriber in self.subscribers:
            try:
                subscriber.on_sample(sample)
            except Exception:
                logger.exception("a subscriber of %s failed", self.topic)
        if self.on_publish_remote is not None:
            self.on_publish_remote(sample)

    @property
    def subscriber_count(self) -> int:
        state = self._state
        return 0 if state is None else len(self.subscribers) + len(state.remote_subscribers)

    def close(self) -> None:
        state, self._state = self._state, None
        self.subscribers = ()
        self.on_displaced = None  # It may refer to what holds this publisher.
        if state is not None:
            if self.cache is not None:
                self.cache.clear()
                self.cache = None
            state.publishers = tuple(p for p in state.publishers if p is not self)
            self.owner.drop(self)
            self._topics.left(state)


class MemorySubscription(Subscription):
    """Subscriber of one topic.

    Attributes:
        held_type: type that it was created with, and so holds; None if it takes the topic's.
    """

    def __init__(
        self,
        topics: Topics,
        topic: Topic,
        on_sample: OnSample,
        held_type: MessageType | None,
        qos: QoS,
        owner: NodeResources,
    ) -> None:
        self.topic = topic.name
        self.on_sample = on_sample
        self.held_type = held_type
        self.qos = qos
        self.node = owner.name
        self.owner = owner
        self._topics = topics
        self._state: Topic | None = topic

    @property
    def is_displaceable(self) -> bool:
        """True if it is displaced when the robot gives the topic another type."""
        return self.owner.for_clients or self.on_displaced is not None

    @property
    def type(self) -> MessageType | None:
        return None if self._state is None else self._state.type

    def history(self) -> tuple[Sample, ...]:
        if self._state is None:
            return ()
        local = [p for p in self._state.publishers if self in p.subscribers]
        cached = [p.cache.samples() for p in local if p.cache is not None]
        # What a publisher of another type has left here was received before the topic had its present type.
        known = "" if self._state.type is None else self._state.type.name
        cached += [
            p.cache.samples()
            for p in self._state.remote_publishers
            if p.cache is not None and p.type is not None and p.type.name == known
        ]
        if len(cached) == 1:
            return cached[0]
        return tuple(sorted((s for samples in cached for s in samples), key=lambda s: s.stamp_ns))

    @property
    def wants_history(self) -> bool:
        """True if it receives samples from before it joined."""
        return self.qos.durability is not Durability.VOLATILE

    def replay(self) -> None:
        if self.wants_history:
            for sample in self.history():
                self.deliver(sample)

    def deliver(self, sample: Sample) -> None:
        try:
            self.on_sample(sample)
        except Exception:
            logger.exception("a subscriber of %s failed", self.topic)

    def close(self) -> None:
        state, self._state = self._state, None
        if state is not None:
            self.on_sample = _ignore
            self.on_displaced = None
            state.subscribers = tuple(s for s in state.subscribers if s is not self)
            self._topics.match(state)
            self.owner.drop(self)
            self._topics.left(state)


class Topics:
    """Topics of one graph.

    Attributes:
        remote: announces them to other processes; None in a graph of one process.
        dds_rules: True if incompatible publishers and subscriptions do not exchange samples.
        reserved: names of topics on which samples of other processes are ignored.
    """

    def __init__(
        self, registry: Registry, clock: Clock, changes: Changes, *, dds_rules: bool = False
    ) -> None:
        self.registry = registry
        self.dds_rules = dds_rules
        self.clock = clock
        self._changes = changes
        self.remote: RemoteTopics | None = None
        self.lately_read = LatelyRead()
        self.reserved: set[str] = set()
        self._topics: dict[str, Topic] = {}

    def reserve(self, names: Iterable[str]) -> None:
        """Ignore publishers of other processes on topics of these names, present and future ones."""
        for name in names:
            self.reserved.add(name)
            topic = self._topics.get(name)
            if topic is not None:
                topic.is_reserved = True
                topic.remote_publishers = ()
                self.left(topic)

    def _found(self, name: str) -> Topic:
        """Return the topic of a name, a new one if it does not exist."""
        return self._topics.get(name) or Topic(name, is_reserved=name in self.reserved)

    def advertise(self, name: str, interface: MessageType, qos: QoS, owner: NodeResources) -> MemoryPublisher:
        """Add a publisher. Raises :exc:`TypeConflict`."""
        topic = self._found(name)
        # Created first, so that a failure does not establish the topic's type.
        publisher = MemoryPublisher(self, topic, interface, qos, owner)
        topic.establish(interface, self.registry, for_clients=owner.for_clients)
        self._topics[name] = topic
        owner.add(publisher, publisher.close)
        topic.publishers = (*topic.publishers, publisher)
        self._displace(topic)
        self.match(topic)
        self._changes.note()
        self._changed(topic)
        return publisher

    def subscribe(
        self,
        name: str,
        on_sample: OnSample,
        interface: MessageType | None,
        qos: QoS,
        owner: NodeResources,
    ) -> MemorySubscription:
        """Add a subscriber and deliver the history to it. Raises :exc:`TypeConflict`."""
        topic = self._found(name)
        subscription = MemorySubscription(self, topic, on_sample, interface, qos, owner)
        if interface is not None:
            topic.establish(interface, self.registry, for_clients=owner.for_clients)
        self._topics[name] = topic
        owner.add(subscription, subscription.close)
        topic.subscribers = (*topic.subscribers, subscription)
        # Before the history, which must not be that of a displaced publisher.
        self._displace(topic)
        self.match(topic)
        self._changes.note()
        subscription.replay()
        self._changed(topic)
        return subscription

    def match(self, topic: Topic) -> None:
        """Set the subscribers of each publisher of a topic."""
        for publisher in topic.publishers:
            publisher.subscribers = (
                tuple(s for s in topic.subscribers if not incompatible_policies(publisher.qos, s.qos))
                if self.dds_rules
                else topic.subscribers
            )

    def left(self, topic: Topic) -> None:
        """Settle the type of a topic that an endpoint has left; remove the topic if it is empty."""
        topic.settle()
        self._displace(topic)
        if topic.empty:
            self._topics.pop(topic.name, None)
        self._changes.note()
        self._changed(topic)

    def _displace(self, topic: Topic) -> None:
        """End the clients' endpoints of a topic to which the robot has given another type."""
        misfits = topic.misfits()
        if not misfits:
            return
        now, topic_type = topic.known_type, misfits[0].held_type
        assert now is not None and topic_type is not None  # Misfits have one, which is another.
        names = self.registry.type_name(now), self.registry.type_name(topic_type)
        for end in misfits:
            displace(end, f"{topic.name}: the robot uses this topic with type {names[0]}, not {names[1]}")

    def _changed(self, topic: Topic) -> None:
        if self.remote is not None:
            self.remote.changed(topic)

    def all(self) -> tuple[Topic, ...]:
        return tuple(self._topics.values())

    def remote_joined(self, name: str, endpoint: RemoteEndpoint, *, publishes: bool) -> None:
        if publishes and name in self.reserved:
            logger.warning(
                "node %s of another process publishes on %s, which is ignored", endpoint.node, name
            )
            return
        topic = self._topics.setdefault(name, self._found(name))
        others = topic.remote_publishers if publishes else topic.remote_subscribers
        if publishes:
            topic.remote_publishers = (*others, endpoint)
        else:
            topic.remote_subscribers = (*others, endpoint)
        # One more of a kind changes nothing: a topic may have thousands of them.
        if others and others[-1].type is endpoint.type and others[-1].for_clients == endpoint.for_clients:
            self._changes.note()
        else:
            self._settled(topic)

    def remote_left(self, name: str, endpoint: RemoteEndpoint) -> None:
        topic = self._topics.get(name)
        if topic is None:
            return
        topic.remote_publishers = tuple(p for p in topic.remote_publishers if p is not endpoint)
        topic.remote_subscribers = tuple(s for s in topic.remote_subscribers if s is not endpoint)
        self._settled(topic)
        if topic.empty:
            self._topics.pop(name, None)
            self._changes.note()

    def _settled(self, topic: Topic) -> None:
        self._changes.note()
        before = topic.type
        topic.settle()
        self._displace(topic)
        if topic.type is not before:
            self._changed(topic)

    def find(self, name: str) -> Topic | None:
        return self._topics.get(name)

    def info(self, name: str) -> TopicInfo | None:
        topic = self._topics.get(name)
        return None if topic is None else topic.info(self.registry)

    def names(self) -> list[str]:
        return sorted(self._topics)
