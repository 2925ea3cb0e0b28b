"""Samples of one topic on their way in: from Zenoh's threads to the graph's.

Zenoh calls back from a thread of its own for each subscriber. There a sample is only put in a queue; the
graph's thread is woken for the first of a batch and takes what is there, so that neither thread waits for the
other's turn with Python's lock once for each message.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import zenoh
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

if TYPE_CHECKING:
    from rwt_graph.zenoh.link import Link

logger = logging.getLogger(__name__)

#: What may wait for the graph's thread, by topic; beyond it the oldest samples are dropped.
MOST_SAMPLES, MOST_BYTES = 16_384, 128 * 1024 * 1024

#: Samples handled in one go: a flood on one topic must not keep the event loop from the rest.
_BATCH = 256

OnArrival = Callable[[zenoh.Sample], None]


class Inlet:
    """A subscriber of one key.

    Args:
        kept: whether what transient-local publishers kept is wanted too.
        prompt: hand over from Zenoh's receiving thread itself: slower, but in the order in which samples,
            replies and tokens came.
    """

    def __init__(self, link: Link, key: str, on_arrival: OnArrival, *, kept: bool, prompt: bool) -> None:
        self._on_arrival = on_arrival
        self._run_on_graph = link.run_on_graph
        self._key = key
        self._session = link.session
        self._waiting: deque[zenoh.Sample] = deque()
        self._announced = False
        self._closed = False
        self.dropped = 0
        handler = zenoh.handlers.Callback(self._arrived, indirect=not prompt)
        self._undeclare = _declare(link.session, key, handler, kept=kept)

    def _arrived(self, sample: zenoh.Sample) -> None:
        """On a thread of Zenoh's."""
        waiting = self._waiting
        if len(waiting) >= 64:
            self._make_room(len(sample.payload))
        waiting.append(sample)
        if not self._announced:
            self._announced = True
            self._run_on_graph(self._take)

    def _make_room(self, size: int) -> None:
        most = min(MOST_SAMPLES, max(64, MOST_BYTES // max(1, size)))
        while len(self._waiting) >= most:
            try:
                self._waiting.popleft()
            except IndexError:
                return  # The graph's thread took the rest meanwhile.
            if not self.dropped:
                logger.warning("samples on %s come faster than they are taken: some are dropped", self._key)
            self.dropped += 1

    def _take(self) -> None:
        """On the graph's thread."""
        self._announced = False
        waiting = self._waiting
        for _ in range(min(len(waiting), _BATCH)):
            try:
                sample = waiting.popleft()
            except IndexError:
                break  # It was dropped meanwhile, to make room.
            if self._closed:
                return
            self._on_arrival(sample)
        if waiting and not self._announced:
            self._announced = True
            self._run_on_graph(self._take)

    def ask_kept(self) -> None:
        """Ask the publishers' caches again; what they say arrives as any sample does.

        Zenoh's own subscriber asks a publisher that comes back after a cut, and leaves out what it had.
        """
        self._session.get(
            f"{self._key}/@adv/pub/**",
            zenoh.handlers.Callback(self._answered, indirect=False),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
        )

    def _answered(self, reply: zenoh.Reply) -> None:
        """On a thread of Zenoh's."""
        sample = reply.ok
        if sample is not None:
            self._run_on_graph(partial(self._take_kept, sample))

    def _take_kept(self, sample: zenoh.Sample) -> None:
        if not self._closed:
            self._on_arrival(sample)

    def close(self) -> None:
        """Receive nothing more."""
        if not self._closed:
            self._closed = True
            self._undeclare()
            self._waiting.clear()


def _declare(
    session: zenoh.Session, key: str, handler: zenoh.handlers.Callback[zenoh.Sample], *, kept: bool
) -> Callable[[], None]:
    """Subscribe; returns how to stop."""
    remote = zenoh.Locality.REMOTE
    if not kept:
        return session.declare_subscriber(key, handler, allowed_origin=remote).undeclare
    history = HistoryConfig(detect_late_publishers=True)
    return declare_advanced_subscriber(
        session, key, handler, allowed_origin=remote, history=history, subscriber_detection=True
    ).undeclare


__all__ = ["MOST_BYTES", "MOST_SAMPLES", "Inlet"]
