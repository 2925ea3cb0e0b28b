"""Slow reader: messages are queued, and the oldest of a full queue are dropped."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rwt_transports.endpoint import DropReason

if TYPE_CHECKING:
    from rwt_graph.clock import Clock

#: Maximum number of queued messages per client, over all topics; beyond it, the oldest of a topic is dropped.
MOST_WAITING = 10_000


@dataclass(frozen=True, slots=True, eq=False)
class _QueuedMessage:
    """Queued message; `flow` is None for a reply, which is never dropped."""

    send: Callable[[], None]
    flow: object
    on_drop: Callable[[DropReason], None] | None


class SlowReader:
    """Sends messages at the rate of a slow reader, in order.

    Args:
        read_rate: returns the current rate in messages per second; None for no limit, which flushes the
            queue.
    """

    def __init__(self, clock: Clock, read_rate: Callable[[], float | None]) -> None:
        self._clock = clock
        self._read_rate = read_rate
        self._waiting: deque[_QueuedMessage] = deque()
        self._ticking = False

    @property
    def idle(self) -> bool:
        """True if the queue is empty."""
        return not self._waiting

    def put(
        self,
        send: Callable[[], None],
        flow: object = None,
        depth: int | None = None,
        on_drop: Callable[[DropReason], None] | None = None,
    ) -> None:
        """Queue a message; it is sent at once if the queue is empty.

        Args:
            flow: key of the topic's flow; None for a message that is never dropped.
            depth: maximum number of queued messages of the flow.
            on_drop: called with the reason when a message of the flow is dropped.
        """
        if flow is not None and depth is not None:
            self._make_room(flow, depth)
        if flow is not None and len(self._waiting) >= MOST_WAITING:
            self._drop_oldest(lambda each: each.flow is not None, DropReason.BACKLOG)
        self._waiting.append(_QueuedMessage(send, flow, on_drop))
        if not self._ticking:
            self._tick()

    def _make_room(self, flow: object, depth: int) -> None:
        while sum(each.flow is flow for each in self._waiting) >= max(1, depth):
            self._drop_oldest(lambda each: each.flow is flow, DropReason.QUEUE)

    def _drop_oldest(self, is_meant: Callable[[_QueuedMessage], bool], reason: DropReason) -> None:
        oldest = next((each for each in self._waiting if is_meant(each)), None)
        if oldest is None:
            return
        self._waiting.remove(oldest)
        if oldest.on_drop is not None:
            oldest.on_drop(reason)

    def _tick(self) -> None:
        self._ticking = False
        read_rate = self._read_rate()
        if read_rate is None:
            self.flush()
        elif self._waiting:
            self._ticking = True
            self._clock.call_later(1.0 / read_rate, self._tick)
            self._waiting.popleft().send()

    def flush(self) -> None:
        """Send all queued messages now."""
        while self._waiting:
            self._waiting.popleft().send()
