"""Fair scheduler for long work on the event loop, and the table of its time budgets.

A *turn* is the work of the event loop between two polls of its sockets. Code with much work for one
turn does a part of it, limited by a budget, and defers the rest. Budgets are checked between steps: the last
step comes on top.

| Budget     | Turn  | Share  | Work                            | Guarantee                              |
|------------|-------|--------|---------------------------------|----------------------------------------|
| `READING`  | 10 ms | 10 ms  | receiving large messages        | they do not delay small ones of others |
| `WRITING`  | 10 ms | 2 ms   | writing; a TLS connection       | a turn's output is written together    |
| `REQUESTS` | 5 ms  | 3 ms   | HTTP requests; a body           | many at once do not delay messages     |
| `MESSAGES` | 15 ms | 3 ms   | messages of clients; one client | one client does not delay the others   |
| `SAMPLES`  | 5 ms  | 1.5 ms | encoding long samples; a topic  | no delay of clients and other topics   |

The timers of a graph have a budget of their own (:class:`rwt_graph.clock.SteadyClock`), and so has the safety
path of the gate, which waits for no other work (:class:`rwt.access.gate.stop_path.StopPath`).
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sized
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeVar
from weakref import WeakValueDictionary

import anyio
import anyio.lowlevel

from rwt_transports.errors import log_exception

if TYPE_CHECKING:
    from rwt_protocol.codecs.base import Steps

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """Time for one kind of work in a turn of the event loop, in seconds.

    Attributes:
        turn: budget of all work of this kind.
        share: part of it for one client, connection, request or topic.
        steps: part of the share in which steps of a large message begin. The rest is for what the message
            sends.
    """

    turn: float
    share: float
    steps: float = 0.0


READING: Final = Budget(turn=0.010, share=0.010)
"""Receiving large messages, over all connections of an event loop."""
WRITING: Final = Budget(turn=0.010, share=0.002)
"""Writing, over all connections of an event loop; encrypting, for one connection under TLS."""
REQUESTS: Final = Budget(turn=0.005, share=0.003)
"""Reading HTTP requests, over all connections of an event loop; reading one body."""
MESSAGES: Final = Budget(turn=0.015, share=0.003, steps=0.002)
"""Messages of all clients of a gateway; those of one client. Until a turn is twice full, each client still
has one small message handled at once."""
SAMPLES: Final = Budget(turn=0.005, share=0.0015)
"""Encoding deferred samples, over all topics of a gateway; those of one topic."""

RETRY_SECONDS: Final = 0.005
"""Delay before retrying work that waits for something other than a turn.

Without it, retries would fill every turn and double the delay of the loop in `lists_at_once` of
tests/faults/attacks.
"""

CallSoon = Callable[[Callable[[], None]], object]
"""Function that calls another in the event loop's next turn."""
CallLater = Callable[[float, Callable[[], None]], object]
"""Function that calls another after so many seconds."""


