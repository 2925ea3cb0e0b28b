"""Turns of the event loop: how much of one the clients of a bridge may take together, and who waits."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt_graph.clock import Clock

SHARE: Final = 0.003
"""Seconds of one turn of the event loop that the messages of one client may take; the rest waits its turn."""

FULL: Final = 5 * SHARE
"""Seconds of one turn that all clients together may take, small messages by themselves left out."""


class Turns:
    """One turn of the event loop after the other.

    Work that waits is done in a line, one client's share in each turn, and so is the work of those beyond
    their rate. So however many clients have much to do, who sends a small message now and then waits for one
    of them at most. While nobody else wants the server they lose nothing: turns follow each other at once.

    Attributes:
        is_full: whether this turn has seen as much work as one may.
    """

    __slots__ = ("_clock", "_holder", "_is_begun", "_line", "_worked", "is_full")

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._line: deque[Callable[[], None]] = deque()
        self._is_begun = False
        self._holder: object = None
        self._worked = 0.0
        self.is_full = False

    def note(self, seconds: float) -> None:
        """Count work that was done in this turn."""
        self._worked += seconds
        self.is_full = self._worked > FULL
        self._begin()

    def take(self, client: object) -> bool:
        """Take this turn for a client beyond its rate; whether no other one has it."""
        if self._holder is None:
            self._holder = client
            self._begin()
        return self._holder is client

    def wait(self, work: Callable[[], None]) -> None:
        """Call `work` in a turn of its own, after those who wait already. What it raises is logged."""
        self._line.append(work)
        self._begin()

    def _begin(self) -> None:
        if not self._is_begun:
            self._is_begun = True
            self._clock.call_later(0.0, self._next)

    def _next(self) -> None:
        self._is_begun = self.is_full = False
        self._holder = None
        self._worked = 0.0
        if self._line:
            work = self._line.popleft()
            self._holder = work
            self._begin()
            work()
