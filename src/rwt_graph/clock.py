"""ROS time, steady time and timers: real or simulated.

Each clock has one heap of timers. Those of wall and steady clocks are run by a single task of the running
graph (:meth:`Clock.drive`); a simulated clock runs its timers within :meth:`SimulatedClock.advance`, without
an event loop.

Everything except `time_ns` and `monotonic` belongs to the graph's own thread.
"""

from __future__ import annotations

import logging
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from heapq import heapify, heappop, heappush
from typing import Final

import anyio

from rwt_interfaces.times import NANOSECONDS
from rwt_participant.timers import LONGEST_DELAY, Timer

logger = logging.getLogger(__name__)

#: Cancelled timers in a heap, above which it is rebuilt if they are more than half of it.
COMPACT_AT = 64

#: Maximum ROS time in nanoseconds: messages have a signed 32-bit field for its seconds.
END_OF_TIME_NS: Final = 2**31 * NANOSECONDS


class HeapTimer(Timer):
    """Entry of a :class:`TimerHeap`; `due` is in the heap's own unit."""

    __slots__ = ("call", "due", "heap", "order")

    def __init__(self, due: float, order: int, call: Callable[[], None], heap: TimerHeap) -> None:
        self.due = due
        self.order = order
        self.call: Callable[[], None] | None = call
        self.heap = heap

    def __lt__(self, other: HeapTimer) -> bool:
        return (self.due, self.order) < (other.due, other.order)

    def cancel(self) -> None:
        """Drop the call. The entry is removed when it is due, or when the heap is rebuilt."""
        if self.call is not None:
            self.call = None
            self.heap.count_cancelled()


_TIMERS_SECONDS: Final = 0.005
"""Maximum seconds per turn of the event loop for due timers; the others wait for the next turn."""


class TimerHeap:
    """Timers by due time; those due at the same time run in the order they were made."""

    def __init__(self) -> None:
        self._heap: list[HeapTimer] = []
        self._order = 0
        self._cancelled = 0

    def __len__(self) -> int:
        return len(self._heap) - self._cancelled

    def push(self, due: float, call: Callable[[], None]) -> HeapTimer:
        self._order += 1
        timer = HeapTimer(due, self._order, call, self)
        heappush(self._heap, timer)
        return timer

    def count_cancelled(self) -> None:
        """Count a cancelled entry, and rebuild the heap if there are too many."""
        self._cancelled += 1
        if self._cancelled >= COMPACT_AT and self._cancelled * 2 > len(self._heap):
            self._heap = [timer for timer in self._heap if timer.call is not None]
            heapify(self._heap)
            self._cancelled = 0

    def next_due(self) -> float:
        """Return the time when the next timer is due; infinity if there is none."""
        while self._heap and self._heap[0].call is None:
            heappop(self._heap)
            self._cancelled -= 1
        return self._heap[0].due if self._heap else math.inf

    def run_next(self) -> None:
        """Run the first timer. Exceptions of its callback are logged."""
        timer = heappop(self._heap)
        call, timer.call = timer.call, None
        if call is None:
            self._cancelled -= 1
            return
        try:
            call()
        except Exception:
            logger.exception("a timer's callback failed")


def _bounded(seconds: float) -> float:
    return min(max(0.0, seconds), LONGEST_DELAY)


class Playback(ABC):
    """Recording that a clock follows, and its state. It is controlled by the services of its node.

    Attributes:
        node: absolute name of the node that plays the recording.
        start_ns: start of the recording, nanoseconds since the epoch.
        end_ns: end of the recording, nanoseconds since the epoch.
        rate: recorded seconds per second.
        seeks: number of jumps to another time.
    """

    node: str
    start_ns: int
    end_ns: int
    rate: float
    seeks: int

    @property
    @abstractmethod
    def position_ns(self) -> int:
        """Current position, nanoseconds since the epoch."""

    @property
    @abstractmethod
    def paused(self) -> bool:
        """True if it is paused."""


