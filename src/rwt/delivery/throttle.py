"""Throttle of one client's topic: rate, queue and lifespan, by the THR rules."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from rwt.delivery.drop_notices import SAME_MOMENT, DeadlineWatch
from rwt_graph.api import EndpointInfo
from rwt_graph.clock import Clock
from rwt_interfaces.payload import Form
from rwt_participant.qos import History, Reliability
from rwt_participant.timers import Timer
from rwt_protocol.fragments import cut
from rwt_protocol.frames import Burst, Frame
from rwt_transports.endpoint import AS_MANY_AS_FIT, DropReason, FeedFlow, Flow, FlowRules, Membership


def _refuse(_burst: Burst) -> bool:
    return False


class Content(Protocol):
    """Content of a sample."""

    @property
    def is_long(self) -> bool:
        """True if encoding it takes steps."""

    @property
    def kept_size(self) -> int:
        """Bytes that keeping it takes."""

    def prepare(self, forms: Iterable[Form]) -> Iterator[None]:
        """Take the steps."""


class Deliverable(Protocol):
    """What is delivered: a sample of the graph, or one that another server has encoded."""

    @property
    def payload(self) -> Content:
        """Content."""

    @property
    def stamp_ns(self) -> int:
        """Time of publishing, in nanoseconds since the epoch."""

    @property
    def expires_ns(self) -> int:
        """Time until which it is delivered; 0 for no limit."""


_SendTo = Callable[[Callable[["Frame"], None]], None]
"""Passes the frame of a sample to a function: now, or once it is encoded."""


@dataclass(slots=True, eq=False)
class Room:
    """Bytes that the throttles of one client may still queue together."""

    left: int


class Throttle:
    """Flow of one topic to one client.

    * ``throttle == 0``: every sample at once (THR-01); what waits then, waits for the network, in the flow,
      whose own rules bound it (THR-04).
    * ``throttle > 0``, ``queue == 0``: at most one sample in `throttle` seconds, the others are dropped; no
      trailing delivery (THR-02).
    * ``throttle > 0``, ``queue > 0``: first in, first out, the oldest is dropped beyond `queue` (THR-03).

    Times count from the last sample sent, on the clock's steady time. Nothing that has expired is sent.

    Args:
        withheld: called for each sample that the throttle holds back and drops.
        expired: called for each sample that outlived its lifespan here.
    """

    __slots__ = (
        "_behind", "_clock", "_deadline", "_expired", "_flow", "_is_closed", "_is_muted", "_last",
        "_lifespan_ns", "_piece", "_queue", "_room", "_taken", "_throttle", "_timer", "_withheld",
    )  # fmt: skip

    def __init__(
        self,
        clock: Clock,
        flow: Flow,
        withheld: Callable[[DropReason], None],
        expired: Callable[[DropReason], None],
        room: Room,
    ) -> None:
        self._clock = clock
        self._room = room
        self._flow = flow
        self._piece = 0
        self._withheld = withheld
        self._expired = expired
        self._throttle = 0.0
        self._lifespan_ns = 0
        self._deadline: DeadlineWatch | None = None
        self._queue: deque[tuple[Deliverable, _SendTo, int]] = deque(maxlen=0)
        self._taken = 0
        self._behind: dict[Hashable, tuple[int, Callable[[], None]]] = {}
        self._last = float("-inf")
        self._timer: Timer | None = None
        self._is_closed = self._is_muted = False

    @property
    def is_open(self) -> bool:
        """True if every sample passes, so that callers may bypass the throttle."""
        return not (self._throttle or self._queue or self._lifespan_ns or self._deadline or self._is_muted)

    @property
    def asked(self) -> tuple[float, int] | None:
        """Minimum seconds between samples and length of the queue; None if the client wants more than that,
        which only this throttle can give."""
        if self._piece or self._lifespan_ns or self._deadline or self._is_muted:
            return None
        return self._throttle, self._queue.maxlen or 0

    def enter(self, key: Hashable) -> Membership | None:
        """Become a member of a feed, if the client shares its line with others."""
        return self._flow.enter(key) if isinstance(self._flow, FeedFlow) else None

    @property
    def send(self) -> Callable[[Frame], None]:
        """Function that sends the frames of an open throttle."""
        return self._send_pieces if self._piece else self._flow.send

    @property
    def join(self) -> Callable[[Burst], bool]:
        """Function that queues a burst of an open throttle; fragmented messages are sent separately."""
        return _refuse if self._piece else self._flow.join

    def mute(self, is_muted: bool) -> None:
        """Ignore samples from now on, because the client gets others in their place, or no longer."""
        self._is_muted = is_muted

    def cut_to(self, size: int) -> None:
        """Send messages of more than `size` characters in fragments; 0: never (FRG-20)."""
        self._piece = size

    def _send_pieces(self, frame: Frame) -> None:
        self._flow.send_message(frame.pieces(self._piece, cut))

    def configure(self, throttle: float, queue: int) -> None:
        """Set the throttle in seconds and the queue's length in samples.

        The time of the last sending stays, and of the queue the newest that fit (THR-06).
        """
        self._throttle = max(0.0, throttle)
        self._stop_timer()
        while queue and len(self._queue) > queue:
            self._pop()
        self._queue = deque(self._queue)
        self._send_due()
        while not queue and self._queue:
            self._pop()
        self._queue = deque(self._queue, maxlen=queue)
        self._call_behind()
        if self._queue:
            self._start_timer()

    def flush(self) -> None:
        """Send what is queued, sooner than the throttle would."""
        self._stop_timer()
        while self._queue:
            self._send(*self._pop())

    def call_behind(self, key: Hashable, call: Callable[[], None]) -> None:
        """Call a function once the samples that are queued now have been sent or dropped.

        It replaces the function of that key. :meth:`forget` forgets it.
        """
        self.forget(key)
        self._behind[key] = (self._taken + len(self._queue), call)
        self._call_behind()

    def forget(self, key: Hashable) -> None:
        """Forget a function of :meth:`call_behind`."""
        self._behind.pop(key, None)

    def _call_behind(self) -> None:
        for key, (taken, call) in tuple(self._behind.items()) if self._behind else ():
            if taken > self._taken:
                return
            del self._behind[key]
            call()

    def note_sent(self, at: float) -> None:
        """Note that the last sample bypassed the open throttle at the monotonic time `at` (THR-06)."""
        # Never backwards: the throttle may have sent since, by its own count.
        self._last = max(self._last, at)

    def watch(self, lifespan_ns: int, deadline: DeadlineWatch | None) -> None:
        """Drop samples older than `lifespan_ns` (0: any age), and notify `deadline` of every sample."""
        self._lifespan_ns = lifespan_ns
        if self._deadline is not None:
            self._deadline.close()
        self._deadline = deadline

    def offer(self, sample: Deliverable, send_to: _SendTo) -> None:
        """Process one sample: send it now, queue it, or drop it."""
        if self._is_muted:
            return
        if self._deadline is not None:
            self._deadline.met()
        # Not past queued samples, even if one is due: the order of a topic is kept.
        if not self._queue and self._due():
            self._send(sample, send_to)
        elif self._queue.maxlen:
            self._enqueue(sample, send_to)
        else:
            self._withheld(DropReason.THROTTLE)

    def _enqueue(self, sample: Deliverable, send_to: _SendTo) -> None:
        """Queue a sample; older ones of its topic are dropped to make room."""
        size = sample.payload.kept_size
        full = len(self._queue) == self._queue.maxlen
        while self._queue and (full or self._room.left < size):
            self._pop()
            self._withheld(DropReason.QUEUE)
            full = False
        self._call_behind()
        if self._room.left < size:
            self._withheld(DropReason.QUEUE)
            return
        self._room.left -= size
        self._queue.append((sample, send_to, size))
        if self._timer is None:
            self._start_timer()

    def _pop(self) -> tuple[Deliverable, _SendTo]:
        sample, send_to, size = self._queue.popleft()
        self._taken += 1
        self._room.left += size
        return sample, send_to

    def close(self) -> None:
        """Drop queued samples, and those being encoded (THR-07)."""
        self._is_closed = True
        self._behind.clear()
        self._stop_timer()
        while self._queue:
            self._pop()
        self.watch(0, None)

    def _due(self) -> bool:
        return self._clock.monotonic() - self._last >= self._throttle - SAME_MOMENT

    def _send_due(self) -> None:
        while self._queue and self._due():
            self._send(*self._pop())
            self._call_behind()

    def _send(self, sample: Deliverable, send_to: _SendTo) -> None:
        expires_ns = self._expiry(sample)
        if expires_ns and expires_ns < self._clock.time_ns():
            # An expired sample does not count as sent: the next one need not wait for the throttle.
            self._expired(DropReason.LIFESPAN)
            return
        self._last = self._clock.monotonic()
        send_to(partial(self._send_frame, expires_ns))

    def _send_frame(self, expires_ns: int, frame: Frame) -> None:
        # Closed while the sample was being encoded.
        if not self._is_closed:
            self._flow.send_message(frame.pieces(self._piece, cut) if self._piece else (frame,), expires_ns)

    def _expiry(self, sample: Deliverable) -> int:
        """Return the end of the publisher's or the subscriber's lifespan, whichever is sooner; 0: never."""
        if not self._lifespan_ns:
            return sample.expires_ns
        own = sample.stamp_ns + self._lifespan_ns
        return min(own, sample.expires_ns) if sample.expires_ns else own

    def _start_timer(self) -> None:
        wait = self._last + self._throttle - self._clock.monotonic()
        self._timer = self._clock.call_later(max(0.0, wait), self._on_timer)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _on_timer(self) -> None:
        self._timer = None
        self._send_due()
        if self._queue:
            self._start_timer()


def rules_as_published(publishers: Iterable[EndpointInfo]) -> FlowRules:
    """Return the queue rules of a topic: sensor streams keep the newest, others what fits (SUB-17)."""
    offers = [each.qos for each in publishers]
    lossy = [
        qos
        for qos in offers
        if qos.reliability is Reliability.BEST_EFFORT and qos.history is History.KEEP_LAST
    ]
    # One reliable publisher suffices for a queue without a bound of its own: its samples may not be lost.
    if offers and len(lossy) == len(offers):
        return FlowRules(max(1, *(qos.depth for qos in lossy)))
    return AS_MANY_AS_FIT
