"""How late the event loop is: a timer that compares when it runs with when it should have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt_graph.clock import Clock, Timer

PERIOD: Final = 0.5
"""Seconds between two looks."""
BUCKETS: Final = (0.001, 0.005, 0.02, 0.1, 0.5, 2.0)
"""Upper bounds in seconds."""


class LoopLag:
    """A histogram of the lags.

    Attributes:
        counts: looks whose lag was at most the bucket's bound and above that of the one before; the last
            count is of the lags above all bounds.
        total: the sum of all lags, in seconds.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.counts = [0] * (len(BUCKETS) + 1)
        self.total = 0.0
        self._due = clock.monotonic() + PERIOD
        self._timer: Timer = clock.call_later(PERIOD, self._look)

    def close(self) -> None:
        """Look no more."""
        self._timer.cancel()

    def _look(self) -> None:
        now = self._clock.monotonic()
        lag = max(0.0, now - self._due)
        self.total += lag
        self.counts[sum(lag > bound for bound in BUCKETS)] += 1
        self._due = now + PERIOD
        self._timer = self._clock.call_later(PERIOD, self._look)
