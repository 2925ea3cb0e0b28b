"""Timers that repeat."""

from __future__ import annotations

import logging
import math
from collections.abc import Awaitable, Callable
from typing import Final

from rwt_graph.api import Graph
from rwt_graph.clock import Timer
from rwt_program.messages import is_coroutine_function

logger = logging.getLogger(__name__)

#: Seconds; a clock has whole nanoseconds, and a shorter period would leave it no time for anything else.
SHORTEST_PERIOD: Final = 1e-6


class PeriodicTimer(Timer):
    """Calls back every `period` seconds of the graph's clock, on a grid that does not drift."""

    def __init__(
        self,
        graph: Graph,
        period: float,
        callback: Callable[[], Awaitable[None] | None],
        on_cancel: Callable[[PeriodicTimer], None],
    ) -> None:
        self._graph = graph
        self._period = period
        self._callback = callback
        self._is_coroutine = is_coroutine_function(callback)
        self._on_cancel = on_cancel
        self._started_at = 0.0
        self._tick = 0
        self._timer: Timer | None = None
        self._busy = False
        self._cancelled = False

    def start(self) -> None:
        """Start the timer; the first call is one period away."""
        self._started_at = self._graph.clock.monotonic()
        self._arm()

    def _arm(self) -> None:
        now = self._graph.clock.monotonic()
        # 1e-9: a timer that fires exactly on its tick must not take the rounding for a missed one.
        self._tick = max(self._tick + 1, math.ceil((now - self._started_at) / self._period - 1e-9))
        due = self._started_at + self._tick * self._period
        self._timer = self._graph.clock.call_later(max(0.0, due - now), self._fire)

    def _fire(self) -> None:
        if self._cancelled:
            return
        self._arm()
        if self._busy:
            return
        if self._is_coroutine:
            self._busy = True
            self._graph.spawn(self._call_in_task, "timer")
            return
        try:
            self._callback()
        except Exception:
            logger.exception("a timer's callback failed")

    async def _call_in_task(self) -> None:
        try:
            returned = self._callback()
            if returned is not None:
                await returned
        finally:
            self._busy = False

    def cancel(self) -> None:
        """Stop the timer, from any thread; a coroutine callback that has begun goes on."""
        self._cancelled = True
        if self._graph.on_graph_thread():
            self._stop()
        else:
            self._graph.run_on_graph(self._stop)

    def _stop(self) -> None:
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
        self._on_cancel(self)
