"""The topics of this process, as other processes see them, and their samples as we do.

For each topic that somebody here takes part in there is one Zenoh publisher for each publisher, and one Zenoh
subscriber for all subscriptions that want kept samples and one for all that do not; and a liveliness token
for each of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_graph.zenoh.actions.names import belongs_to_action
from rwt_graph.zenoh.receive_queue import Inlet
from rwt_graph.zenoh.remote_publisher import Outlet
from rwt_graph.zenoh.replay_deduplication import Told
from rwt_graph.zenoh.rmw.keys import data_key, dds_type
from rwt_graph.zenoh.rmw.tokens import Endpoint, Kind
from rwt_graph.zenoh.sample_router import Arrivals
from rwt_program.qos import QoS

if TYPE_CHECKING:
    from rwt_graph.memory.node_resources import Owner
    from rwt_graph.memory.remote import RemoteEndpoint
    from rwt_graph.memory.topics import MemoryPublisher, MemorySubscription, Topic, Topics
    from rwt_graph.zenoh.link import Link, Presence
    from rwt_interfaces.structs import MessageType


class Channel:
    """What is declared for one topic.

    Attributes:
        told: what each subscription that wants kept samples was given of them.
    """

    def __init__(self) -> None:
        self.told: dict[MemorySubscription, Told] = {}
        self.type: MessageType | None = None
        self.outlets: dict[MemoryPublisher, Outlet] = {}
        self.inlets: dict[bool, Inlet] = {}
        self.subscribers: dict[MemorySubscription, Presence] = {}

    @property
    def empty(self) -> bool:
        """Whether nothing is, and nothing needs to be remembered."""
        return not (self.outlets or self.inlets or self.subscribers or self.told)


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

    def came_back(self, name: str) -> None:
        """A publisher that keeps samples was cut off and is there again: hear what it keeps, for those who
        came meanwhile."""
        channel = self._channels.get(name)
        inlet = None if channel is None else channel.inlets.get(True)
        if inlet is not None:
            inlet.ask_kept()

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
        for subscription in channel.told.keys() - set(topic.subscribers):
            del channel.told[subscription]
        channel.type = type
        if type is None:
            return
        for kept in kinds - channel.inlets.keys():
            key = data_key(link.domain, topic.name, *_type_of(type))
            told = channel.told if kept else None
            arrivals = Arrivals(topic, type, self._topics.clock, self.publishers, link.own_gids, told)
            prompt = belongs_to_action(topic.name)
            channel.inlets[kept] = Inlet(link, key, arrivals.take, kept=kept, prompt=prompt)
        # Only now: who sees a subscription may count on its being served.
        for subscription in wanted:
            if subscription not in channel.subscribers:
                _, presence = self._declare(
                    link, Kind.SUBSCRIPTION, subscription.owner, topic, type, subscription.qos
                )
                channel.subscribers[subscription] = presence
                # One that was here before the topic's publishers were cut off and came back stays told.
                channel.told.setdefault(subscription, Told(topic.remote_publishers))

    def _declare(
        self, link: Link, kind: Kind, owner: Owner, topic: Topic, type: MessageType, qos: QoS
    ) -> tuple[str, Presence]:
        names = _type_of(type)
        presence = link.declare(kind, owner, Endpoint(topic.name, *names, qos))
        return data_key(link.domain, topic.name, *names), presence


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


__all__ = ["Channel", "ZenohTopics"]
