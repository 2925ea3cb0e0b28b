"""The time of the process: the system's, or one that jumps to what is due next when nothing else is left.

In virtual time all that waits shares one lock. Whoever begins to wait last moves time to the earliest
deadline of them all. A program of one executor so runs the same way each time, and takes no time of its own.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt_graph.clock import SimulatedClock


class Timekeeper(ABC):
    """Source of time for executors, timers and sleepers.

    Attributes:
        lock: guards the graph of this process.
    """

    lock: threading.RLock

    @abstractmethod
    def system_ns(self) -> int:
        """Nanoseconds since the epoch."""

    @abstractmethod
    def steady_ns(self) -> int:
        """Nanoseconds since some moment; never goes back."""

    @abstractmethod
    def condition(self) -> threading.Condition:
        """Something to wait on with :meth:`wait`."""

    @abstractmethod
    def wait(self, condition: threading.Condition, deadline_ns: int | None) -> None:
        """Wait, with the condition held, until it is notified or steady time is at the deadline.

        It may return early; whoever calls looks again.
        """

    @contextmanager
    def running(self) -> Iterator[None]:
        """While this thread runs callbacks, time stands still."""
        yield

    def handed_over(self) -> None:  # noqa: B027 - real time need not count it
        """Work was given to a thread of a pool, which has not begun it yet."""

    @contextmanager
    def working(self) -> Iterator[None]:
        """The thread of a pool does work that was :meth:`handed_over`."""
        yield


_LOOK_AGAIN_S: Final = 1.0
"""Seconds for which the main thread waits at a time. A signal that comes right before it waits, or to another
thread, ends no wait of Python's: the main thread answers it when it looks again. A descriptor for wake-ups
(`signal.set_wakeup_fd`) would be sooner, but is inherited by what is forked, and may be somebody else's."""


class RealTime(Timekeeper):
    """The system's clocks."""

    def __init__(self) -> None:
        self.lock = threading.RLock()

    def system_ns(self) -> int:
        """The wall clock."""
        return time.time_ns()

    def steady_ns(self) -> int:
        """The monotonic clock."""
        return time.monotonic_ns()

    def condition(self) -> threading.Condition:
        """A condition of its own."""
        return threading.Condition()

    def wait(self, condition: threading.Condition, deadline_ns: int | None) -> None:
        """Wait for real."""
        is_main = threading.get_ident() == threading.main_thread().ident
        longest = _LOOK_AGAIN_S if is_main else threading.TIMEOUT_MAX
        left = longest if deadline_ns is None else (deadline_ns - time.monotonic_ns()) / 1e9
        if left > 0:
            condition.wait(min(left, longest))


class _Thread(threading.local):
    counted = False


class VirtualTime(Timekeeper):
    """Time that moves only when everything waits for it.

    Args:
        clock: the clock of the graph, which is moved.
    """

    def __init__(self, clock: SimulatedClock) -> None:
        self.clock = clock
        self.lock = threading.RLock()
        self._condition = threading.Condition(self.lock)
        self._deadlines: dict[int, int | None] = {}
        self._busy = 0
        self._thread = _Thread()
        self._tokens = 0

    def system_ns(self) -> int:
        """The graph's ROS time."""
        return self.clock.time_ns()

    def steady_ns(self) -> int:
        """The graph's steady time."""
        return round(self.clock.monotonic() * 1e9)

    def condition(self) -> threading.Condition:
        """The one condition of all."""
        return self._condition

    def wait(self, condition: threading.Condition, deadline_ns: int | None) -> None:
        """Wait until notified, or until everything else waits and this deadline is the earliest."""
        self._tokens += 1
        token = self._tokens
        self._deadlines[token] = deadline_ns
        counted = self._thread.counted
        self._busy -= counted
        try:
            if self._busy > 0:
                self._condition.wait()
                return
            due = min((each for each in self._deadlines.values() if each is not None), default=None)
            if due is None:
                self._condition.wait()
                return
            self._advance_to(due)
            if due != deadline_ns:
                self._condition.notify_all()
                self._condition.wait()
        finally:
            del self._deadlines[token]
            self._busy += counted

    def _advance_to(self, due_ns: int) -> None:
        ahead = due_ns - self.steady_ns()
        if ahead > 0:
            self.clock.set_time(self.clock.time_ns() + ahead)

    def advance(self, seconds: float) -> None:
        """Move time on by hand, and let what waits look again."""
        with self._condition:
            self.clock.advance(seconds)
            self._condition.notify_all()

    @contextmanager
    def running(self) -> Iterator[None]:
        """While this thread runs callbacks, time stands still."""
        if self._thread.counted:
            yield
            return
        with self._condition:
            self._busy += 1
        self._thread.counted = True
        try:
            yield
        finally:
            self._thread.counted = False
            self._let_go()

    def handed_over(self) -> None:
        """Count work that a thread of a pool will do."""
        with self._condition:
            self._busy += 1

    @contextmanager
    def working(self) -> Iterator[None]:
        """Do work that was counted when it was handed over."""
        self._thread.counted = True
        try:
            yield
        finally:
            self._thread.counted = False
            self._let_go()

    def _let_go(self) -> None:
        with self._condition:
            self._busy -= 1
            if not self._busy:
                self._condition.notify_all()


_current: Timekeeper = RealTime()


def current() -> Timekeeper:
    """The timekeeper of the process."""
    return _current


def keep_time_by(timekeeper: Timekeeper) -> Timekeeper:
    """Make a timekeeper that of the process; returns the one it had."""
    global _current
    before, _current = _current, timekeeper
    return before
