"""ROS time, steady time and timers: by the wall, by a steady clock, or simulated.

A clock owns one heap of timers. Wall and steady clocks are driven by a single task of the running graph
(:meth:`Clock.drive`), whatever the number of timers; a simulated clock runs its timers from within
:meth:`SimulatedClock.advance`, with no event loop at all.

Everything except `time_ns` and `monotonic` belongs to the graph's own thread.
"""

from __future__ import annotations

import logging
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from heapq import heapify, heappop, heappush
from typing import Final, Protocol

import anyio

from rwt_interfaces.times import NANOSECONDS
from rwt_participant.timers import LONGEST_DELAY, Timer

logger = logging.getLogger(__name__)

#: A heap is rebuilt without its cancelled timers when they are this many and more than half of it.
COMPACT_AT = 64

#: ROS time ends here, in nanoseconds: messages have 32 bits for its seconds, one of them for the sign.
END_OF_TIME_NS: Final = 2**31 * NANOSECONDS


class HeapTimer(Timer):
    """One entry of a :class:`TimerHeap`; `due` is in the heap's own unit."""

    __slots__ = ("call", "due", "heap", "order")

    def __init__(self, due: float, order: int, call: Callable[[], None], heap: TimerHeap) -> None:
        self.due = due
        self.order = order
        self.call: Callable[[], None] | None = call
        self.heap = heap

    def __lt__(self, other: HeapTimer) -> bool:
        return (self.due, self.order) < (other.due, other.order)

    def cancel(self) -> None:
        """Drop the call; the entry leaves the heap when it comes up, or when many are dead."""
        if self.call is not None:
            self.call = None
            self.heap.count_cancelled()


_SHARE: Final = 0.005
"""Seconds of one turn of the event loop in which timers are run that are due; the others wait for the
next."""


class TimerHeap:
    """Timers in the order they are due; those due together run in the order they were made."""

    def __init__(self) -> None:
        self._heap: list[HeapTimer] = []
        self._order = 0
        self._cancelled = 0

    def __len__(self) -> int:
        return len(self._heap) - self._cancelled

    def push(self, due: float, call: Callable[[], None]) -> HeapTimer:
        """Add a timer."""
        self._order += 1
        timer = HeapTimer(due, self._order, call, self)
        heappush(self._heap, timer)
        return timer

    def count_cancelled(self) -> None:
        """Count a cancelled entry, and rebuild the heap when there are too many."""
        self._cancelled += 1
        if self._cancelled >= COMPACT_AT and self._cancelled * 2 > len(self._heap):
            self._heap = [timer for timer in self._heap if timer.call is not None]
            heapify(self._heap)
            self._cancelled = 0

    def next_due(self) -> float:
        """When the next timer is due; infinity when there is none."""
        while self._heap and self._heap[0].call is None:
            heappop(self._heap)
            self._cancelled -= 1
        return self._heap[0].due if self._heap else math.inf

    def run_next(self) -> None:
        """Run the first timer. What its callback raises is logged."""
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


class Playback(Protocol):
    """A recording that a clock follows: what it does now. It is controlled by the services of its node."""

    @property
    def node(self) -> str:
        """The node that plays it, absolute."""

    @property
    def start_ns(self) -> int:
        """Where playing begins, nanoseconds since the epoch."""

    @property
    def end_ns(self) -> int:
        """Where it ends."""

    @property
    def position_ns(self) -> int:
        """Where it is now."""

    @property
    def paused(self) -> bool:
        """Whether time stands still."""

    @property
    def rate(self) -> float:
        """Recorded seconds in a second."""

    @property
    def seeks(self) -> int:
        """How often it has jumped to another time."""


