"""One client's subscriptions of one topic: several requests, one delivery (SUB-04)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from rwt.access.client_graph import ClientGraph
from rwt.delivery.drop_notices import DeadlineWatch, DropNotices, NoticeFlow
from rwt.delivery.fanout import EncodedStream, Fanout
from rwt.delivery.throttle import Room, Throttle
from rwt.rosbridge.ops.qos import history_depth, qos_request
from rwt.rosbridge.reply import Replies
from rwt_graph.api import Sample
from rwt_interfaces.point_clouds.wish import CloudWish
from rwt_protocol import ops
from rwt_protocol.codecs import Encoding
from rwt_protocol.ops import Status
from rwt_protocol.ops.topics import Compact
from rwt_transports.shared_pool import PoolFull, Share

#: Maximum throttle rate in milliseconds (three hundred centuries); larger ones count as this.
_LONGEST_THROTTLE = 10**15


class ClientSubscription:
    """Subscriptions of one client under one spelling of a topic's name, by id.

    The smallest `throttle_rate` (SUB-05), `queue_length` (X06) and `fragment_size` (SUB-07) apply, and the
    strongest requested encoding (SUB-08). A compact form applies if all request the same one (SUB-19).

    Private attributes: ``_source`` is the fan-out of the compact form, of which ``_share`` is this client's
    share, or `fanout`; ``_is_whole`` is True once the pool has refused or taken the share.

    Args:
        on_end: called with the reason if the topic's fan-out ends; it has to :meth:`close` this object.
    """

    def __init__(
        self,
        graph: ClientGraph,
        replies: Replies,
        name: str,
        fanout: Fanout,
        room: Room,
        on_end: Callable[[str], None],
    ) -> None:
        self._name = name
        self.fanout = fanout
        self._on_end = on_end
        self._graph = graph
        self._requests: dict[str | int | None, tuple[ops.Subscribe, Encoding]] = {}
        clock = graph.clock
        self._clock = clock
        notices = self._notices = NoticeFlow(replies.sink, name)

        def notify(text: str) -> None:  # Not a method: that would be a reference cycle.
            frame = replies.session.answer(Status(level="warning", msg=text))
            if frame is not None:
                notices.send(frame)

        self._drops = DropNotices(
            name,
            fanout.counts,
            graph.counters,
            clock,
            notify,
            lambda text: replies.log(logging.INFO, text),
        )
        self._flow = replies.sink.flow(name, on_drop=self._drops.dropped, time_ns=clock.time_ns)
        self._throttle = Throttle(clock, self._flow, self._drops.withheld, self._drops.dropped, room)
        self._encoding: Encoding | None = None
        self._stream: EncodedStream[Sample] | None = None
        self._source = fanout
        self._wish: CloudWish | None = None
        self._share: Share | None = None
        self._is_whole = False
        self._replies = replies

    @property
    def is_empty(self) -> bool:
        """True if no subscription is left."""
        return not self._requests

    def has(self, id_: str | int | None) -> bool:
        """Return True if there is a subscription with this id."""
        return id_ in self._requests

    def put(self, op: ops.Subscribe, encoding: Encoding) -> None:
        """Add a subscription, or replace the one of the same id (SUB-09).

        A new one receives the latched samples (SUB-13), the first also those of the publisher's first second
        (ADV-08).
        """
        is_first, is_new = not self._requests, op.id not in self._requests
        self._requests[op.id] = (op, encoding)
        stream = self._apply()
        if is_new:
            self._replay(stream, history_depth(op), startup=is_first)

    def _replay(self, stream: EncodedStream[Sample], most: int | None, *, startup: bool) -> None:
        """Send latched samples, at most that many of the newest; None means all."""
        if most == 0:
            return
        kept = self._source.subscription.history()
        if startup and self._source is self.fanout:
            kept += self._graph.startup_samples(self.fanout)
        for sample in kept if most is None else kept[-most:]:
            stream.replay(sample, self._throttle)

    def drop(self, id_: str | int | None) -> bool:
        """End the subscription of that id, or all. Returns False if there was none."""
        if id_ is not None and id_ not in self._requests:
            return False
        if id_ is None or len(self._requests) == 1:
            self.close()
        else:
            del self._requests[id_]
            self._apply()
            self._graph.unsubscribe(self.fanout)
        return True

    def close(self) -> None:
        """Stop the flow and drop the samples in the throttle (DIS-01, THR-07)."""
        count = len(self._requests)
        self._requests.clear()
        self._throttle.close()
        self._flow.close()
        self._drops.close()
        self._notices.close()
        self._leave()
        self._graph.unsubscribe(self.fanout, count)

    def _apply(self) -> EncodedStream[Sample]:
        requests = self._requests.values()
        encoding = max((encoding for _, encoding in requests), key=lambda encoding: encoding.precedence)
        self._throttle.cut_to(min((op.fragment_size for op, _ in requests if op.fragment_size), default=0))
        rate = min(*(max(0, op.throttle_rate) for op, _ in requests), _LONGEST_THROTTLE) / 1000
        self._throttle.configure(rate, min(op.queue_length for op, _ in requests))
        self._apply_qos([op for op, _ in requests])
        wish = None if self._is_whole else _wish_of([op.compact for op, _ in requests])
        if encoding is self._encoding and wish == self._wish and self._stream is not None:
            self._stream.changed(self._throttle)
            return self._stream
        self._leave()
        if wish is not None:
            self._join_compact(wish)
        self._encoding, self._wish = encoding, wish
        self._stream = self._source.join(self._throttle, self._name, encoding, self._on_end)
        return self._stream

    def _join_compact(self, wish: CloudWish) -> None:
        try:
            joined = self._graph.join_compact(self.fanout, wish, self._lose_compact)
        except PoolFull as full:
            self._report_whole(full.reason)
            return
        if joined is not None:
            self._source, self._share = joined

    def _lose_compact(self, reason: str) -> None:
        """Send whole messages from now on; another client needs the share."""
        self._report_whole(reason)
        if self._requests:
            self._apply()

    def _report_whole(self, reason: str) -> None:
        self._is_whole = True
        text = f"subscribe: messages of {self._name} are sent whole, without `compact`: {reason}"
        self._replies.send(Status(level="warning", msg=text))

    def _apply_qos(self, subscriptions: list[ops.Subscribe]) -> None:
        info = self._graph.topic(self.fanout.topic)
        rules, lifespan_ns, deadline = qos_request(subscriptions, info.publishers if info else ())
        self._flow.configure(rules)
        watch = DeadlineWatch(self._clock, deadline, self._drops.deadline_missed) if deadline else None
        self._throttle.watch(lifespan_ns, watch)

    def _leave(self) -> None:
        if self._encoding is not None:
            self._source.leave(self._throttle, self._name, self._encoding)
            self._encoding = None
        if self._wish is not None and self._share is not None:
            self._graph.leave_compact(self._source, self._wish, self._share)
        self._source, self._wish, self._share = self.fanout, None, None


def _wish_of(requests: Sequence[Compact | None]) -> CloudWish | None:
    """Return the compact form that all subscriptions request; None if they differ (SUB-19)."""
    first, *others = requests
    if first is None or any(each != first for each in others):
        return None
    return CloudWish(
        first.precision,
        first.fields or (),
        first.crop or (),
        first.voxel,
        first.stride,
        first.order,
        first.format,
    )
