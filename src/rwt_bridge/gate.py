"""When a sample may go to one client: throttle and queue, by the THR rules."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from rwt_protocol.fragments import cut

if TYPE_CHECKING:
    from rwt_graph.clock import Clock, Timer
    from rwt_protocol.frames import Flow, Frame

#: Two clock readings this close, in seconds, are the same moment: sums of floats round.
_SAME_MOMENT = 1e-6


class Encoded(Protocol):
    """A sample on its way out. `frame` encodes it when first asked, once for all gates of a channel."""

    def frame(self) -> Frame:
        """The frame to send."""


class Gate:
    """One client's flow of one topic.

    * ``throttle == 0``: every sample at once (THR-01).
    * ``throttle > 0``, ``queue == 0``: at most one sample in `throttle` seconds, the others are dropped; no
      trailing delivery (THR-02).
    * ``throttle > 0``, ``queue > 0``: first in, first out, the oldest is dropped beyond `queue` (THR-03).

    Times count from the last sample sent, on the clock's steady time.
    """

    __slots__ = ("_clock", "_flow", "_last", "_queue", "_send", "_throttle", "_timer")

    def __init__(self, clock: Clock, flow: Flow) -> None:
        self._clock = clock
        self._flow = flow
        self._send = flow.send
        self._throttle = 0.0
        self._queue: deque[Encoded] = deque(maxlen=0)
        self._last = float("-inf")
        self._timer: Timer | None = None

    @property
    def is_open(self) -> bool:
        """Whether every sample passes, so that a caller may skip the gate and send at once."""
        return self._throttle == 0 and not self._queue

    @property
    def send(self) -> Callable[[Frame], None]:
        """Where the frames of an open gate go."""
        return self._send

    def cut_to(self, size: int) -> None:
        """Send what is longer than `size` characters in pieces; 0 sends everything whole (FRG-20)."""
        flow = self._flow

        def send_pieces(frame: Frame) -> None:
            flow.send_message(frame.pieces(size, cut))

        self._send = send_pieces if size else flow.send

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

    def offer(self, encoded: Encoded) -> None:
        """Take one sample: send it now, keep it for later, or drop it."""
        if not self._queue and self._due():
            self._last = self._clock.monotonic()
            self._send(encoded.frame())
        elif self._queue.maxlen:
            self._queue.append(encoded)
            if self._timer is None:
                self._start_timer()

    def close(self) -> None:
        """Drop what is queued (THR-07)."""
        self._stop_timer()
        self._queue.clear()

    def _due(self) -> bool:
        return self._clock.monotonic() - self._last >= self._throttle - _SAME_MOMENT

    def _send_due(self) -> None:
        while self._queue and self._due():
            encoded = self._queue.popleft()
            self._last = self._clock.monotonic()
            self._send(encoded.frame())

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
