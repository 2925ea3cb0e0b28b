"""Topics of this process over Zenoh.

Each publisher has a Zenoh publisher. The subscriptions of a topic share two Zenoh subscribers: one for those
with history, one for the others. Each publisher and subscription has a liveliness token.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt.extensions.zenoh.receive_queue import ReceiveQueue
from rwt.extensions.zenoh.remote_publisher import ZenohPublisher
from rwt.extensions.zenoh.rmw.tokens import EntityKind
from rwt.extensions.zenoh.sample_router import ReplayFilter, SampleRouter
from rwt_graph.backend import belongs_to_action

if TYPE_CHECKING:
    from rwt.extensions.zenoh.link import Presence, ZenohLink
    from rwt_graph.backend import MemoryPublisher, MemorySubscription, RemoteEndpoint, Topic, Topics
    from rwt_interfaces.structs import MessageType


class Channel:
    """Zenoh entities of one topic.

    Attributes:
        type: type of the declared subscribers.
        publishers: Zenoh publishers by publisher.
        queues: Zenoh subscriber with history, and the one without.
        subscribers: tokens by subscription.
        filters: filters of replayed samples by subscription.
    """

    def __init__(self) -> None:
        self.type: MessageType | None = None
        self.publishers: dict[MemoryPublisher, ZenohPublisher] = {}
        self.queues: dict[bool, ReceiveQueue] = {}
        self.subscribers: dict[MemorySubscription, Presence] = {}
        self.filters: dict[MemorySubscription, ReplayFilter] = {}

    @property
    def empty(self) -> bool:
        return not (self.publishers or self.queues or self.subscribers or self.filters)


class ZenohTopics:
    """Topics of this process, declared to others, and received samples of theirs.

    Attributes:
        publishers: publishers of other processes, by GID.
    """

    def __init__(self, topics: Topics) -> None:
        self.publishers: dict[bytes, RemoteEndpoint] = {}
        self._topics = topics
        self._link: ZenohLink | None = None
        self._channels: dict[str, Channel] = {}

    def open(self, link: ZenohLink) -> None:
        self._link = link
        for topic in self._topics.all():
            self.changed(topic)

    def close(self) -> None:
        """Declare no more endpoints; those declared end with the session."""
        self._link = None

    def on_reconnected(self, name: str) -> None:
        """Query a reconnected transient-local publisher, for subscriptions that were made meanwhile."""
        channel = self._channels.get(name)
        queue = None if channel is None else channel.queues.get(True)
        if queue is not None:
            queue.query_history()

    def changed(self, topic: Topic) -> None:
        link = self._link
        if link is None:
            return
        channel = self._channels.setdefault(topic.name, Channel())
        self._follow_publishers(link, topic, channel)
        self._follow_subscribers(link, topic, channel)
        if channel.empty:
            del self._channels[topic.name]

    def _follow_publishers(self, link: ZenohLink, topic: Topic, channel: Channel) -> None:
        wanted = {publisher for publisher in topic.publishers if not publisher.owner.private}
        for publisher in channel.publishers.keys() - wanted:
            channel.publishers.pop(publisher).close()
        for publisher in topic.publishers:
            if publisher in wanted and publisher not in channel.publishers:
                end = link.endpoint(topic.name, publisher.type, publisher.qos)
                presence = link.declare(EntityKind.PUBLISHER, publisher.owner, end)
                channel.publishers[publisher] = ZenohPublisher(link, end, publisher, presence)

    def _follow_subscribers(self, link: ZenohLink, topic: Topic, channel: Channel) -> None:
        type = topic.type
        wanted = [] if type is None else topic.announced_subscribers
        kinds = {subscription.wants_history for subscription in wanted}
        retyped = channel.type is not type
        gone = [s for s in channel.subscribers if retyped or s not in wanted]
        idle = [history for history in channel.queues if retyped or history not in kinds]
        _unsubscribe(topic, channel, gone, idle)
        for subscription in channel.filters.keys() - set(topic.subscribers):
            del channel.filters[subscription]
        channel.type = type
        if type is None:
            return
        for history in kinds - channel.queues.keys():
            key = link.endpoint(topic.name, type).data_key(link.domain)
            filters = channel.filters if history else None
            router = SampleRouter(topic, type, self._topics.clock, self.publishers, link.own_gids, filters)
            prompt = belongs_to_action(topic.name)
            channel.queues[history] = ReceiveQueue(link, key, router.route, history=history, prompt=prompt)
        # Declared last: a process that sees the token relies on the subscription's receiving samples.
        for subscription in wanted:
            if subscription not in channel.subscribers:
                end = link.endpoint(topic.name, type, subscription.qos)
                channel.subscribers[subscription] = link.declare(
                    EntityKind.SUBSCRIPTION, subscription.owner, end
                )
                # A subscription that is older than a break of the link keeps its filter.
                channel.filters.setdefault(subscription, ReplayFilter(topic.remote_publishers))


def _unsubscribe(topic: Topic, channel: Channel, gone: list[MemorySubscription], idle: list[bool]) -> None:
    for subscription in gone:
        channel.subscribers.pop(subscription).end()
    for history in idle:
        channel.queues.pop(history).close()
        if history:
            # These caches no longer follow the publishers; the next subscriber queries the publishers' own.
            for publisher in topic.remote_publishers:
                publisher.cache = None
