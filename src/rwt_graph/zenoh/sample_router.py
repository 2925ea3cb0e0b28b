"""Received samples: passed on by Zenoh's threads, and delivered to each subscription here once.

Zenoh calls back from a separate thread for each subscriber, which only queues the sample. The graph's thread
is woken for the first sample of a batch and takes the whole batch, so that the threads do not contend for the
GIL on each message.

The cache of a transient-local publisher is queried whenever the publisher is discovered, also after each
break of the link. It then replays samples that older subscriptions have received and newer ones have not: a
:class:`ReplayFilter` for each subscription removes the duplicates.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import zenoh
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from rwt_graph.api import Sample
from rwt_graph.memory.topics import TransientLocalCache
from rwt_graph.zenoh.rmw import attachment
from rwt_interfaces.payload import Payload
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.qos import Durability

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rwt_graph.clock import Clock
    from rwt_graph.memory.topics import MemorySubscription, RemoteEndpoint, Topic
    from rwt_graph.zenoh.link import ZenohLink
    from rwt_interfaces.structs import MessageType
    from rwt_participant.qos import QoS


logger = logging.getLogger(__name__)

#: Limits of queued samples per topic; beyond them, the oldest are dropped.
MOST_SAMPLES, MOST_BYTES = 16_384, 128 * 1024 * 1024

#: Maximum samples per turn, so that a flood on one topic does not block the event loop.
_BATCH = 256

OnSample = Callable[[zenoh.Sample], None]


class ReceiveQueue:
    """Subscriber of one key.

    Args:
        on_sample: called on the graph's thread with each sample.
        history: True to receive retained samples of transient-local publishers, too.
        prompt: True to deliver from Zenoh's receiving thread itself: slower, but in the order in which
            samples, replies and tokens arrived.
    """

    def __init__(
        self, link: ZenohLink, key: str, on_sample: OnSample, *, history: bool, prompt: bool
    ) -> None:
        self._on_sample = on_sample
        self._run_on_graph = link.run_on_graph
        self._link = link
        self._key = key
        self._waiting: deque[zenoh.Sample] = deque()
        self._scheduled = False
        self._closed = False
        self.dropped = 0
        handler = zenoh.handlers.Callback(self._receive, indirect=not prompt)
        self._undeclare = _declare(link.session, key, handler, history=history)

    def _receive(self, sample: zenoh.Sample) -> None:
        """Called on a thread of Zenoh's."""
        waiting = self._waiting
        if len(waiting) >= 64:
            self._make_room(len(sample.payload))
        waiting.append(sample)
        if not self._scheduled:
            self._scheduled = True
            self._run_on_graph(self._handle)

    def _make_room(self, size: int) -> None:
        most = min(MOST_SAMPLES, max(64, MOST_BYTES // max(1, size)))
        while len(self._waiting) >= most:
            try:
                self._waiting.popleft()
            except IndexError:
                return  # The graph's thread has taken the rest meanwhile.
            if not self.dropped:
                logger.warning("samples on %s arrive faster than they are taken: some are dropped", self._key)
            self.dropped += 1

    def _handle(self) -> None:
        """Called on the graph's thread."""
        self._scheduled = False
        waiting = self._waiting
        for _ in range(min(len(waiting), _BATCH)):
            try:
                sample = waiting.popleft()
            except IndexError:
                break  # The sample was dropped meanwhile, to make room.
            if self._closed:
                return
            self._on_sample(sample)
        if waiting and not self._scheduled:
            self._scheduled = True
            self._run_on_graph(self._handle)

    def query_history(self) -> None:
        """Query the publishers' caches; their samples arrive like any other.

        Zenoh's own subscriber also queries a publisher that reconnects, but omits its earlier samples.
        """
        self._link.session.get(
            f"{self._key}/@adv/pub/**",
            self._link.callback(self._on_reply),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
        )

    def _on_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None and not self._closed:
            self._on_sample(reply.ok)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._undeclare()
            self._waiting.clear()


def _declare(
    session: zenoh.Session, key: str, handler: zenoh.handlers.Callback[zenoh.Sample], *, history: bool
) -> Callable[[], None]:
    remote = zenoh.Locality.REMOTE
    if not history:
        return session.declare_subscriber(key, handler, allowed_origin=remote).undeclare
    return declare_advanced_subscriber(
        session,
        key,
        handler,
        allowed_origin=remote,
        history=HistoryConfig(detect_late_publishers=True),
        subscriber_detection=True,
    ).undeclare


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
        if len(data) != attachment.SIZE:
            # Sent by a program other than ROS 2's that knows the key and the type.
            self._deliver(self._sample(received, self._clock.time_ns(), None))
            return
        number, stamp_ns, _, gid = attachment.unpack(data)
        if gid in self._own_gids:
            return
        publisher = self._publishers.get(gid)
        if publisher is None and len(self._topic.remote_publishers) == 1:
            # Its GID was not made as in rmw_zenoh.
            publisher = self._topic.remote_publishers[0]
        sample = self._sample(received, stamp_ns, publisher)
        if sample.expires_ns and sample.expires_ns < self._clock.time_ns():
            return
        filters = self._filters
        if filters is None or publisher is None or publisher.qos.durability is not Durability.TRANSIENT_LOCAL:
            self._deliver(sample)
        else:
            self._deliver_new(filters, publisher, sample, gid, number)

    def _sample(self, received: zenoh.Sample, stamp_ns: int, publisher: RemoteEndpoint | None) -> Sample:
        payload = Payload.relayed_cdr(self._type, received.payload.to_bytes())
        if publisher is None:
            return Sample(self._topic.name, payload, stamp_ns, "")
        lifespan = publisher.qos.lifespan
        expires = stamp_ns + round(lifespan * NANOSECONDS) if lifespan else 0
        return Sample(self._topic.name, payload, stamp_ns, publisher.node, expires)

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
