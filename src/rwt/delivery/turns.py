"""Share of each client in the turns of the event loop."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Final, Generic, Literal, NamedTuple, Protocol, TypeVar

from rwt_transports.turns import CLIENT_SECONDS, CLIENTS_SECONDS, STEP_SECONDS, Turns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rwt_graph.clock import Clock
    from rwt_transports.api import FlowControl

T = TypeVar("T")

ALONE_BYTES: Final = 2 * 1024 * 1024
"""Larger messages of a connection wait for a turn of their own: receiving one has used a good part of this
turn."""

_SMALL_BYTES: Final = 4096
"""Maximum size of a message that is read in a turn that is full."""


def turns_of(clock: Clock, seconds: float, *, one_at_a_time: bool = False) -> Turns:
    """Return turns by the timers of a graph's clock, which also simulated clocks have."""
    return Turns(
        seconds,
        partial(clock.call_later, 0.0),
        clock.call_later,
        clock.monotonic,
        one_at_a_time=one_at_a_time,
    )


def client_turns(clock: Clock) -> Turns:
    """Return the turns that all clients of a gateway share.

    Waiting work is done one client at a time, and so is the work of clients beyond their rate. So however
    many clients have much to do, one that sends a small message now and then waits for one of them at most.
    While nobody else needs the server they lose nothing: turns follow each other at once.
    """
    return turns_of(clock, CLIENTS_SECONDS, one_at_a_time=True)


class Work(Protocol):
    """Account of the work that the server does for one client, which has a rate."""

    @property
    def excess(self) -> float:
        """Seconds until the client is within its rate again; 0.0 if it is."""

    def add(self, seconds: float, kind: Literal["messages"]) -> None:
        """Add seconds of processor time."""

    def note_wait(self) -> None:
        """Count that something of the client waits, because it is beyond its rate."""


def _always() -> bool:
    return True


class Arriving(NamedTuple):
    """Message that is being read in steps, in turns in which `may_go_on` returns True."""

    steps: Iterator[None]
    may_go_on: Callable[[], bool] = _always


class TakesTurns(ABC, Generic[T]):
    """Client whose messages wait for a later turn, during which nothing is read from it.

    They wait beyond the client's share of a turn (`CLIENT_SECONDS`), in turns that all clients together have
    filled (`CLIENTS_SECONDS`), and beyond the client's rate of work.

    Subclasses ask :meth:`_must_defer` first, count their work in ``_worked``, and pass what has to wait to
    :meth:`_wait`.

    States: **reading**; **held** (``_is_held``) while something waits, the flow control is paused; **over**
    (``_over``) after :meth:`_end_turns`.

    Attributes by purpose:

    * Wiring: ``_turns``, ``_work``, ``_monotonic``, ``_flow_control`` (None without one, and once over).
    * Work, in seconds: ``_worked`` (in all), ``_counted`` (of these, charged to the client), ``_turn_began``
      (``_worked`` at the beginning of this turn), ``_began`` (monotonic time at which the current frame
      began).
    * This turn: ``_received`` (bytes that had arrived at the last read: another number is another turn),
      ``_is_beyond`` (True if the client is beyond its rate), ``_needs_turn`` (True if it then needs a turn of
      its own).
    * ``_waiting``: messages that wait.

    Args:
        turns: turns of all clients of the gateway.
        work: account of this client.
        monotonic: monotonic clock, in seconds.
    """

    def __init__(self, turns: Turns, work: Work, monotonic: Callable[[], float]) -> None:
        self._turns = turns
        self._work = work
        self._monotonic = monotonic
        self._flow_control: FlowControl | None = None
        self._is_held = False
        self._over = False
        self._received = 0
        self._worked = self._counted = self._turn_began = 0.0
        self._is_beyond = self._needs_turn = work.excess > 0.0
        self._began = 0.0
        self._waiting: deque[T | Arriving] = deque()

    def set_flow_control(self, flow_control: FlowControl) -> None:
        """Pause this client through `flow_control` while its messages wait."""
        self._flow_control = flow_control

    @abstractmethod
    def _take_up(self, what: T, now: float) -> None:
        """Do what has waited, at the monotonic time `now`; its rest may wait again."""

    def _must_defer(self, received: int, size: int) -> bool:
        """Return True if a message of `size` bytes has to wait; `received` is the number of bytes so far."""
        if received != self._received:
            self._received = received
            self._turn_began = self._worked
            self._needs_turn = self._is_beyond
        return (size > ALONE_BYTES and self._flow_control is not None) or (
            (
                self._is_held
                or self._needs_turn
                or self._turns.is_full
                or self._worked - self._turn_began > CLIENT_SECONDS
            )
            and self._must_wait(size)
        )

    def _must_wait(self, size: int) -> bool:
        """As :meth:`_must_defer`, after its quick checks."""
        worked = self._worked - self._turn_began
        if (
            self._waiting
            or worked > CLIENT_SECONDS
            or (self._turns.is_full and (worked or size > _SMALL_BYTES))
        ):
            return True
        if self._needs_turn:
            self._is_beyond = self._work.excess > 0.0
            # Once per read, which is within one turn.
            self._needs_turn = self._is_beyond and not self._turns.take(self)
        return self._needs_turn

    def _has_time(self) -> bool:
        """Return True if another step of a large message may begin in this turn."""
        return self._worked - self._turn_began + self._monotonic() - self._began <= STEP_SECONDS

    def _count_work(self) -> None:
        """Charge the work since the last call; too slow for every message."""
        seconds = self._worked - self._counted
        self._counted = self._worked
        self._work.add(seconds, "messages")
        self._turns.note(seconds)
        self._is_beyond = self._needs_turn = self._work.excess > 0.0

    def take_steps(self, steps: Iterator[None], may_go_on: Callable[[], bool]) -> None:
        """Take the steps in which its wire reads a message; they are work of the client."""
        self._wait(Arriving(steps, may_go_on))

    def _wait(self, what: T | Arriving) -> None:
        """Put off a frame, a message, or the rest of one, and read nothing from this client until then."""
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
        """Return True if `what` has to wait for something else than a turn."""
        return False

    def _go_on(self) -> None:
        """Do as much of what waits as this turn has time for."""
        first = self._waiting[0] if self._waiting else None
        if first is not None and (
            not first.may_go_on() if isinstance(first, Arriving) else self._is_held_up(first)
        ):
            self._turns.retry(self._ask_for_turn)
            return
        waiting, self._waiting = self._waiting, deque()
        self._turn_began = self._worked
        try:
            while waiting and not (self._waiting or self._over):
                if self._worked - self._turn_began > CLIENT_SECONDS:
                    break
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
        """Take steps of reading a message; the rest waits for a later turn."""
        for _ in arriving.steps:
            if not self._has_time():
                self._wait(arriving)
                return

    def _end_turns(self) -> None:
        """Discard what waits: the client is gone."""
        self._over = True
        self._waiting.clear()
        if not self._is_held:
            self._flow_control = None  # Break the cycle: the connection refers to this client.
