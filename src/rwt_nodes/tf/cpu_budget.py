"""The share of the event loop's time that the streams may take."""

from __future__ import annotations

from collections.abc import Callable
from time import thread_time
from typing import Final

SHARE: Final = 0.25
"""Of the event loop's time, for all streams together: a client may ask for a thousand frames a hundred times
a second, and other clients must be served, too."""

_NEWEST: Final = 0.2
"""How much the last turn counts in what a turn usually takes: one that was held up must not slow a stream."""


class CpuBudget:
    """The processor time of one stream: it rests after each turn to stay within its part of :data:`SHARE`.

    Args:
        monotonic: seconds of the robot's clock.
        streams: how many there are.
        worked: seconds of processor time that this thread has taken.
    """

    def __init__(
        self,
        monotonic: Callable[[], float],
        streams: Callable[[], int],
        worked: Callable[[], float] = thread_time,
    ) -> None:
        self._monotonic = monotonic
        self._streams = streams
        self._worked = worked
        self._usual = 0.0
        self._rests_until = float("-inf")

    def turn(self, work: Callable[[], None]) -> None:
        """Do `work`, unless the stream rests."""
        now = self._monotonic()
        if now < self._rests_until:
            return
        began = self._worked()
        work()
        self._usual += _NEWEST * (self._worked() - began - self._usual)
        self._rests_until = now + self._usual * self._streams() / SHARE
