"""When a sample may go to one client: throttle and queue, by the THR rules, and how old it may be."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from rwt_protocol.fragments import cut
from rwt_protocol.transport import DropReason

if TYPE_CHECKING:
    from rwt_delivery.deadline import DeadlineWatch
    from rwt_graph.api import Sample
    from rwt_graph.clock import Clock, Timer
    from rwt_protocol.transport import Flow, Frame

#: Two clock readings this close, in seconds, are the same moment: sums of floats round.
_SAME_MOMENT = 1e-6


class Encoded(Protocol):
    """A sample on its way out. `frame` encodes it when first asked, once for all gates of a channel."""

    @property
    def sample(self) -> Sample:
        """The sample itself."""

    def frame(self) -> Frame:
        """The frame to send; asked for each time one is sent."""


class Throttle:
    """One client's flow of one topic.

    * ``throttle == 0``: every sample at once (THR-01); what waits then, waits for the network, in the flow,
      whose own rules bound it (THR-04).
    * ``throttle > 0``, ``queue == 0``: at most one sample in `throttle` seconds, the others are dropped; no
      trailing delivery (THR-02).
    * ``throttle > 0``, ``queue > 0``: first in, first out, the oldest is dropped beyond `queue` (THR-03).

    Times count from the last sample sent, on the clock's steady time. Nothing that has expired is sent.

    Args:
        clock: the graph's.
        flow: where frames go.
        withheld: hears of samples that the throttle keeps back.
        expired: hears of samples that outlived their lifespan in here.
    """

    __slots__ = (
        "_clock", "_deadline", "_expired", "_flow", "_last", "_lifespan_ns", "_piece", "_queue", "_throttle",
        "_timer", "_withheld",
    )  # fmt: skip

    def __init__(
        self,
        clock: Clock,
        flow: Flow,
        withheld: Callable[[DropReason], None],
        expired: Callable[[DropReason], None],
    ) -> None:
        self._clock = clock
        self._flow = flow
        self._piece = 0
        self._withheld = withheld
        self._expired = expired
        self._throttle = 0.0
        self._lifespan_ns = 0
        self._deadline: DeadlineWatch | None = None
        self._queue: deque[Encoded] = deque(maxlen=0)
        self._last = float("-inf")
        self._timer: Timer | None = None

    @property
    def is_open(self) -> bool:
        """Whether every sample passes, so that a caller may skip the gate and send at once."""
        return not (self._throttle or self._queue or self._lifespan_ns or self._deadline)

    @property
    def send(self) -> Callable[[Frame], None]:
        """Where the frames of an open gate go."""
        return self._send_pieces if self._piece else self._flow.send

    def cut_to(self, size: int) -> None:
        """Send what is longer than `size` characters in pieces; 0 sends everything whole (FRG-20)."""
        self._piece = size

    def _send_pieces(self, frame: Frame) -> None:
        self._flow.send_message(frame.pieces(self._piece, cut))

    def configure(self, throttle: float, queue: int) -> None:
        """Set the throttle in seconds and the queue's length in samples.

        The time of the last sending stays, and of the queue the newest that fit (THR-06).
        """
        self._throttle = max(0.0, throttle)
        self._stop_timer()
        kept = list(self._queue)[-queue:] if queue else self._queue
        self._queue = deque(kept)
        self._send_due()
        self._queue = deque(self._queue if queue else (), maxlen=queue)
        if self._queue:
            self._start_timer()

    def note_sent(self, at: float) -> None:
        """A sample went past the gate while it was open, `at` seconds of the clock's steady time (THR-06)."""
        self._last = max(self._last, at)

    def watch(self, lifespan_ns: int, deadline: DeadlineWatch | None) -> None:
        """Send nothing older than `lifespan_ns` (0: any age), and tell `deadline` of every sample."""
        self._lifespan_ns = lifespan_ns
        if self._deadline is not None:
            self._deadline.close()
        self._deadline = deadline

    def offer(self, encoded: Encoded) -> None:
        """Take one sample: send it now, keep it for later, or drop it."""
        if self._deadline is not None:
            self._deadline.met()
        if not self._queue and self._due():
            self._send(encoded)
        elif self._queue.maxlen:
            if len(self._queue) == self._queue.maxlen:
                self._withheld(DropReason.QUEUE)
            self._queue.append(encoded)
            if self._timer is None:
                self._start_timer()
        else:
            self._withheld(DropReason.THROTTLE)

    def close(self) -> None:
        """Drop what is queued (THR-07)."""
        self._stop_timer()
        self._queue.clear()
        self.watch(0, None)

    def _due(self) -> bool:
        return self._clock.monotonic() - self._last >= self._throttle - _SAME_MOMENT

    def _send_due(self) -> None:
        while self._queue and self._due():
            self._send(self._queue.popleft())

    def _send(self, encoded: Encoded) -> None:
        expires_ns = self._expiry(encoded.sample)
        if expires_ns and expires_ns < self._clock.time_ns():
            self._expired(DropReason.LIFESPAN)
            return
        self._last = self._clock.monotonic()
        frame = encoded.frame()
        self._flow.send_message(frame.pieces(self._piece, cut) if self._piece else (frame,), expires_ns)

    def _expiry(self, sample: Sample) -> int:
        """The end of the publisher's lifespan or of the subscriber's, whichever is sooner; 0: never."""
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