class Clock(ABC):
    """The time of a graph: ROS time, steady time and timers.

    Attributes:
        is_real: whether ROS time goes as the time of people does.
        playback: the recording that ROS time is taken from; None where it is from none.
    """

    is_real: bool = True
    playback: Playback | None = None

    @abstractmethod
    def time_ns(self) -> int:
        """ROS time, nanoseconds since the epoch."""

    @abstractmethod
    def monotonic(self) -> float:
        """Seconds since some moment; never goes back. Timers and timeouts are measured by it."""

    @abstractmethod
    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        """Run `call` once, `delay` seconds from now, at most :data:`LONGEST_DELAY`.

        At once, on the clock's next turn, is a delay of zero; so is one that is negative or no number.
        """

    @abstractmethod
    async def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of this clock."""

    @contextmanager
    def within(self, seconds: float | None) -> Iterator[None]:
        """Leave the block after so many seconds of this clock; None does not. In tasks only."""
        with anyio.CancelScope() as scope:
            timer = None if seconds is None else self.call_later(seconds, scope.cancel)
            try:
                yield
            finally:
                if timer is not None:
                    timer.cancel()

    @abstractmethod
    async def drive(self) -> None:
        """Run due timers until cancelled. A running graph has one task in here."""


class SteadyClock(Clock):
    """Real time that never jumps: ROS time is the wall's at construction plus the time gone by since."""

    def __init__(self) -> None:
        self._timers = TimerHeap()
        self._offset_ns = time.time_ns() - time.monotonic_ns()
        self._wake: anyio.Event | None = None
        self._asleep_until = -math.inf

    def time_ns(self) -> int:
        """ROS time, nanoseconds since the epoch."""
        return time.monotonic_ns() + self._offset_ns

    #: The function itself: each message asks for it.
    monotonic = staticmethod(time.monotonic)

    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        """Run `call` once, `delay` seconds from now; nothing runs before the graph does."""
        timer = self._timers.push(self.monotonic() + _bounded(delay), call)
        if timer.due < self._asleep_until and self._wake is not None:
            self._wake.set()
        return timer

    async def sleep(self, seconds: float) -> None:
        """Wait for `seconds`."""
        await anyio.sleep(_bounded(seconds))

    async def drive(self) -> None:
        """Run due timers until cancelled, sleeping from one to the next."""
        try:
            while True:
                now = self.monotonic()
                # Bounded by `now`, so that a timer that re-arms itself at once cannot hold the loop, and in
                # time, so that thousands that are due together cannot.
                while self._timers.next_due() <= now:
                    self._timers.run_next()
                    if self.monotonic() - now > _SHARE:
                        break
                due = self._timers.next_due()
                wake = self._wake = anyio.Event()
                self._asleep_until = due
                with anyio.move_on_after(max(0.0, due - self.monotonic())):
                    await wake.wait()
                self._asleep_until = -math.inf
        finally:
            self._asleep_until = -math.inf
            self._wake = None


class WallClock(SteadyClock):
    """Real time; ROS time follows the system's clock, jumps included."""

    def time_ns(self) -> int:
        """`time.time_ns`."""
        return time.time_ns()


class SimulatedClock(Clock):
    """Time that moves only by :meth:`advance` and :meth:`set_time`.

    Attributes:
        listeners: called with the new ROS time after each move; the graph publishes `/clock` from one.
    """

    is_real = False

    def __init__(self, start_ns: int = 0) -> None:
        self._steady_ns = 0
        self._offset_ns = start_ns
        self._timers = TimerHeap()
        self.listeners: list[Callable[[int], None]] = []

    def time_ns(self) -> int:
        """ROS time, nanoseconds since the epoch."""
        return self._steady_ns + self._offset_ns

    def monotonic(self) -> float:
        """Simulated seconds gone by."""
        return self._steady_ns / NANOSECONDS

    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        """Run `call` once, when the clock has been moved by `delay` seconds."""
        return self._timers.push(self._steady_ns + round(_bounded(delay) * NANOSECONDS), call)

    def advance(self, seconds: float) -> None:
        """Move time on, running what falls due on the way, each timer at its own time.

        Raises:
            ValueError: `seconds` is negative (use :meth:`set_time` to go back) or leads beyond 2038, where
                ROS time ends.
        """
        left = (END_OF_TIME_NS - self.time_ns()) / NANOSECONDS
        # Written so that what is no number is refused too.
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

    def until_next(self) -> float | None:
        """Seconds until the next timer is due; None when there is none."""
        due = self._timers.next_due()
        return None if due == math.inf else max(0.0, (due - self._steady_ns) / NANOSECONDS)

    def set_time(self, time_ns: int) -> None:
        """Set ROS time. Forwards is an :meth:`advance`; backwards leaves steady time and timers alone.

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
        """Wait until the clock has been moved by `seconds`; with nothing to wait for, let others run."""
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
        """Nothing to do: `advance` runs the timers."""
        await anyio.sleep_forever()
