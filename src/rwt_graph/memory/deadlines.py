"""Timeouts of very many calls with one timer.

A service call at full load lives microseconds and has a timeout of seconds. A heap entry for each would be
most of the call's cost, and 100,000 calls a second would leave half a million dead entries behind. Here a
deadline is put in the set of its tick, and taken out when the call ends; one timer visits the ticks.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from heapq import heappop, heappush

from rwt_graph.clock import Clock, Timer

#: Ticks a second: a deadline is kept to within 1 / this, and never early.
TICKS = 50


class Expiring(ABC):
    """Something that has a deadline."""

    __slots__ = ()

    @abstractmethod
    def expire(self) -> None:
        """The deadline has passed."""


class Deadlines:
    """The deadlines of one graph."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._ticks: dict[int, set[Expiring]] = {}
        self._order: list[int] = []
        self._timer: Timer | None = None
        self._armed_for = 0

    def add(self, item: Expiring, timeout: float) -> set[Expiring]:
        """Expire `item` in `timeout` seconds; to prevent it, discard it from the set that is returned."""
        tick = math.ceil((self._clock.monotonic() + max(0.0, timeout)) * TICKS)
        due = self._ticks.get(tick)
        if due is None:
            due = self._ticks[tick] = set()
            heappush(self._order, tick)
            self._arm()
        due.add(item)
        return due

    def _arm(self) -> None:
        first = self._order[0]
        if self._timer is not None:
            if self._armed_for <= first:
                return
            self._timer.cancel()
        self._armed_for = first
        self._timer = self._clock.call_later(first / TICKS - self._clock.monotonic(), self._sweep)

    def _sweep(self) -> None:
        self._timer = None
        now = math.floor(self._clock.monotonic() * TICKS + 1e-6)
        while self._order and self._order[0] <= now:
            for item in tuple(self._ticks.pop(heappop(self._order))):
                item.expire()
        if self._order and self._timer is None:
            self._arm()


__all__ = ["TICKS", "Deadlines", "Expiring"]
