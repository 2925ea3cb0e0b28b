"""Detection of missed deadlines: one timer, and one clock reading per message."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt_graph.clock import Clock
    from rwt_participant.timers import Timer

SHORTEST: Final = 0.01
"""Minimum deadline in seconds; shorter ones count as this."""
_SAME_MOMENT: Final = 1e-6
"""Tolerance of clock readings in seconds, because sums of floats round."""


class DeadlineWatch:
    """Watchdog that calls `on_missed` once for each period of `seconds` without a call of :meth:`met`."""

    __slots__ = ("_clock", "_last", "_on_missed", "_seconds", "_timer")

    def __init__(self, clock: Clock, seconds: float, on_missed: Callable[[], None]) -> None:
        self._clock = clock
        self._seconds = max(seconds, SHORTEST)
        self._on_missed = on_missed
        self._last = clock.monotonic()
        self._timer: Timer | None = clock.call_later(self._seconds, self._look)

    def met(self) -> None:
        """Note a message."""
        self._last = self._clock.monotonic()

    def close(self) -> None:
        """Stop watching."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self) -> None:
        now = self._clock.monotonic()
        left = self._last + self._seconds - now
        if left <= _SAME_MOMENT:
            self._last = now
            left = self._seconds
            self._on_missed()
        if self._timer is not None:
            self._timer = self._clock.call_later(left, self._look)
