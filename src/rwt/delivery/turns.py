"""Turns of the event loop: how much of one the clients of a gateway may take together, and who waits."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from typing import TYPE_CHECKING, Final, Generic, Literal, NamedTuple, Protocol, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rwt_graph.clock import Clock
    from rwt_transports.api import FlowControl

T = TypeVar("T")

SHARE: Final = 0.003
"""Seconds of one turn of the event loop that the messages of one client may take; the rest waits its turn."""

STEPS: Final = 0.002
"""Seconds of one turn in which steps of a large message are begun. The last of them comes on top, and what it
sends."""

ALONE: Final = 2 * 1024 * 1024
"""Messages of more bytes from a connection wait for a turn of their own: to receive one has taken a good part
of this one."""

FULL: Final = 5 * SHARE
"""Seconds of one turn that all clients together may take, small messages by themselves left out."""

_LATER_SECONDS: Final = 0.005


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

    def later(self, ask: Callable[[], None]) -> None:
        """Call `ask` after a while, to ask for a turn again."""
        self._clock.call_later(_LATER_SECONDS, ask)

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


_SMALL: Final = 4096
"""Bytes of a message that is read in a turn of the event loop which is full already."""


class Work(Protocol):
    """The work that the server does for one client, which has a rate."""

    @property
    def excess(self) -> float:
        """Seconds until the client is within its rate again; 0.0 where it is."""

    def add(self, seconds: float, kind: Literal["messages"]) -> None:
        """Count seconds of one processor that were worked for the client."""

    def note_wait(self) -> None:
        """Count that something of the client waits, since it is beyond its rate."""


def _always() -> bool:
    return True


class Arriving(NamedTuple):
    """A message that is still being read, in turns in which it may be."""

    steps: Iterator[None]
    may_go_on: Callable[[], bool] = _always


class TakesTurns(ABC, Generic[T]):
    """A client whose messages wait their turn: beyond its share of a turn of the event loop, where all
    clients together have had theirs, and beyond its rate of work. Until then nothing is read from it.

    Who receives asks :meth:`_is_early` first, counts its work in `_worked`, and gives what has to wait to
    :meth:`_wait`.

    Args:
        turns: of all clients of the gateway.
        work: of this one.
        monotonic: seconds on a clock that never goes back.
    """

    def __init__(self, turns: Turns, work: Work, monotonic: Callable[[], float]) -> None:
        self._turns = turns
        self._work = work
        self._monotonic = monotonic
        self._flow_control: FlowControl | None = None
        self._is_held = False
        self._over = False
        self._received = 0
        self._worked = 0.0  # seconds, in all
        self._counted = 0.0  # of them, as work that it has caused
        self._turn_began = 0.0  # when it had worked so long
        self._is_beyond = self._needs_turn = work.excess > 0.0  # its rate of work
        self._began = 0.0  # with the frame or message at hand
        self._waiting: deque[T | Arriving] = deque()

    def set_flow_control(self, flow_control: FlowControl) -> None:
        """Hold this client back by `flow_control` while its messages wait their turn."""
        self._flow_control = flow_control

    @abstractmethod
    def _take_up(self, what: T, now: float) -> None:
        """Do what has waited, at `now`; what is left of it may wait again."""

    def _is_early(self, received: int, size: int) -> bool:
        """Whether a message of `size` bytes has to wait, of a read that ended when so many bytes had come."""
        if received != self._received:
            self._received = received
            self._turn_began = self._worked
            self._needs_turn = self._is_beyond
        return (size > ALONE and self._flow_control is not None) or (
            (
                self._is_held
                or self._needs_turn
                or self._turns.is_full
                or self._worked - self._turn_began > SHARE
            )
            and self._must_wait(size)
        )

    def _must_wait(self, size: int) -> bool:
        """Whether a message of `size` bytes waits, where one may have to."""
        worked = self._worked - self._turn_began
        if self._waiting or worked > SHARE or (self._turns.is_full and (worked or size > _SMALL)):
            return True
        if self._needs_turn:
            self._is_beyond = self._work.excess > 0.0
            # Once for each read, which is within one turn.
            self._needs_turn = self._is_beyond and not self._turns.take(self)
        return self._needs_turn

    def _has_time(self) -> bool:
        """Whether the client may begin one more step of a large message in this turn."""
        return self._worked - self._turn_began + self._monotonic() - self._began <= STEPS

    def _count_work(self) -> None:
        """Charge the work since the last time, which is not done for each message."""
        seconds = self._worked - self._counted
        self._counted = self._worked
        self._work.add(seconds, "messages")
        self._turns.note(seconds)
        self._is_beyond = self._needs_turn = self._work.excess > 0.0

    def take_steps(self, steps: Iterator[None], may_go_on: Callable[[], bool]) -> None:
        """Take the steps in which a message is read from its wire, in turns, as what it asks for."""
        self._wait(Arriving(steps, may_go_on))

    def _wait(self, what: T | Arriving) -> None:
        """Let a frame or a message wait for a later turn, or the rest of one; until then nothing is read from
        this client."""
        self._waiting.append(what)
        if not self._is_held:
            self._is_held = True
            if self._flow_control is not None:
                self._flow_control.pause()
            self._ask_for_turn()

    def _ask_for_turn(self) -> None:
        if self._is_beyond:
            self._work.note_wait()
        self._turns.wait(self._go_on)

    def _is_held_up(self, what: T) -> bool:
        """Whether what has waited for a turn has to wait for something else, too."""
        return False

    def _go_on(self) -> None:
        """Take this turn's share of what waits."""
        first = self._waiting[0] if self._waiting else None
        if first is not None and (
            not first.may_go_on() if isinstance(first, Arriving) else self._is_held_up(first)
        ):
            self._turns.later(self._ask_for_turn)
            return
        waiting, self._waiting = self._waiting, deque()
        self._turn_began = self._worked
        try:
            while waiting and not (self._waiting or self._over or self._worked - self._turn_began > SHARE):
                what = waiting.popleft()
                now = self._began = self._monotonic()
                if isinstance(what, Arriving):
                    self._read_on(what)
                else:
                    self._take_up(what, now)
                self._worked += self._monotonic() - now
        finally:
            if not self._over:
                self._waiting += waiting
                self._count_work()
            if self._waiting:
                self._ask_for_turn()
            else:
                self._is_held = False
                if self._flow_control is not None:
                    self._flow_control.resume()
                if self._over:
                    self._flow_control = None

    def _read_on(self, arriving: Arriving) -> None:
        """Take steps of reading a message; the rest of them wait for a later turn."""
        for _ in arriving.steps:
            if not self._has_time():
                self._wait(arriving)
                return

    def _end_turns(self) -> None:
        """The client has gone: nothing of it waits any more."""
        self._over = True
        self._waiting.clear()
        if not self._is_held:
            self._flow_control = None  # So that nothing refers to the connection, which refers to this.
