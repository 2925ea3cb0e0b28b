"""What becomes of a sample of another process: whose it is, and who of this process is given it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_graph.api import Sample
from rwt_graph.clock import NANOSECONDS
from rwt_graph.zenoh.replay_deduplication import KeptElsewhere, Told
from rwt_graph.zenoh.rmw import attachment
from rwt_interfaces.payload import Payload
from rwt_program.qos import Durability

if TYPE_CHECKING:
    from collections.abc import Mapping

    import zenoh

    from rwt_graph.clock import Clock
    from rwt_graph.memory.remote import RemoteEndpoint
    from rwt_graph.memory.topics import MemorySubscription, Topic
    from rwt_interfaces.structs import MessageType


class Arrivals:
    """Takes the samples of one Zenoh subscriber to the subscriptions that it stands for.

    Args:
        publishers: those of other processes, by their GID.
        own_gids: of this process, whose samples come back from its own caches.
        told: what each subscription was given of kept samples; None when the subscriber wants none of them,
        and
            stands for those that do not either.
    """

    __slots__ = ("_clock", "_own_gids", "_publishers", "_told", "_topic", "_type")

    def __init__(
        self,
        topic: Topic,
        type: MessageType,
        clock: Clock,
        publishers: Mapping[bytes, RemoteEndpoint],
        own_gids: set[bytes],
        told: dict[MemorySubscription, Told] | None,
    ) -> None:
        self._topic = topic
        self._type = type
        self._clock = clock
        self._publishers = publishers
        self._own_gids = own_gids
        self._told = told

    def take(self, arrived: zenoh.Sample) -> None:
        """One sample came; on the graph's thread."""
        raw = arrived.attachment
        data = b"" if raw is None else raw.to_bytes()
        if len(data) != attachment.SIZE:
            # Not from a publisher of ROS 2, but from somebody who knows the key and the type.
            self._deliver(self._sample(arrived, self._clock.time_ns(), None))
            return
        number, stamp_ns, _, gid = attachment.unpack(data)
        if gid in self._own_gids:
            return
        publisher = self._publishers.get(gid) or self._only_one()
        sample = self._sample(arrived, stamp_ns, publisher)
        if sample.expires_ns and sample.expires_ns < self._clock.time_ns():
            return
        if self._told is None or publisher is None or not _keeps(publisher):
            self._deliver(sample)
        else:
            self._deliver_kept(self._told, publisher, sample, gid, number)

    def _sample(self, arrived: zenoh.Sample, stamp_ns: int, publisher: RemoteEndpoint | None) -> Sample:
        payload = Payload.relayed_cdr(self._type, arrived.payload.to_bytes())
        if publisher is None:
            return Sample(self._topic.name, payload, stamp_ns, "")
        lifespan = publisher.qos.lifespan
        expires = stamp_ns + round(lifespan * NANOSECONDS) if lifespan else 0
        return Sample(self._topic.name, payload, stamp_ns, publisher.node, expires)

    def _only_one(self) -> RemoteEndpoint | None:
        """Who it must be, when a program does not make its GIDs as rmw_zenoh does."""
        publishers = self._topic.remote_publishers
        return publishers[0] if len(publishers) == 1 else None

    def _deliver(self, sample: Sample) -> None:
        kept = self._told is not None
        for subscription in self._topic.subscribers:
            if subscription.wants_kept is kept:
                subscription.deliver(sample)

    def _deliver_kept(
        self,
        told: dict[MemorySubscription, Told],
        publisher: RemoteEndpoint,
        sample: Sample,
        gid: bytes,
        number: int,
    ) -> None:
        """Deliver a sample of a publisher that keeps it to whom it is new, and keep it here too."""
        if not isinstance(publisher.kept, KeptElsewhere):
            publisher.kept = KeptElsewhere(publisher.qos, self._clock, gid)
        publisher.kept.put(sample, number)
        for subscription in self._topic.subscribers:
            if subscription.wants_kept and told.setdefault(subscription, Told()).is_new(gid, number):
                subscription.deliver(sample)


def _keeps(publisher: RemoteEndpoint) -> bool:
    return publisher.qos.durability is Durability.TRANSIENT_LOCAL


__all__ = ["Arrivals"]