class Scheduler:
    """Work of one budget, of which a part is done in each turn of the event loop, first come, first served.

    Work that is done at once is counted with :meth:`note`. Work that has to wait is given to :meth:`wait`,
    and work in steps to :meth:`run`: each turn does as much of it as fits into the budget, and at least one
    piece. What is added meanwhile waits for the next turn, so that work which defers itself cannot hold the
    loop. Exceptions are logged.

    With `one_at_a_time`, each piece of work has a turn of its own, and no other client can :meth:`take` that
    turn. Only small pieces that are given to :meth:`wait_briefly` share it, and are done first.

    States: **idle** until something is counted, taken or waits; **begun** (``_is_begun``) while :meth:`_next`
    is scheduled, which begins the next turn; **full** (`is_full`) from the moment the budget is used up until
    then.

    Args:
        one_at_a_time: True if waiting work is done one piece per turn.
        is_held_back: returns True while queued work must wait for something other than a turn.
        ready: callbacks that follow in the current turn of the event loop, for :meth:`batch`.

    Attributes:
        budget: seconds per turn, and of one share.
        uncounted: seconds of work in this turn that :meth:`count` has not counted yet; callers add to it.
        is_full: True if the budget of this turn is used up.
        is_overfull: True if twice that is used up.
        monotonic: clock of the budget, in seconds.
    """

    __slots__ = (
        "__weakref__", "_brief", "_call_later", "_call_soon", "_holder", "_is_begun", "_is_held_back",
        "_line", "_one_at_a_time", "_ready", "_turn", "_used", "budget", "is_full", "is_overfull",
        "monotonic", "uncounted",
    )  # fmt: skip

    def __init__(
        self,
        budget: Budget,
        call_soon: CallSoon,
        call_later: CallLater,
        monotonic: Callable[[], float] = time.monotonic,
        *,
        one_at_a_time: bool = False,
        is_held_back: Callable[[], bool] | None = None,
        ready: Sized | None = None,
    ) -> None:
        self.budget = budget
        self._call_soon = call_soon
        self._call_later = call_later
        self.monotonic = monotonic
        self._one_at_a_time = one_at_a_time
        self._is_held_back = is_held_back
        self._ready = ready
        self._brief: deque[Callable[[], object]] = deque()
        self._line: deque[Callable[[], object]] = deque()
        self._is_begun = False
        self._holder: object = None
        self._turn = 0
        self._used = 0.0  # seconds of this turn
        self.uncounted = 0.0
        self.is_full = self.is_overfull = False

    @staticmethod
    def of_loop(budget: Budget, is_held_back: Callable[[], bool] | None = None) -> Scheduler:
        """Return the scheduler of the running event loop, asyncio's or trio's, for a budget.

        All callers with the same budget and the same `is_held_back` share it.
        """
        token: object = anyio.lowlevel.current_token()
        loop: Any = getattr(token, "native_token", token)  # anyio before 4.11 returns it unwrapped.
        key = (loop, budget, is_held_back)
        found = _schedulers.get(key)
        if found is None:
            is_asyncio = hasattr(loop, "call_soon")
            found = _schedulers[key] = Scheduler(
                budget,
                loop.call_soon if is_asyncio else loop.run_sync_soon,
                loop.call_later if is_asyncio else _call_later_on_trio,
                is_held_back=is_held_back,
                # Private, but nothing public tells whether callbacks follow. The alternatives cost more: to
                # wait for the next turn always, 2.4 of 12.5 µs for a sample that comes alone; to wait never,
                # 39 in place of 6.2 µs for each of ten samples that ten clients get in one turn.
                ready=getattr(loop, "_ready", None),
            )
        return found

    @staticmethod
    def immediate(budget: Budget) -> Scheduler:
        """Return a scheduler for use without an event loop: deferred work is done at once."""
        unlimited = Budget(turn=float("inf"), share=float("inf"), steps=budget.steps)
        return Scheduler(unlimited, lambda call: call(), lambda _, call: call())

    @property
    def must_wait(self) -> bool:
        """True if work in order has to wait: the turn is full, or other work is queued."""
        return self.is_full or bool(self._line) or (self._is_held_back is not None and self._is_held_back())

    @property
    def turn(self) -> int:
        """Number of this turn of the event loop, which no other turn has."""
        self._begin()  # Else the number would stay while there is nothing to do.
        return self._turn

    def note(self, seconds: float) -> None:
        """Count work that was done in this turn."""
        self._used += seconds
        self.is_full = self._used > self.budget.turn
        self.is_overfull = self._used > 2 * self.budget.turn
        self._begin()

    def count(self) -> None:
        """Count the work that callers have added to ``uncounted``: pieces too small for a call each."""
        seconds, self.uncounted = self.uncounted, 0.0
        self.note(seconds)

    def do(self, work: Callable[[], object]) -> None:
        """Run work now, and count it."""
        began = self.monotonic()
        try:
            work()
        finally:
            self.note(self.monotonic() - began)

    def take(self, client: object) -> bool:
        """Reserve this turn for a client. Returns False if another one has it."""
        if self._holder is None:
            self._holder = client
            self._begin()
        return self._holder is client

    def wait(self, work: Callable[[], object]) -> None:
        """Run `work` in a later turn, after the work already queued."""
        self._line.append(work)
        if not self._is_begun:  # As in _begin(), written out: this runs for each message that is sent.
            self._is_begun = True
            self._call_soon(self._next)

    def wait_briefly(self, work: Callable[[], object]) -> None:
        """Run a small piece of work in the next turn, ahead of the work of :meth:`wait`, if it fits there."""
        self._brief.append(work)
        self._begin()

    def retry(self, ask: Callable[[], None]) -> None:
        """Call `ask` after a delay, for work that waits for something other than a turn."""
        self._call_later(RETRY_SECONDS, ask)

    def run(self, steps: Iterator[None]) -> None:
        """Take steps now, for one share of this turn, and the others in later turns."""
        until = self.monotonic() + self.budget.share
        for _ in steps:
            if self.monotonic() > until:
                self.wait(partial(self.run, steps))
                return

    async def finish(self, steps: Steps[T]) -> T:
        """Take steps in later turns, for one share of each, and return their result.

        The steps are not taken by the calling task: tasks that wait for a turn would all continue in the same
        one.
        """
        is_done = anyio.Event()
        results: list[T] = []
        errors: list[Exception] = []

        def observed() -> Iterator[None]:
            try:
                results.append((yield from steps))
            except Exception as error:
                errors.append(error)
            finally:
                is_done.set()

        self.wait(partial(self.run, observed()))
        try:
            await is_done.wait()
        finally:
            steps.close()
        if errors:
            raise errors.pop()  # Removed: the error's traceback refers to the frame that has the list.
        return results[0]

    def batch(self, call: Callable[[], None]) -> None:
        """Call a function, and do the waiting work that it causes at its end, in place of the next turn.

        A turn polls the sockets, which costs more than a small message. If other callbacks follow in the same
        turn, the work waits for the next one, where it is done for all of them together. On loops other than
        asyncio's own, such as uvloop, all work waits for the next turn.
        """
        if self._is_begun or self._ready is None:
            call()
            return
        self._is_begun = True  # The turn begins below.
        try:
            call()
        finally:
            if self._ready:
                self._call_soon(self._next)
            else:
                self._next()

    def _begin(self) -> None:
        if not self._is_begun:
            self._is_begun = True
            self._call_soon(self._next)

    def _next(self) -> None:
        self._is_begun = self.is_full = self.is_overfull = False
        self._turn += 1
        self._used = 0.0
        self._holder = None
        if self._brief:
            self._take_brief()
        line, held_back = self._line, self._is_held_back
        # Counted before the work begins, so that work which defers itself waits for the next turn.
        pieces = min(len(line), 1) if self._one_at_a_time else len(line)
        over = self.monotonic() + self.budget.turn if pieces > 1 else 0.0
        for piece in range(pieces):
            if held_back is not None and held_back():
                self._is_begun = True
                self._call_later(RETRY_SECONDS, self._next)
                return
            if piece and self.monotonic() > over:
                break
            work = line.popleft()
            if self._one_at_a_time:
                self._holder = work
                self._begin()
            try:
                work()
            except Exception:
                log_exception("work that waited for its turn failed")
        if line or self._brief:
            self._begin()

    def _take_brief(self) -> None:
        over = self.monotonic() + self.budget.turn
        for _ in range(len(self._brief)):  # What is added meanwhile waits for the next turn.
            try:
                self._brief.popleft()()
            except Exception:
                log_exception("work that waited for its turn failed")
            if self.monotonic() > over:
                return


_schedulers: Final[WeakValueDictionary[tuple[object, ...], Scheduler]] = WeakValueDictionary()
"""Schedulers by event loop, budget and hold-back function; an entry ends with its last user."""


def _call_later_on_trio(seconds: float, call: Callable[[], None]) -> None:
    import trio  # optional dependency

    async def wait() -> None:
        await trio.sleep(seconds)
        call()

    trio.lowlevel.spawn_system_task(wait)
