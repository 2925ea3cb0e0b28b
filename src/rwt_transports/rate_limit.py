"""Rate limit of everything that is counted: messages, log lines, bytes of an audit, checks, audio."""

from __future__ import annotations


class RateLimit:
    """Rate limit of events, or of amounts such as bytes: a burst, and `rate` per second in the long run.

    The token bucket is stored as the time at which it is full again, so that an idle limit costs nothing.

    Args:
        rate: events per second in the long run, or amounts.
        burst: maximum number of events at once.
    """

    __slots__ = ("_full", "_interval", "_tolerance")

    def __init__(self, rate: float, burst: float) -> None:
        self._interval = 1 / rate  # seconds
        # Half an event more, since sums of floats round. Amounts need a unit of which half is negligible.
        self._tolerance = (burst + 0.5) / rate
        self._full = float("-inf")

    def take(self, now: float, amount: float = 1) -> bool:
        """Return True if that much more is within the limit; `now` in seconds on a monotonic clock."""
        full = self._full
        full = (full if full > now else now) + self._interval * amount
        if full - now > self._tolerance:
            return False
        self._full = full
        return True

    def give_back(self, amount: float = 1) -> None:
        """Undo the last :meth:`take` of that amount."""
        self._full -= self._interval * amount

    def is_full(self, now: float) -> bool:
        """Return True if the whole burst is available."""
        return self._full <= now
