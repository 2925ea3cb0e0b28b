"""The samples that wait for a slow reader: whose turn it is, and what is dropped.

Each topic is a :class:`Queue` of its own. The lane serves them by start-time fair queueing with finish tags:
a frame's tag is where its queue stood, or where the lane stands if that is further, plus the frame's size,
and the smallest tag goes first. So topics share the connection by bytes, and a small message is not behind
any large one except the one being written, however many and how large the others are.

What exceeds a bound costs the oldest message of the same topic. Only a topic that has nothing waiting takes
the place of others: of the one that holds most, which keeps its newest. Order within a topic always holds,
and a message in several frames is sent whole or not at all.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from heapq import heappop, heappush

from rwt_protocol.frames import Frame
from rwt_transports.endpoint import DropReason, FlowRules
from rwt_transports.limits import Limits

_Message = tuple[Frame, tuple[Frame, ...], int]
"""What waits: its first frame, the further ones, and when it expires (0: never)."""


class Queue:
    """The messages of one topic that wait, oldest first.

    Attributes:
        rules: how it is treated.
        on_drop: called for each message that is dropped.
    """

    __slots__ = ("begun", "finish", "on_drop", "rules", "scheduled", "size", "time_ns", "topic", "waiting")

    def __init__(
        self,
        topic: str,
        rules: FlowRules,
        on_drop: Callable[[DropReason], None] | None,
        time_ns: Callable[[], int],
    ) -> None:
        self.topic = topic
        self.rules = rules
        self.on_drop = on_drop
        self.time_ns = time_ns
        self.waiting: deque[_Message] = deque()
        self.begun: deque[Frame] = deque()  # what is left of a message whose first frame has gone out
        self.size = 0
        self.finish = 0
        self.scheduled = False

    def next_size(self) -> int:
        """The size of the frame that is next."""
        return self.begun[0].size if self.begun else self.waiting[0][0].size if self.waiting else 0


class DataLane:
    """Every queue of one connection.

    Attributes:
        schedule: heap of the queues that wait, by tag; empty if nothing waits.
        size: bytes that wait.
        messages: whole messages that wait.
        dropped: messages dropped so far, by reason.
    """

    __slots__ = ("_entered", "_last", "_limits", "_position", "dropped", "messages", "schedule", "size")

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self.schedule: list[tuple[int, int, Queue]] = []
        self._entered = 0  # breaks ties between equal tags: first come, first served
        self._position = 0
        self._last = 0
        self.size = 0
        self.messages = 0
        self.dropped: dict[DropReason, int] = {}

    def add(self, queue: Queue, pieces: Sequence[Frame], expires_ns: int) -> None:
        """Let one message wait, and drop what that is too much for."""
        size = sum(frame.size for frame in pieces)
        depth = queue.rules.depth
        if depth is not None:
            self.cut(queue, max(depth, 1) - 1)
        limits = self._limits
        full = self.size >= limits.data_bytes or self.messages >= limits.data_frames
        if full and not queue.rules.notes:
            self._make_place(queue, size)
        queue.waiting.append((pieces[0], tuple(pieces[1:]), expires_ns))
        queue.size += size
        self.size += size
        self.messages += 1
        self._schedule(queue)

    def add_begun(self, queue: Queue, pieces: Sequence[Frame]) -> None:
        """Let the rest of a message wait that has begun to go out."""
        size = sum(frame.size for frame in pieces)
        queue.begun.extend(pieces)
        queue.size += size
        self.size += size
        self._schedule(queue)

    def cut(self, queue: Queue, depth: int) -> None:
        """Drop all but the newest `depth` messages of a queue."""
        while len(queue.waiting) > depth:
            self._drop_oldest(queue, DropReason.QUEUE)

    def next(self) -> Frame | None:
        """Take the frame whose turn it is; None if nothing waits, or nothing that has not expired."""
        while self.schedule:
            _, _, queue = heappop(self.schedule)
            queue.scheduled = False
            self._drop_expired(queue)
            if not queue.begun and not queue.waiting:
                continue
            frame = queue.begun.popleft() if queue.begun else self._begin(queue)
            queue.size -= frame.size
            self.size -= frame.size
            self._position = max(self._position, queue.finish)
            queue.finish = self._position + frame.size
            self._last = max(self._last, queue.finish)
            if queue.begun or queue.waiting:
                self._schedule(queue)
            self._forgive()
            return frame
        self._forgive()
        return None

    def _forgive(self) -> None:
        """Start afresh if nothing waits: no topic owes anything from the time before."""
        if not self.schedule:
            self._position = self._last

    def clear(self) -> None:
        """Drop everything that waits, without a report."""
        for _, _, queue in self.schedule:
            queue.waiting.clear()
            queue.begun.clear()
            queue.size = 0
            queue.scheduled = False
        self.schedule.clear()
        self.size = 0
        self.messages = 0

    def _schedule(self, queue: Queue) -> None:
        if not queue.scheduled:
            queue.scheduled = True
            self._entered += 1
            tag = max(self._position, queue.finish) + queue.next_size()
            heappush(self.schedule, (tag, self._entered, queue))

    def _begin(self, queue: Queue) -> Frame:
        first, further, _ = queue.waiting.popleft()
        self.messages -= 1
        queue.begun.extend(further)
        return first

    def _drop_expired(self, queue: Queue) -> None:
        """Drop the messages in front that have outlived their lifespan."""
        waiting = queue.waiting
        while waiting and waiting[0][2] and waiting[0][2] < queue.time_ns():
            self._drop_oldest(queue, DropReason.LIFESPAN)

    def _make_place(self, queue: Queue, size: int) -> None:
        """Drop old messages worth `size` bytes: the queue's own, or another's where it has none."""
        victim, keep = (queue, 0) if queue.waiting else (self._largest_queue(), 1)
        freed = 0
        while victim is not None and len(victim.waiting) > keep and freed < max(size, 1):
            freed += self._drop_oldest(victim, DropReason.BACKLOG)

    def _largest_queue(self) -> Queue | None:
        """The queue that holds most bytes among those that have more than their newest message; one that
        keeps all only where there is no other."""
        rich = [queue for _, _, queue in self.schedule if len(queue.waiting) > 1]
        return max(rich, key=lambda queue: (not queue.rules.keep_all, queue.size), default=None)

    def leave_out(self, queue: Queue, reason: DropReason) -> None:
        """Count a message of `queue` that is not even let in."""
        self.dropped[reason] = self.dropped.get(reason, 0) + 1
        if queue.on_drop is not None:
            queue.on_drop(reason)

    def _drop_oldest(self, queue: Queue, reason: DropReason) -> int:
        """Returns the bytes freed."""
        first, further, _ = queue.waiting.popleft()
        size = first.size + sum(frame.size for frame in further)
        queue.size -= size
        self.size -= size
        self.messages -= 1
        self.leave_out(queue, reason)
        return size
