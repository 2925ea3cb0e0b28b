"""Received samples of one topic, passed from Zenoh's threads to the graph's.

Zenoh calls back from a separate thread for each subscriber, which only queues the sample. The graph's thread
is woken for the first sample of a batch and takes the whole batch, so that the threads do not contend for the
GIL on each message.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from time import perf_counter
from typing import TYPE_CHECKING

import zenoh
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

if TYPE_CHECKING:
    from rwt.extensions.zenoh.link import ZenohLink

logger = logging.getLogger(__name__)

#: Limits of queued samples per topic; beyond them, the oldest are dropped.
MOST_SAMPLES, MOST_BYTES = 16_384, 128 * 1024 * 1024

#: Maximum samples per turn, and seconds after which no more begin, so that a flood on one topic does not
#: block the event loop. The clock is read after some samples each.
_BATCH = 256
_TURN_SECONDS = 0.005
_CLOCK_SAMPLES = 16

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
        until = perf_counter() + _TURN_SECONDS
        for number in range(min(len(waiting), _BATCH)):
            if number % _CLOCK_SAMPLES == 0 and perf_counter() > until:
                break
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
