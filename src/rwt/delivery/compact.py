"""Compact forms of a topic: made in threads, once for all subscribers with equal wishes."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from functools import partial
from importlib.util import find_spec
from typing import Final

import anyio
import anyio.to_thread

from rwt.delivery.fanout import Fanout
from rwt_graph.api import Graph, Sample, Subscription
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.payload import Payload
from rwt_interfaces.point_clouds.wish import CLOUD, COMPRESSED, CloudWish
from rwt_interfaces.structs import MessageType
from rwt_transports.shared_pool import Holder, PoolRow, Share, SharedPool

logger = logging.getLogger(__name__)

COMPACT: Final = PoolRow("compact subscriptions", "", "subscriptions to compact messages")
MOST_COMPACT: Final = 100
_THREADS: Final = 2


class CompactForms:
    """Compact forms of the topics of one gateway.

    Each subscriber takes a share of a pool, whatever others share its form.
    """

    def __init__(self, graph: Graph, derive: Callable[[Fanout, CompactSource], Fanout]) -> None:
        self._graph = graph
        self._derive = derive
        self._pool = SharedPool(COMPACT, MOST_COMPACT)
        self._limiter: anyio.CapacityLimiter | None = None
        self._forms: dict[tuple[str, CloudWish], Fanout] = {}

    def has(self, fanout: Fanout) -> bool:
        """Return True if the messages of a topic have a compact form, and what makes it is installed."""
        return fanout.type.name == CLOUD and find_spec("zstandard") is not None

    def join(
        self, fanout: Fanout, wish: CloudWish, holder: Holder, on_end: Callable[[str], None]
    ) -> tuple[Fanout, Share]:
        """Return the fan-out of a compact form, and the share of its new subscriber; pass both to
        :meth:`leave`.

        Args:
            on_end: called with the reason if the share is taken; it has to leave.

        Raises:
            PoolFull: no client has more subscriptions than this one.
        """
        share = self._pool.take(holder, on_end)
        key = (fanout.topic, wish)
        form = self._forms.get(key)
        if form is None:
            if self._limiter is None:
                self._limiter = anyio.CapacityLimiter(_THREADS)
            type = self._graph.registry.message(COMPRESSED)
            source = CompactSource(self._graph, fanout, type, wish, self._limiter)
            form = self._forms[key] = self._derive(fanout, source)
        return form, share

    def leave(self, form: Fanout, wish: CloudWish, share: Share) -> None:
        """End a subscriber, who has left the fan-out."""
        self._pool.release(share)
        if form.is_empty and self._forms.get((form.topic, wish)) is form:
            del self._forms[form.topic, wish]
            form.close()


class CompactSource:
    """Source of the compact samples of a topic, the source of its derived fan-out."""

    def __init__(
        self, graph: Graph, whole: Fanout, type: MessageType, wish: CloudWish, limiter: anyio.CapacityLimiter
    ) -> None:
        self._graph = graph
        self._whole = whole
        self._wish = wish
        self._limiter = limiter
        self.type = type

    def subscribe(
        self, topic: str, on_sample: Callable[[Sample], None], type: MessageType | None = None
    ) -> Subscription:
        """Return a subscription to the compact samples."""
        return _CompactSubscription(self._graph, self._whole, self.type, self._work, on_sample)

    async def _work(self, payload: Payload) -> Payload:
        """Return a compact payload, made in a thread. Raises InterfaceError."""
        return await anyio.to_thread.run_sync(partial(self._compress, payload), limiter=self._limiter)

    def _compress(self, payload: Payload) -> Payload:
        from rwt_interfaces.point_clouds.compressed import compress  # optional import: numpy and zstandard

        return Payload.from_value(self.type, compress(payload.value(), self._wish))


class _CompactSubscription(Subscription):
    """Samples of a topic after their conversion; of those that arrive meanwhile, the newest.

    Private attributes: ``_next`` is the sample to convert next, ``_latest`` the newest result with the sample
    that it was made from.
    """

    def __init__(
        self,
        graph: Graph,
        whole: Fanout,
        type: MessageType,
        work: Callable[[Payload], Awaitable[Payload]],
        on_sample: Callable[[Sample], None],
    ) -> None:
        self.topic = whole.topic
        self._graph = graph
        self._whole = whole
        self._type = type
        self._work = work
        self._on_sample = on_sample
        self._next: Sample | None = None
        self._latest: tuple[Sample, Sample] | None = None
        self._is_busy = self._is_closed = self._has_failed = False
        whole.take_samples(self._take, self._ended)
        for sample in whole.subscription.history()[-1:]:
            self._take(sample)

    @property
    def type(self) -> MessageType:
        return self._type

    def history(self) -> tuple[Sample, ...]:
        """Return the newest retained sample, if it has been converted; otherwise it arrives later."""
        if self._latest is None:
            return ()
        whole, compact = self._latest
        return (compact,) if any(each is whole for each in self._whole.subscription.history()) else ()

    def close(self) -> None:
        if not self._is_closed:
            self._is_closed = True
            self._next = None
            self._whole.end_samples(self._take)

    def _ended(self, reason: str) -> None:
        if self.on_displaced is not None:
            self.on_displaced(reason)

    def _take(self, sample: Sample) -> None:
        self._next = sample.detach()
        if not self._is_busy:
            self._is_busy = True
            self._graph.spawn(self._run, f"compact form of {self.topic}")

    async def _run(self) -> None:
        try:
            while (sample := self._next) is not None:
                self._next = None
                await self._convert(sample)
        finally:
            self._is_busy = False

    async def _convert(self, sample: Sample) -> None:
        try:
            payload = await self._work(sample.payload)
        except InterfaceError as error:
            if not self._has_failed:
                self._has_failed = True  # A robot may send many such messages.
                logger.warning("messages of %s without a compact form are not sent: %s", self.topic, error)
            return
        if not self._is_closed:
            compact = Sample(self.topic, payload, sample.stamp_ns, sample.node, sample.expires_ns)
            self._latest = sample, compact
            self._on_sample(compact)