class Clock(ABC):
    """Clock of a graph: ROS time, steady time and timers.

    Attributes:
        is_real: True if ROS time is real time.
        playback: recording that ROS time is taken from; None without one.
    """

    is_real: bool = True
    playback: Playback | None = None

    @abstractmethod
    def time_ns(self) -> int:
        """Return ROS time, nanoseconds since the epoch."""

    @abstractmethod
    def monotonic(self) -> float:
        """Return seconds of a monotonic clock, by which timers and timeouts are measured."""

    def boottime(self) -> float:
        """Return seconds like :meth:`monotonic`, plus the time for which the machine was suspended."""
        return self.monotonic()

    @abstractmethod
    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        """Run `call` once, `delay` seconds from now, at most :data:`LONGEST_DELAY`.

        A delay that is zero, negative or NaN means the clock's next turn.
        """

    def call_urgently(self, delay: float, call: Callable[[], None]) -> Timer:
        """Like :meth:`call_later`, ahead of all other timers that are due.

        For a few short calls that others must not delay, such as those that stop a robot.
        """
        return self.call_later(delay, call)

    @abstractmethod
    async def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of this clock."""

    @contextmanager
    def within(self, seconds: float | None) -> Iterator[None]:
        with anyio.CancelScope() as scope:
            timer = None if seconds is None else self.call_later(seconds, scope.cancel)
            try:
                yield
            finally:
                if timer is not None:
                    timer.cancel()

    @abstractmethod
    async def drive(self) -> None:
        """Run due timers until cancelled; called by one task of a running graph."""


#: Elsewhere than on Linux, the monotonic clock.
_boottime: Final[Callable[[], float]] = (
    partial(time.clock_gettime, time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic
)


class SteadyClock(Clock):
    """Real time that never jumps: the wall's time at construction plus the time elapsed since."""

    def __init__(self) -> None:
        self._timers = TimerHeap()
        self._urgent = TimerHeap()
        self._offset_ns = time.time_ns() - time.monotonic_ns()
        self._wake: anyio.Event | None = None
        self._asleep_until = -math.inf

    def time_ns(self) -> int:
        return time.monotonic_ns() + self._offset_ns

    #: The function itself, for speed: each message calls it.
    monotonic = staticmethod(time.monotonic)

    boottime = staticmethod(_boottime)

    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        """Run `call` once, `delay` seconds from now; not before the graph runs."""
        return self._push(self._timers, delay, call)

    def call_urgently(self, delay: float, call: Callable[[], None]) -> Timer:
        """Run `call` once, ahead of other timers; not before the graph runs."""
        return self._push(self._urgent, delay, call)

    def _push(self, timers: TimerHeap, delay: float, call: Callable[[], None]) -> Timer:
        timer = timers.push(self.monotonic() + _bounded(delay), call)
        if timer.due < self._asleep_until and self._wake is not None:
            self._wake.set()
        return timer

    async def sleep(self, seconds: float) -> None:
        await anyio.sleep(_bounded(seconds))

    async def drive(self) -> None:
        try:
            while True:
                now = self.monotonic()
                # Bounded by `now`, so that a timer that re-arms itself at once cannot block the loop, and in
                # time, so that thousands of due timers cannot.
                self._run_urgent(now)
                while self._timers.next_due() <= now:
                    self._timers.run_next()
                    ran_until = self.monotonic()
                    self._run_urgent(ran_until)
                    if ran_until - now > _TIMERS_SECONDS:
                        break
                due = min(self._timers.next_due(), self._urgent.next_due())
                wake = self._wake = anyio.Event()
                self._asleep_until = due
                with anyio.move_on_after(max(0.0, due - self.monotonic())):
                    await wake.wait()
                self._asleep_until = -math.inf
        finally:
            self._asleep_until = -math.inf
            self._wake = None

    def _run_urgent(self, now: float) -> None:
        while self._urgent.next_due() <= now:
            self._urgent.run_next()


class WallClock(SteadyClock):
    """Real time; ROS time follows the system's clock, jumps included."""

    #: The function itself, for speed: each message calls it.
    time_ns = staticmethod(time.time_ns)


class SimulatedClock(Clock):
    """Time that changes only by :meth:`advance` and :meth:`set_time`.

    Attributes:
        listeners: called with the new ROS time after each change; the graph publishes `/clock` from one.
    """

    is_real = False

    def __init__(self, start_ns: int = 0) -> None:
        self._steady_ns = 0
        self._offset_ns = start_ns
        self._timers = TimerHeap()
        self.listeners: list[Callable[[int], None]] = []

    def time_ns(self) -> int:
        return self._steady_ns + self._offset_ns

    def monotonic(self) -> float:
        return self._steady_ns / NANOSECONDS

    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        """Run `call` once, when the clock has advanced by `delay` seconds."""
        return self._timers.push(self._steady_ns + round(_bounded(delay) * NANOSECONDS), call)

    def advance(self, seconds: float) -> None:
        """Advance time; run the timers that become due on the way, each at its own time.

        Raises:
            ValueError: `seconds` is negative (use :meth:`set_time` to go back), or leads beyond 2038, where
                ROS time ends.
        """
        left = (END_OF_TIME_NS - self.time_ns()) / NANOSECONDS
        # Written so that NaN is rejected, too.
        if not 0 <= seconds < left:
            raise ValueError(f"time can be advanced by 0 to {left:.0f} s; set_time() moves it back")
        self._move(round(seconds * NANOSECONDS))

    def _move(self, by_ns: int) -> None:
        target = self._steady_ns + by_ns
        while (due := self._timers.next_due()) <= target:
            self._steady_ns = max(self._steady_ns, int(due))
            self._timers.run_next()
        self._steady_ns = max(self._steady_ns, target)
        self._announce()

    def suspend(self, seconds: float) -> None:
        """Let steady time pass without timers, as while a process is stopped; the next change runs them."""
        self._steady_ns += round(seconds * NANOSECONDS)

    def pending(self) -> int:
        """Return the number of timers that have neither run nor been cancelled."""
        return len(self._timers)

    def until_next(self) -> float | None:
        """Return seconds until the next timer is due; None if there is none."""
        due = self._timers.next_due()
        return None if due == math.inf else max(0.0, (due - self._steady_ns) / NANOSECONDS)

    def set_time(self, time_ns: int) -> None:
        """Set ROS time. Forwards is an :meth:`advance`; backwards does not affect steady time and timers.

        Raises:
            ValueError: `time_ns` is negative, or beyond 2038, where ROS time ends.
        """
        if not 0 <= time_ns < END_OF_TIME_NS:
            raise ValueError(f"ROS time is between 0 and {END_OF_TIME_NS} ns")
        ahead = time_ns - self.time_ns()
        if ahead >= 0:
            self._move(ahead)
        else:
            self._offset_ns += ahead
            self._announce()

    def _announce(self) -> None:
        now = self.time_ns()
        for listener in tuple(self.listeners):
            listener(now)

    async def sleep(self, seconds: float) -> None:
        """Wait until the clock has advanced by `seconds`; for zero, let other tasks run."""
        if seconds <= 0:
            await anyio.lowlevel.checkpoint()
            return
        over = anyio.Event()
        timer = self.call_later(seconds, over.set)
        try:
            await over.wait()
        finally:
            timer.cancel()

    async def drive(self) -> None:
        """No-op: `advance` runs the timers."""
        await anyio.sleep_forever()
