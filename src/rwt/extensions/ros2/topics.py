"""Topics of this process on ROS 2.

Each publisher has a raw publisher of its node, which offers what subscriptions of other processes request, as
far as it can. The subscriptions of a topic share up to two raw subscriptions: one for those with history, if
a publisher is transient-local, and one for all else. Both follow the publishers, as `ros2 topic echo` does:
best effort as soon as one of them is.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import partial

from rwt.extensions.ros2.connection import Connection, now
from rwt.extensions.ros2.history import ALL_RETAINED, Probe, RemoteHistory
from rwt.extensions.ros2.qos import adapted
from rwt.extensions.ros2.rcl import NO_NUMBER, RawSample
from rwt.extensions.ros2.type_supports.installed import NotInstalled
from rwt.extensions.ros2.wakeups import Inbox
from rwt_graph.api import Sample
from rwt_graph.backend import (
    MemoryPublisher,
    MemorySubscription,
    NodeResources,
    RemoteEndpoint,
    Topic,
    Topics,
    received_sample,
)
from rwt_graph.clock import Clock
from rwt_graph.errors import Ros2Error
from rwt_graph.problems import Problems
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import MessageType
from rwt_participant.qos import Durability, History, QoS, Reliability, incompatible_policies
from rwt_participant.timers import Timer

logger = logging.getLogger(__name__)

#: Maximum queued samples of a subscription.
_MOST_QUEUED = 1000

#: Maximum publishers of one topic whose last sequence numbers are remembered.
_MOST_REMEMBERED = 1000

#: Seconds for which a probe waits for samples that a publisher sent while it began.
_PROBE_SECONDS = 0.1

#: Seconds between two probes if publishers send while they run: at first, and at most.
_SHORTEST_PROBE_DELAY, _LONGEST_PROBE_DELAY = 0.05, 10.0


class Reader(Inbox[RawSample]):
    """Raw subscription of one topic.

    Args:
        owner: node that it belongs to.
        on_raw: called on the graph's thread with each sample.
    """

    def __init__(
        self,
        connection: Connection,
        topic: str,
        type: MessageType,
        owner: NodeResources,
        qos: QoS,
        on_raw: Callable[[RawSample], None],
    ) -> None:
        self.profile = (type, owner, qos)
        self._connection = connection
        self._names = (owner.name, topic)
        endpoint = connection.subscription(owner, topic, type, qos)
        connection.own_subscriptions[self] = (self._names, float("inf"))
        super().__init__(
            connection.wakeups, "subscription", endpoint, partial(connection.take, endpoint), on_raw
        )

    def close(self) -> None:
        if not self.is_closed:
            super().close()
            self._connection.own_subscriptions[self] = (self._names, now())


class Writer:
    """Raw publisher of one publisher of this process.

    Attributes:
        offered: policies, which may be more than the publisher's own.
    """

    def __init__(
        self, connection: Connection, publisher: MemoryPublisher, channel: Channel, offered: QoS
    ) -> None:
        self._connection = connection
        self._publisher = publisher
        self._channel = channel
        self.offered = offered
        self._endpoint, self._gid = connection.publisher(
            publisher.owner, publisher.topic, publisher.type, offered
        )
        connection.own_gids[self._gid] = float("inf")
        retains = offered.durability is Durability.TRANSIENT_LOCAL
        publisher.connect_remote(self._send, self._send if retains else self._send_if_matched)

    def _send_if_matched(self, sample: Sample) -> None:
        # Readers of this process match, too.
        if self._endpoint.get_subscription_count() > len(self._channel.readers):
            self._send(sample)

    def _send(self, sample: Sample) -> None:
        self._endpoint.publish_raw(sample.payload.cdr())

    def close(self) -> None:
        """Leave the topic."""
        self._publisher.on_publish_remote = None
        self._endpoint.destroy_when_not_in_use()
        self._connection.own_gids[self._gid] = now()


class Channel:
    """Endpoints of one topic on ROS 2.

    Attributes:
        writers: raw publishers by publisher.
        readers: raw subscription with history, and the one without.
        last: last sequence number by GID, of the subscription with history and the one without.
        probe: running probe of retained samples; `probe_timer` ends it, or starts the next one after
            `probe_delay` seconds if a publisher disturbed it.
    """

    def __init__(self) -> None:
        self.writers: dict[MemoryPublisher, Writer] = {}
        self.readers: dict[bool, Reader] = {}
        self.last: dict[bool, dict[bytes, int]] = {True: {}, False: {}}
        self.probe: Reader | None = None
        self.probe_timer: Timer | None = None
        self.probe_delay = _SHORTEST_PROBE_DELAY

    def end_probe(self) -> None:
        """Stop probing."""
        if self.probe is not None:
            self.probe.close()
            self.probe = None
        if self.probe_timer is not None:
            self.probe_timer.cancel()
            self.probe_timer = None

    @property
    def empty(self) -> bool:
        """True if no endpoint exists."""
        return not (self.writers or self.readers)


class Ros2Topics:
    """Topics of this process, offered to ROS 2, and received samples.

    Attributes:
        publishers: publishers of other processes, by GID.
        find_publishers: reads the publishers of a topic at once, for a sample that overtook their discovery.
    """

    def __init__(
        self, topics: Topics, clock: Clock, problems: Problems, may_retain: Callable[[str], bool]
    ) -> None:
        self._problems = problems
        self._may_retain = may_retain
        self.publishers: dict[bytes, RemoteEndpoint] = {}
        self.find_publishers: Callable[[str], None] = lambda _: None
        self._topics = topics
        self._clock = clock
        self._is_simulated = not clock.is_real
        self._connection: Connection | None = None
        self._channels: dict[str, Channel] = {}

    def open(self, connection: Connection) -> None:
        """Offer every topic of this process."""
        self._connection = connection
        for topic in self._topics.all():
            self.changed(topic)

    def close(self) -> None:
        """Close every endpoint."""
        for channel in self._channels.values():
            for writer in channel.writers.values():
                writer.close()
            self._close_readers(channel)
        self._channels.clear()
        self._connection = None

    @staticmethod
    def _close_readers(channel: Channel) -> None:
        for reader in channel.readers.values():
            reader.close()
        channel.readers.clear()
        channel.end_probe()

    def follow(self, name: str) -> None:
        """Adapt the endpoints of a topic to its publishers in other processes."""
        topic = self._topics.find(name)
        if topic is not None:
            self.changed(topic)

    def changed(self, topic: Topic) -> None:
        connection = self._connection
        if connection is None:
            return
        channel = self._channels.setdefault(topic.name, Channel())
        try:
            self._follow_publishers(connection, topic, channel)
            self._follow_subscribers(connection, topic, channel)
        except Ros2Error as error:
            is_used = topic.remote_publishers or topic.remote_subscribers
            if isinstance(error, NotInstalled) and not is_used:
                # Only this process uses the topic, such as the server's own nodes.
                connection.note_missing(topic.name, error)
            else:
                self._problems.report(topic.name, f"{topic.name} is not exchanged with ROS 2: {error}")
        if channel.empty:
            self._channels.pop(topic.name, None)

    def _follow_publishers(self, connection: Connection, topic: Topic, channel: Channel) -> None:
        for publisher in channel.writers.keys() - set(topic.publishers):
            channel.writers.pop(publisher).close()
        for publisher in topic.publishers:
            if not publisher.owner.private:
                self._follow_requests(connection, topic, channel, publisher)

    def _follow_requests(
        self, connection: Connection, topic: Topic, channel: Channel, publisher: MemoryPublisher
    ) -> None:
        """Offer what subscriptions of other processes request; report what cannot be offered.

        A publisher that has to offer more is replaced: the others may miss samples until they have found it.
        """
        writer = channel.writers.get(publisher)
        before = publisher.qos if writer is None else writer.offered
        requests = (each.qos for each in topic.remote_subscribers)
        offered = adapted(before, requests, may_retain=self._may_retain(topic.name))
        if writer is None or offered != before:
            if offered != before:
                policies = f"{offered.reliability.value} and {offered.durability.value}"
                logger.info("%s is published as %s on ROS 2: a subscriber requests it", topic.name, policies)
            if writer is not None:
                writer.close()
            channel.writers[publisher] = Writer(connection, publisher, channel, offered)
        for each in topic.remote_subscribers:
            if each.type is not None and each.type.rihs01 != publisher.type.rihs01:
                self._problems.report(
                    topic.name,
                    f"{each.node or 'another program'} does not receive what is published on {topic.name} "
                    f"here: it defines {each.type_name} otherwise; advertise the topic again",
                )
            lacking = incompatible_policies(offered, each.qos)
            if lacking and each.node:  # Reported when its node is known.
                self._problems.report(
                    topic.name,
                    f"{each.node} does not receive what is published on {topic.name} here: it "
                    f"requests a {' and a '.join(lacking)} that the publisher does not offer; advertise the "
                    "topic with a `qos` that has it, or change the subscriber",
                )

    def _follow_subscribers(self, connection: Connection, topic: Topic, channel: Channel) -> None:
        wanted = _profiles(topic)
        for history in (True, False):
            reader = channel.readers.get(history)
            profile = wanted.get(history)
            if reader is not None and reader.profile == profile:
                continue
            if profile is not None:
                type, owner, qos = profile
                on_raw = partial(self._receive, topic, channel, type, history=history)
                if reader is not None and reader.profile[0] is not type:
                    # The middleware keeps one definition of a name while an endpoint uses it.
                    reader.close()
                    reader = None
                if history:
                    # Subscriptions with history have received these from the other reader.
                    channel.last[True].update(channel.last[False])
                # Before the old one is closed, so that no sample is lost; duplicates are recognised.
                channel.readers[history] = Reader(connection, topic.name, type, owner, qos, on_raw)
            if reader is not None:
                reader.take(_MOST_QUEUED)
                reader.close()
            if profile is None:
                channel.readers.pop(history, None)
                if history:
                    # These no longer follow the publishers.
                    for publisher in topic.remote_publishers:
                        publisher.cache = None
                    channel.last[True].clear()
                    channel.end_probe()

    def _receive(
        self, topic: Topic, channel: Channel, type: MessageType, raw: RawSample, *, history: bool
    ) -> None:
        connection = self._connection
        gid, number = raw.gid, raw.number
        if connection is None or gid in connection.own_gids:
            return
        publisher = self.publishers.get(gid)
        if publisher is None:
            self.find_publishers(topic.name)
            publisher = self.publishers.get(gid)
        if publisher is not None and publisher.type is None:
            return  # Its definition is another one, which is being asked for.
        stamp = self._clock.time_ns() if self._is_simulated else raw.stamp_ns
        sample = received_sample(topic.name, Payload.relayed_cdr(type, raw.data), stamp, publisher)
        if history and publisher is not None:
            if not isinstance(publisher.cache, RemoteHistory):
                publisher.cache = RemoteHistory(publisher.qos, self._clock)
            publisher.cache.put(sample, number)
            if publisher.cache.wants_probe:
                self._probe(connection, topic, channel)
        last = channel.last[history]
        if number != NO_NUMBER:
            if number <= last.get(gid, 0):
                return
            last[gid] = number
            if len(last) > _MOST_REMEMBERED:
                del last[next(iter(last))]
        has_other = (
            not history and True in channel.readers and publisher is not None and is_latched(publisher)
        )
        for subscription in topic.subscribers:
            if _takes(subscription, history=history, has_other=has_other):
                subscription.deliver(sample)

    def _retry_probe(self, connection: Connection, topic: Topic, channel: Channel) -> None:
        channel.probe_timer = None
        self._probe(connection, topic, channel)

    def _probe(self, connection: Connection, topic: Topic, channel: Channel) -> None:
        """Find out how many samples the publishers retain, if a sample has made that possible."""
        if channel.probe is not None or channel.probe_timer is not None:
            return
        unknown = [
            (gid, publisher.cache)
            for gid, publisher in self.publishers.items()
            if publisher in topic.remote_publishers
            and isinstance(publisher.cache, RemoteHistory)
            and publisher.cache.wants_probe
        ]
        if not unknown:
            return
        probe = Probe(unknown)
        type, owner, _ = channel.readers[True].profile

        def receive(raw: RawSample) -> None:
            is_complete = probe.receive(raw.gid, raw.number)
            if is_complete and channel.probe_timer is None:
                # Later, to see whether a publisher was sending.
                channel.probe_timer = self._clock.call_later(_PROBE_SECONDS, finish)

        def finish() -> None:
            for each in (reader, channel.readers[True]):
                each.take(_MOST_QUEUED)
            channel.end_probe()
            if probe.finish():
                channel.probe_delay = _SHORTEST_PROBE_DELAY
                return
            retry = partial(self._retry_probe, connection, topic, channel)
            channel.probe_timer = self._clock.call_later(channel.probe_delay, retry)
            channel.probe_delay = min(2 * channel.probe_delay, _LONGEST_PROBE_DELAY)

        reader = channel.probe = Reader(connection, topic.name, type, owner, ALL_RETAINED, receive)


def _takes(subscription: MemorySubscription, *, history: bool, has_other: bool) -> bool:
    """Return True if a subscription takes a sample from the reader with or without history."""
    return subscription.wants_history if history else not (has_other and subscription.wants_history)


def is_latched(publisher: RemoteEndpoint) -> bool:
    """Return True if a publisher retains samples."""
    return publisher.qos.durability is Durability.TRANSIENT_LOCAL


def _profiles(topic: Topic) -> dict[bool, tuple[MessageType, NodeResources, QoS]]:
    """Return type, owner and QoS of each needed reader: with history, and without."""
    subscriptions = topic.announced_subscribers
    if topic.type is None or not subscriptions:
        return {}
    latched = [p for p in topic.remote_publishers if is_latched(p)]
    others = [p for p in topic.remote_publishers if not is_latched(p)]
    with_history = [s for s in subscriptions if s.wants_history]
    profiles = {}
    if latched and with_history:
        qos = QoS(
            depth=ALL_RETAINED.depth,
            reliability=_reliability(latched, with_history),
            durability=Durability.TRANSIENT_LOCAL,
        )
        profiles[True] = (topic.type, with_history[0].owner, qos)
    if others or not latched or len(with_history) < len(subscriptions):
        keep_all = any(s.qos.history is History.KEEP_ALL for s in subscriptions)
        depth = _MOST_QUEUED if keep_all else min(_MOST_QUEUED, max(s.qos.depth for s in subscriptions))
        qos = QoS(depth=depth, reliability=_reliability(topic.remote_publishers, subscriptions))
        profiles[False] = (topic.type, subscriptions[0].owner, qos)
    return profiles


def _reliability(
    publishers: list[RemoteEndpoint] | tuple[RemoteEndpoint, ...], subscriptions: Sequence[MemorySubscription]
) -> Reliability:
    best_effort = Reliability.BEST_EFFORT
    if any(p.qos.reliability is best_effort for p in publishers):
        return best_effort
    return (
        best_effort if all(s.qos.reliability is best_effort for s in subscriptions) else Reliability.RELIABLE
    )
