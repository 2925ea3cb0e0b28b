"""Delivery of received samples to the subscriptions of this process, once each.

The cache of a transient-local publisher is queried whenever the publisher is discovered, also after each
break of the link. It then replays samples that older subscriptions have received and newer ones have not: a
:class:`ReplayFilter` for each subscription removes the duplicates.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt.extensions.zenoh.rmw import attachment
from rwt_graph.api import Sample
from rwt_graph.backend import MemorySubscription, RemoteEndpoint, Topic, TransientLocalCache, received_sample
from rwt_interfaces.payload import Payload
from rwt_participant.qos import Durability, QoS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import zenoh

    from rwt_graph.clock import Clock
    from rwt_interfaces.structs import MessageType

#: Maximum number of publishers that a subscription remembers.
_MOST_REMEMBERED = 1000


class RemoteHistory(TransientLocalCache):
    """Samples of a remote transient-local publisher, kept for subscriptions that join later."""

    def __init__(self, qos: QoS, clock: Clock, gid: bytes) -> None:
        super().__init__(qos, clock)
        self.gid = gid
        self.last = -1

    def put(self, sample: Sample, number: int) -> None:
        """Keep a sample if it is newer than the last one."""
        if number > self.last:
            self.last = number
            self.add(sample)


class ReplayFilter:
    """Number of the last received sample of each publisher for one subscription, by GID.

    Args:
        publishers: publishers whose history the subscription received when it was made.
    """

    __slots__ = ("_last",)

    def __init__(self, publishers: Iterable[RemoteEndpoint] = ()) -> None:
        caches = (publisher.cache for publisher in publishers)
        self._last = {each.gid: each.last for each in caches if isinstance(each, RemoteHistory)}

    def is_new(self, gid: bytes, number: int) -> bool:
        """Return True if a sample is newer than the last one, and note it as the last."""
        if number <= self._last.get(gid, -1):
            return False
        self._last[gid] = number
        if len(self._last) > _MOST_REMEMBERED:
            del self._last[next(iter(self._last))]
        return True


class SampleRouter:
    """Router of one Zenoh subscriber's samples to its subscriptions.

    Args:
        publishers: publishers of other processes, by GID.
        own_gids: GIDs of this process, whose samples come back from its own caches.
        filters: filters by subscription; None if the Zenoh subscriber receives no history.
    """

    __slots__ = ("_clock", "_filters", "_own_gids", "_publishers", "_topic", "_type")

    def __init__(
        self,
        topic: Topic,
        type: MessageType,
        clock: Clock,
        publishers: Mapping[bytes, RemoteEndpoint],
        own_gids: set[bytes],
        filters: dict[MemorySubscription, ReplayFilter] | None,
    ) -> None:
        self._topic = topic
        self._type = type
        self._clock = clock
        self._publishers = publishers
        self._own_gids = own_gids
        self._filters = filters

    def route(self, received: zenoh.Sample) -> None:
        """Deliver one sample, on the graph's thread."""
        raw = received.attachment
        data = b"" if raw is None else raw.to_bytes()
        name, payload = self._topic.name, Payload.relayed_cdr(self._type, received.payload.to_bytes())
        if len(data) != attachment.SIZE:
            # Sent by a program other than ROS 2's that knows the key and the type.
            self._deliver(received_sample(name, payload, self._clock.time_ns(), None))
            return
        number, stamp_ns, _, gid = attachment.unpack(data)
        if gid in self._own_gids:
            return
        publisher = self._publishers.get(gid)
        if publisher is None and len(self._topic.remote_publishers) == 1:
            # Its GID was not made as in rmw_zenoh.
            publisher = self._topic.remote_publishers[0]
        sample = received_sample(name, payload, stamp_ns, publisher)
        if sample.expires_ns and sample.expires_ns < self._clock.time_ns():
            return
        filters = self._filters
        if filters is None or publisher is None or publisher.qos.durability is not Durability.TRANSIENT_LOCAL:
            self._deliver(sample)
        else:
            self._deliver_new(filters, publisher, sample, gid, number)

    def _deliver(self, sample: Sample) -> None:
        history = self._filters is not None
        for subscription in self._topic.subscribers:
            if subscription.wants_history is history:
                subscription.deliver(sample)

    def _deliver_new(
        self,
        filters: dict[MemorySubscription, ReplayFilter],
        publisher: RemoteEndpoint,
        sample: Sample,
        gid: bytes,
        number: int,
    ) -> None:
        if not isinstance(publisher.cache, RemoteHistory):
            publisher.cache = RemoteHistory(publisher.qos, self._clock, gid)
        publisher.cache.put(sample, number)
        for subscription in self._topic.subscribers:
            if not subscription.wants_history:
                continue
            if filters.setdefault(subscription, ReplayFilter()).is_new(gid, number):
                subscription.deliver(sample)
