"""The topics of this process, as other processes see them, and their samples as we do.

For each topic that somebody here takes part in there is one Zenoh publisher for each publisher, and one Zenoh
subscriber for all subscriptions that want kept samples and one for all that do not; and a liveliness token
for each of them.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from rwt_graph.action_names import belongs_to_action
from rwt_graph.api import Sample
from rwt_graph.clock import NANOSECONDS
from rwt_graph.qos import Durability, QoS
from rwt_graph.rmw import attachment
from rwt_graph.rmw.keys import data_key, dds_type
from rwt_graph.rmw.tokens import Endpoint, Kind
from rwt_graph.topics import Kept
from rwt_graph.zenoh.inlet import Inlet
from rwt_graph.zenoh.outlet import Outlet
from rwt_interfaces.payload import Payload

if TYPE_CHECKING:
    import zenoh

    from rwt_graph.elsewhere import RemoteEndpoint
    from rwt_graph.ownership import Owner
    from rwt_graph.topics import MemoryPublisher, MemorySubscription, Topic, Topics
    from rwt_graph.zenoh.link import Link, Presence
    from rwt_interfaces.structs import MessageType


class Channel:
    """What is declared for one topic."""

    def __init__(self) -> None:
        self.type: MessageType | None = None
        self.outlets: dict[MemoryPublisher, Outlet] = {}
        self.inlets: dict[bool, Inlet] = {}
        self.subscribers: dict[MemorySubscription, Presence] = {}

    @property
    def empty(self) -> bool:
        """Whether nothing is."""
        return not (self.outlets or self.inlets or self.subscribers)


class ZenohTopics:
    """Follows the topics of this process, and hears those of others.

    Attributes:
        publishers: those of other processes, by their GID.
    """

    def __init__(self, topics: Topics) -> None:
        self.publishers: dict[bytes, RemoteEndpoint] = {}
        self._topics = topics
        self._link: Link | None = None
        self._channels: dict[str, Channel] = {}

    def open(self, link: Link) -> None:
        """Declare what there is."""
        self._link = link
        for topic in self._topics.all():
            self.changed(topic)

    def close(self) -> None:
        """Declare nothing more; what is declared goes with the session."""
        self._link = None

    def changed(self, topic: Topic) -> None:
        """Bring what is declared up to what the topic is now."""
        link = self._link
        if link is None:
            return
        channel = self._channels.setdefault(topic.name, Channel())
        self._follow_publishers(link, topic, channel)
        self._follow_subscribers(link, topic, channel)
        if channel.empty:
            del self._channels[topic.name]

    def _follow_publishers(self, link: Link, topic: Topic, channel: Channel) -> None:
        wanted = {publisher for publisher in topic.publishers if not publisher.owner.private}
        for publisher in channel.outlets.keys() - wanted:
            channel.outlets.pop(publisher).close()
        for publisher in topic.publishers:
            if publisher in wanted and publisher not in channel.outlets:
                key, presence = self._declare(
                    link, Kind.PUBLISHER, publisher.owner, topic, publisher.type, publisher.qos
                )
                channel.outlets[publisher] = Outlet(link, key, publisher, presence)

    def _follow_subscribers(self, link: Link, topic: Topic, channel: Channel) -> None:
        type = topic.type
        wanted = [] if type is None else [s for s in topic.subscribers if not s.owner.private]
        kinds = {subscription.wants_kept for subscription in wanted}
        anew = channel.type is not type
        gone = [s for s in channel.subscribers if anew or s not in wanted]
        idle = [kept for kept in channel.inlets if anew or kept not in kinds]
        _unsubscribe(topic, channel, gone, idle)
        channel.type = type
        if type is None:
            return
        for kept in kinds - channel.inlets.keys():
            key = data_key(link.domain, topic.name, *_type_of(type))
            arrived = partial(self._arrived, link, topic, type, kept)
            prompt = belongs_to_action(topic.name)
            channel.inlets[kept] = Inlet(link, key, arrived, kept=kept, prompt=prompt)
        # Only now: who sees a subscription may count on its being served.
        for subscription in wanted:
            if subscription not in channel.subscribers:
                _, presence = self._declare(
                    link, Kind.SUBSCRIPTION, subscription.owner, topic, type, subscription.qos
                )
                channel.subscribers[subscription] = presence

    def _declare(
        self, link: Link, kind: Kind, owner: Owner, topic: Topic, type: MessageType, qos: QoS
    ) -> tuple[str, Presence]:
        names = _type_of(type)
        presence = link.declare(kind, owner, Endpoint(topic.name, *names, qos))
        return data_key(link.domain, topic.name, *names), presence

    def _arrived(
        self, link: Link, topic: Topic, type: MessageType, kept: bool, arrived: zenoh.Sample
    ) -> None:
        raw = arrived.attachment
        data = b"" if raw is None else raw.to_bytes()
        if len(data) == attachment.SIZE:
            _, stamp_ns, _, gid = attachment.unpack(data)
            if gid in link.own_gids:
                return
            publisher = self.publishers.get(gid) or _only_one(topic)
        else:
            # Not from a publisher of ROS 2, but somebody who knows the key and the type.
            stamp_ns, publisher = self._topics.clock.time_ns(), None
        sample = Sample(
            topic.name,
            Payload.relayed_cdr(type, arrived.payload.to_bytes()),
            stamp_ns,
            "" if publisher is None else publisher.node,
            0 if publisher is None else _expiry(publisher, stamp_ns),
        )
        self._deliver(topic, sample, publisher, kept)

    def _deliver(self, topic: Topic, sample: Sample, publisher: RemoteEndpoint | None, kept: bool) -> None:
        if sample.expires_ns and sample.expires_ns < self._topics.clock.time_ns():
            return
        if kept and publisher is not None and publisher.qos.durability is Durability.TRANSIENT_LOCAL:
            if publisher.kept is None:
                publisher.kept = Kept(publisher.qos, self._topics.clock)
            publisher.kept.add(sample)
        for subscription in topic.subscribers:
            if subscription.wants_kept is kept:
                subscription.deliver(sample)


def _unsubscribe(topic: Topic, channel: Channel, gone: list[MemorySubscription], idle: list[bool]) -> None:
    for subscription in gone:
        channel.subscribers.pop(subscription).end()
    for kept in idle:
        channel.inlets.pop(kept).close()
        if kept:
            # Nobody keeps it up to date any more; the publishers' own caches are asked again when needed.
            for publisher in topic.remote_publishers:
                publisher.kept = None


def _type_of(type: MessageType) -> tuple[str, str]:
    return dds_type(type.registry.type_name(type)), type.rihs01


def _only_one(topic: Topic) -> RemoteEndpoint | None:
    """Who it must be, when a program does not make its GIDs as rmw_zenoh does."""
    publishers = topic.remote_publishers
    return publishers[0] if len(publishers) == 1 else None


def _expiry(publisher: RemoteEndpoint, stamp_ns: int) -> int:
    lifespan = publisher.qos.lifespan
    return 0 if not lifespan else stamp_ns + round(lifespan * NANOSECONDS)


__all__ = ["Channel", "ZenohTopics"]
