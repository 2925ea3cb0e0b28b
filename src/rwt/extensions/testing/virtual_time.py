"""Virtual time: advances only when a test says so, and runs everything that is due on the way."""

from __future__ import annotations

import anyio
import anyio.lowlevel
from anyio.from_thread import BlockingPortal

from rwt_graph.clock import SimulatedClock
from rwt_interfaces.times import NANOSECONDS

#: Turns of the event loop after which most chains of wake-ups have ended.
_TURNS = 8


class VirtualTime:
    """Moves a graph's simulated clock from another thread, timer by timer.

    Between two timers, every coroutine runs until it waits again, so events happen in the order of their
    times. Ten seconds pass in milliseconds.
    """

    def __init__(self, clock: SimulatedClock, portal: BlockingPortal) -> None:
        self._clock = clock
        self._portal = portal

    def advance(self, seconds: float) -> None:
        """Advance the clock by `seconds`, and wait until everything due in them is done.

        Raises:
            ValueError: `seconds` is negative.
        """
        if seconds < 0:
            raise ValueError(f"time cannot be advanced by {seconds} s")
        self._portal.call(advance, self._clock, seconds)

    def settle(self) -> None:
        """Wait until every coroutine of the robot waits; the clock stands still."""
        self._portal.call(settle)

    def time_ns(self) -> int:
        """Return ROS time, nanoseconds since the epoch."""
        return self._clock.time_ns()

    def monotonic(self) -> float:
        """Return the seconds that have passed for the robot."""
        return self._clock.monotonic()


async def advance(clock: SimulatedClock, seconds: float) -> None:
    """Like :meth:`VirtualTime.advance`, on the graph's own event loop."""
    left_ns = round(seconds * NANOSECONDS)
    await settle()
    while True:
        until = clock.until_next()
        step_ns = left_ns if until is None else round(until * NANOSECONDS)
        if until is None or step_ns > left_ns:
            break
        clock.advance(step_ns / NANOSECONDS)
        left_ns -= step_ns
        await settle()
    clock.advance(left_ns / NANOSECONDS)
    await settle()


async def settle() -> None:
    """Wait until every other task waits."""
    # These turns are usually enough; waiting for the rest costs a tenth of a second.
    for _ in range(_TURNS):
        await anyio.lowlevel.checkpoint()
    await anyio.wait_all_tasks_blocked()
