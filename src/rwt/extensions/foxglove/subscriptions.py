"""Subscriptions of one client: samples of topics as messages of its subscriptions."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Final

from rwt.access.client_graph import ClientGraph
from rwt.delivery.drop_notices import DropNotices, NoticeFlow
from rwt.delivery.fanout import Fanout
from rwt.delivery.gap_flow import GapFlow
from rwt.delivery.throttle import Room, Throttle, rules_as_published
from rwt.extensions.foxglove.catalogue import TopicChannel
from rwt.extensions.foxglove.errors import NotPossible
from rwt.extensions.foxglove.replies import FoxgloveReplies
from rwt.extensions.foxglove.wire.client_messages import ChannelSubscription
from rwt.extensions.foxglove.wire.server_messages import Level, message_data, status, subscription_number
from rwt_protocol.codecs import Encoding
from rwt_protocol.frames import Frame
from rwt_protocol.payloads import PublishedMessage
from rwt_transports.endpoint import DropReason


def _serialised(sample: PublishedMessage) -> Frame:
    return message_data(sample.stamp_ns, sample.payload.serialised_parts())


def _in_json(sample: PublishedMessage) -> Frame:
    return message_data(sample.stamp_ns, tuple(sample.payload.json_parts()))


# All subscriptions share a frame with a gap for their ids.
SERIALISED: Final = Encoding("foxglove", 0, lambda topic: _serialised, "serialised")
IN_JSON: Final = Encoding("foxglove-json", 0, lambda topic: _in_json)


_BECAUSE: Final[Mapping[DropReason, str]] = {
    DropReason.QUEUE: "this connection is slower than its publisher, and the newest count",
    DropReason.BACKLOG: "this connection is slower than all that it is subscribed to",
    DropReason.SIZE: "they are larger than limits.outgoing_message_bytes",
    DropReason.LIFESPAN: "they were older than their lifespan when their turn came",
}


class _Delivery:
    """Subscription of a client."""

    def __init__(
        self, graph: ClientGraph, replies: FoxgloveReplies, id: int, channel: TopicChannel, fanout: Fanout
    ) -> None:
        clock, topic = graph.clock, channel.topic
        self.channel = channel
        self._encoding = IN_JSON if channel.in_json else SERIALISED
        self._graph = graph
        self._fanout = fanout
        notices = self._notices = NoticeFlow(replies.sink, topic)
        self._drops = DropNotices(
            topic,
            fanout.counts,
            graph.counters,
            clock,
            lambda text: notices.send(status(Level.WARNING, text, f"dropped {topic}")),
            lambda text: replies.log(logging.INFO, text),
            lambda reason, _: f"messages are dropped: {_BECAUSE[reason]}",
        )
        info = graph.topic(topic)
        rules = rules_as_published(info.publishers if info else ())
        flow = replies.sink.flow(topic, rules, on_drop=self._drops.dropped, time_ns=clock.time_ns)
        self._flow = GapFlow(flow, subscription_number(id))
        # Open, and so without a queue of its own: messages only wait for the network.
        self._throttle = Throttle(clock, self._flow, self._drops.withheld, self._drops.dropped, Room(0))

    def begin(self, on_end: Callable[[str], None]) -> None:
        """Send samples, until :meth:`end`; `on_end` is called with a reason for that."""
        stream = self._fanout.join(self._throttle, self.channel.topic, self._encoding, on_end)
        kept = self._fanout.subscription.history() + self._graph.startup_samples(self._fanout)
        for sample in kept:
            stream.replay(sample, self._throttle)

    def end(self) -> None:
        self._throttle.close()
        self._flow.close()
        self._drops.close()
        self._notices.close()
        self._fanout.leave(self._throttle, self.channel.topic, self._encoding)
        self._graph.unsubscribe(self._fanout)


class Subscriptions:
    """Subscriptions of one client, by its ids."""

    def __init__(self, graph: ClientGraph, replies: FoxgloveReplies) -> None:
        self._graph = graph
        self._replies = replies
        self._by_id: dict[int, _Delivery] = {}
        self._channels: set[int] = set()

    def subscribe(self, asked: ChannelSubscription, channels: Mapping[int, TopicChannel]) -> None:
        """Subscribe to a channel.

        Raises:
            NotPossible: there is no such channel, or the client has the id or the channel already.
            NotAllowed, QuotaExceeded, TypeConflict: as :meth:`ClientGraph.subscribe`.
        """
        channel = channels.get(asked.channel_id)
        if channel is None:
            raise NotPossible(f"subscribe: there is no channel {asked.channel_id}")
        if asked.id in self._by_id:
            raise NotPossible(f"subscribe: subscription {asked.id} is in use; take another id")
        if channel.id in self._channels:
            raise NotPossible(f"subscribe: channel {channel.id} ({channel.topic}) is subscribed to already")
        fanout = self._graph.subscribe(channel.topic, channel.type.name)
        delivery = _Delivery(self._graph, self._replies, asked.id, channel, fanout)
        self._by_id[asked.id] = delivery
        self._channels.add(channel.id)
        delivery.begin(partial(self._ended, asked.id))

    def unsubscribe(self, id: int) -> None:
        """End a subscription. An unknown id is no error: the channel may have gone before the client learned
        of it.
        """
        delivery = self._by_id.pop(id, None)
        if delivery is not None:
            self._channels.discard(delivery.channel.id)
            delivery.end()

    def _ended(self, id: int, reason: str) -> None:
        self.unsubscribe(id)
        self._replies.say(Level.ERROR, f"subscription {id} has ended: {reason}")

    def end(self, channels: Iterable[int]) -> None:
        """End the subscriptions of removed channels."""
        gone = self._channels.intersection(channels)
        for id in [id for id, delivery in self._by_id.items() if delivery.channel.id in gone] if gone else ():
            self.unsubscribe(id)

    def close(self) -> None:
        """End all subscriptions."""
        for id in tuple(self._by_id):
            self.unsubscribe(id)
