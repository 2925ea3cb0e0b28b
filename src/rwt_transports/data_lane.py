"""Samples queued for a slow reader: fair queueing of topics, and drops.

Each topic has a :class:`TopicQueue`. The lane serves them by start-time fair queueing with finish tags: the
tag of a frame is the position of its queue, or of the lane if that is further, plus the size of the frame,
and the smallest tag goes first. So topics share the connection by bytes, and a small message waits for at
most one large one: the one being written.

Beyond a bound, the oldest message of the same topic is dropped. Only a message of an empty topic takes the
place of other topics: of the largest queue, which keeps its newest. Order holds within a topic, and a message
in several frames is sent as a whole or not at all.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush

from rwt_protocol.frames import Frame
from rwt_transports.endpoint import DropReason, FlowRules
from rwt_transports.limits import Limits

_Message = tuple[Frame, tuple[Frame, ...], int]
"""Queued message: its first frame, the other frames, and its expiry time in nanoseconds (0: never)."""


@dataclass(slots=True, eq=False)
class TopicQueue:
    """Queue of one topic, oldest message first.

    Attributes:
        begun: remaining frames of the message whose first frame is sent.
        size: bytes of both.
        finish: finish tag of the last frame that was served.
        scheduled: True if the queue is in the lane's schedule.
    """

    rules: FlowRules
    on_drop: Callable[[DropReason], None] | None
    time_ns: Callable[[], int]
    waiting: deque[_Message] = field(default_factory=deque)
    begun: deque[Frame] = field(default_factory=deque)
    size: int = 0
    finish: int = 0
    scheduled: bool = False

    def next_size(self) -> int:
        return self.begun[0].size if self.begun else self.waiting[0][0].size if self.waiting else 0


class DataLane:
    """Queues of one connection.

    Attributes by purpose: ``schedule``, ``_entered`` (breaks ties between equal tags: first come, first
    served), ``_position`` (finish tag of the last frame) and ``_last`` (largest finish tag so far) order the
    queues; ``size`` and ``messages`` are checked against ``_limits``.

    Attributes:
        messages: queued messages, without those that have begun.
        dropped: number of dropped messages, by reason.
    """

    __slots__ = ("_entered", "_last", "_limits", "_position", "dropped", "messages", "schedule", "size")

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self.schedule: list[tuple[int, int, TopicQueue]] = []
        self._entered = 0
        self._position = 0
        self._last = 0
        self.size = 0
        self.messages = 0
        self.dropped: dict[DropReason, int] = {}

    def add(self, queue: TopicQueue, pieces: Sequence[Frame], expires_ns: int) -> None:
        """Queue a message, and drop others that exceed a bound."""
        size = sum(frame.size for frame in pieces)
        # The depth first: what it drops makes room, so that fewer messages of other topics are displaced.
        depth = queue.rules.depth
        if depth is not None:
            self.cut(queue, max(depth, 1) - 1)
        limits = self._limits
        full = self.size >= limits.data_bytes or self.messages >= limits.data_frames
        # A notice displaces nothing: it is small, and the server's own.
        if full and not queue.rules.notes:
            self._make_room(queue, size)
        queue.waiting.append((pieces[0], tuple(pieces[1:]), expires_ns))
        queue.size += size
        self.size += size
        self.messages += 1
        self._schedule(queue)

    def add_begun(self, queue: TopicQueue, pieces: Sequence[Frame]) -> None:
        """Queue the rest of a message whose first frame is sent."""
        size = sum(frame.size for frame in pieces)
        queue.begun.extend(pieces)
        queue.size += size
        self.size += size
        self._schedule(queue)

    def cut(self, queue: TopicQueue, depth: int) -> None:
        """Drop all but the newest `depth` messages of a queue."""
        while len(queue.waiting) > depth:
            self._drop_oldest(queue, DropReason.QUEUE)

    def next(self) -> Frame | None:
        """Remove and return the next frame; None if nothing is queued that has not expired."""
        while self.schedule:
            _, _, queue = heappop(self.schedule)
            frame = self._serve(queue)
            if frame is not None:
                return frame
        self._forgive()
        return None

    def next_within(self, most: int | None, busy: TopicQueue | None) -> tuple[TopicQueue, Frame] | None:
        """Remove and return the next frame of at most `most` bytes, of another queue than `busy`."""
        for entry in self._in_order():
            queue = entry[2]
            if queue is busy:
                continue
            self._drop_expired(queue)
            # A callback of a drop may have cleared the lane.
            if not queue.scheduled or (most is not None and queue.next_size() > most):
                continue
            if entry is self.schedule[0]:
                heappop(self.schedule)
            else:
                self.schedule.remove(entry)
                heapify(self.schedule)
            frame = self._serve(queue)
            if frame is not None:
                return queue, frame
        return None

    def _in_order(self) -> Iterator[tuple[int, int, TopicQueue]]:
        """Iterate over the schedule. The first entry, which is nearly always the one, costs no sorting."""
        if self.schedule:
            first = self.schedule[0]
            yield first
            yield from sorted(entry for entry in self.schedule if entry is not first)

    def _serve(self, queue: TopicQueue) -> Frame | None:
        """Remove and return the next frame of a queue that was taken from the schedule."""
        queue.scheduled = False
        self._drop_expired(queue)
        if not queue.begun and not queue.waiting:
            return None
        frame = queue.begun.popleft() if queue.begun else self._begin(queue)
        queue.size -= frame.size
        self.size -= frame.size
        # The position never goes back: queues that were idle compete from here on.
        self._position = max(self._position, queue.finish)
        # The tag counts this frame alone, so that fragments of a message take turns with other topics.
        queue.finish = self._position + frame.size
        self._last = max(self._last, queue.finish)
        if queue.begun or queue.waiting:
            self._schedule(queue)
        self._forgive()
        return frame

    def _forgive(self) -> None:
        """Reset the tags if nothing is queued: no topic is penalised for earlier traffic."""
        if not self.schedule:
            self._position = self._last

    def clear(self) -> None:
        for _, _, queue in self.schedule:
            queue.waiting.clear()
            queue.begun.clear()
            queue.size = 0
            queue.scheduled = False
        self.schedule.clear()
        self.size = 0
        self.messages = 0

    def _schedule(self, queue: TopicQueue) -> None:
        if not queue.scheduled:
            queue.scheduled = True
            self._entered += 1
            # Self-clocked fair queueing: a queue that was idle starts at the present position, so that it
            # cannot save up service, and a large frame postpones its own topic only.
            tag = max(self._position, queue.finish) + queue.next_size()
            heappush(self.schedule, (tag, self._entered, queue))

    def _begin(self, queue: TopicQueue) -> Frame:
        first, further, _ = queue.waiting.popleft()
        self.messages -= 1
        queue.begun.extend(further)
        return first

    def _drop_expired(self, queue: TopicQueue) -> None:
        waiting = queue.waiting
        # Only the front: later messages expire later, or wait until they are in front.
        while waiting and waiting[0][2] and waiting[0][2] < queue.time_ns():
            self._drop_oldest(queue, DropReason.LIFESPAN)

    def _make_room(self, queue: TopicQueue, size: int) -> None:
        """Drop old messages of at least `size` bytes: of this queue, or of the largest if this one is
        empty."""
        # Of its own queue a topic may lose all: the new message becomes its newest.
        victim, keep = (queue, 0) if queue.waiting else (self._largest_queue(), 1)
        freed = 0
        while victim is not None and len(victim.waiting) > keep and freed < max(size, 1):
            freed += self._drop_oldest(victim, DropReason.BACKLOG)

    def _largest_queue(self) -> TopicQueue | None:
        """Return the largest queue with more than one message; one with `keep_all` only if there is no
        other."""
        # Each topic keeps its newest message, whatever the others queue.
        rich = [queue for _, _, queue in self.schedule if len(queue.waiting) > 1]
        return max(rich, key=lambda queue: (not queue.rules.keep_all, queue.size), default=None)

    def count_drop(self, queue: TopicQueue, reason: DropReason) -> None:
        self.dropped[reason] = self.dropped.get(reason, 0) + 1
        if queue.on_drop is not None:
            queue.on_drop(reason)

    def _drop_oldest(self, queue: TopicQueue, reason: DropReason) -> int:
        first, further, _ = queue.waiting.popleft()
        size = first.size + sum(frame.size for frame in further)
        queue.size -= size
        self.size -= size
        self.messages -= 1
        self.count_drop(queue, reason)
        return size
