"""Time of the process: the system's, or virtual time that jumps to the next deadline when all threads wait.

In virtual time all waiting threads share one lock. The last one that begins to wait moves time to the
earliest deadline. So a program with one executor is deterministic, and its waits take no real time.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt_graph.clock import SimulatedClock


class Waker(ABC):
    """Waiting object that can be woken."""

    @abstractmethod
    def wake(self) -> None:
        """Look again."""


class Timekeeper(ABC):
    """Source of time for executors, timers and sleepers.

    Attributes:
        lock: guards the graph of this process.
    """

    lock: threading.RLock

    @abstractmethod
    def system_ns(self) -> int:
        """Return nanoseconds since the epoch."""

    @abstractmethod
    def steady_ns(self) -> int:
        """Return nanoseconds of a monotonic clock."""

    @abstractmethod
    def condition(self) -> threading.Condition:
        """Return a condition to wait on with :meth:`wait`."""

    @abstractmethod
    def wait(self, condition: threading.Condition, deadline_ns: int | None) -> None:
        """Wait, with the condition held, until it is notified or steady time is at the deadline.

        It may return early; callers check their condition again.
        """

    def deadline(self, timeout_sec: float | None) -> int | None:
        """Return the steady time after a timeout; None if it is None or negative."""
        if timeout_sec is None or timeout_sec < 0:
            return None
        return self.steady_ns() + int(timeout_sec * 1e9)

    def wait_for(
        self, condition: threading.Condition, ready: Callable[[], bool], deadline_ns: int | None
    ) -> bool:
        """Wait, with the condition held, until `ready` returns True. Returns False at the deadline."""
        while not ready():
            if deadline_ns is not None and self.steady_ns() >= deadline_ns:
                return False
            self.wait(condition, deadline_ns)
        return True

    @contextmanager
    def running(self) -> Iterator[None]:
        """Stop virtual time while this thread runs callbacks."""
        yield

    def handed_over(self) -> None:  # noqa: B027 - optional: only virtual time counts the work
        """Count work that was given to a thread of a pool and has not begun yet."""

    @contextmanager
    def working(self) -> Iterator[None]:
        """Run, in a thread of a pool, work that was counted by :meth:`handed_over`."""
        yield


_LOOK_AGAIN_S: Final = 1.0
"""Seconds for which the main thread waits at a time. A signal that comes right before it waits, or to another
thread, ends no wait of Python's: the main thread answers it when it looks again. A descriptor for wake-ups
(`signal.set_wakeup_fd`) would be sooner, but is inherited by what is forked, and may be somebody else's."""


class RealTime(Timekeeper):
    """Timekeeper with the system's clocks."""

    def __init__(self) -> None:
        self.lock = threading.RLock()

    def system_ns(self) -> int:
        """Return the time of the wall clock."""
        return time.time_ns()

    def steady_ns(self) -> int:
        """Return the time of the monotonic clock."""
        return time.monotonic_ns()

    def condition(self) -> threading.Condition:
        """Return a new condition."""
        return threading.Condition()

    def wait(self, condition: threading.Condition, deadline_ns: int | None) -> None:
        """Wait in real time."""
        is_main = threading.get_ident() == threading.main_thread().ident
        longest = _LOOK_AGAIN_S if is_main else threading.TIMEOUT_MAX
        left = longest if deadline_ns is None else (deadline_ns - time.monotonic_ns()) / 1e9
        if left > 0:
            condition.wait(min(left, longest))


class _Thread(threading.local):
    counted = False


class VirtualTime(Timekeeper):
    """Virtual time, which moves when all threads wait.

    Args:
        clock: clock of the graph, which is advanced.
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
        """Return the graph's ROS time."""
        return self.clock.time_ns()

    def steady_ns(self) -> int:
        """Return the graph's steady time."""
        return round(self.clock.monotonic() * 1e9)

    def condition(self) -> threading.Condition:
        """Return the shared condition."""
        return self._condition

    def wait(self, condition: threading.Condition, deadline_ns: int | None) -> None:
        """Wait until notified, or until all threads wait and this deadline is the earliest."""
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
        """Advance time explicitly, and wake waiting threads."""
        with self._condition:
            self.clock.advance(seconds)
            self._condition.notify_all()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Stop virtual time while this thread runs callbacks."""
        if self._thread.counted:
            yield
            return
        self.handed_over()
        with self.working():
            yield

    def handed_over(self) -> None:
        """Count work that a thread of a pool will do."""
        with self._condition:
            self._busy += 1

    @contextmanager
    def working(self) -> Iterator[None]:
        """Run work that was counted by :meth:`handed_over`."""
        self._thread.counted = True
        try:
            yield
        finally:
            self._thread.counted = False
            with self._condition:
                self._busy -= 1
                if not self._busy:
                    self._condition.notify_all()


_current: Timekeeper = RealTime()


def current() -> Timekeeper:
    """Return the timekeeper of the process."""
    return _current


def keep_time_by(timekeeper: Timekeeper) -> Timekeeper:
    """Set the timekeeper of the process; return the previous one."""
    global _current
    before, _current = _current, timekeeper
    return before
