"""Fair scheduler for long work on the event loop, and its table of time budgets.

A *turn* is the work of the event loop between two polls of its sockets. Code with much work for one
turn does a part of it, limited by a budget below, and defers the rest. These are different guarantees:

* **Read share**: large messages of some connections do not delay small ones of others.
* **Write coalescing**: the output of one turn is written together, and does not delay reading.
* **TLS slicing**: one connection under TLS does not use up the time for writing.
* **Requests**: many HTTP requests at once do not delay messages, and a large body is read in parts.
* **Client share**: each client has a budget per turn, and all clients together have another.
* **Late fan-out**: encoding long samples delays neither clients nor other topics.

Budgets are seconds of one turn. They are checked between steps: the last step comes on top. The timers of a
graph have a budget of their own (:class:`rwt_graph.clock.SteadyClock`).
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, TypeVar
from weakref import WeakValueDictionary

import anyio.lowlevel

from rwt_transports.errors import log_exception

if TYPE_CHECKING:
    from rwt_protocol.codecs.base import Steps

T = TypeVar("T")

READ_SECONDS: Final = 0.01
"""Budget for receiving large messages, over all connections of an event loop."""
WRITE_SECONDS: Final = 0.01
"""Budget for writing, over all connections of an event loop."""
ENCRYPT_SECONDS: Final = 0.002
"""Budget for encrypting, for one connection under TLS."""
REQUESTS_SECONDS: Final = 0.005
"""Budget for reading HTTP requests, over all connections of a listener."""
BODY_SECONDS: Final = 0.003
"""Budget for reading the body of one HTTP request."""
CLIENT_SECONDS: Final = 0.003
"""Budget for the messages of one client."""
STEP_SECONDS: Final = 0.002
"""Time within `CLIENT_SECONDS` in which steps of a large message begin. The rest is for what the message
sends."""
CLIENTS_SECONDS: Final = 5 * CLIENT_SECONDS
"""Budget for messages of all clients of a gateway, not counting small messages handled at once."""
TOPIC_SECONDS: Final = 0.0015
"""Budget for encoding deferred samples of one topic."""
TOPICS_SECONDS: Final = 0.005
"""Budget for encoding deferred samples, over all topics of a gateway."""

RETRY_SECONDS: Final = 0.005
"""Delay before retrying work that waits for something other than a turn.

Without it, retries would fill every turn and double the delay of the loop in `lists_at_once` of
tests/faults/attacks.
"""

CallSoon = Callable[[Callable[[], None]], object]
"""Function that calls another in the event loop's next turn."""
CallLater = Callable[[float, Callable[[], None]], object]
"""Function that calls another after so many seconds."""


class Turns:
    """Work that waits for later turns of the event loop, first come, first served.

    Work that is done at once is counted with :meth:`note`. Work that has to wait is given to :meth:`wait`:
    each turn does as much of it as fits into the budget, and at least one piece. What is added meanwhile
    waits for the next turn, so that work which puts itself off cannot hold the loop. Exceptions are logged.

    With `one_at_a_time`, each piece of work has a turn of its own, and no other client can :meth:`take` that
    turn.

    States: **idle** until something is counted, taken or waits; **begun** (``_is_begun``) while :meth:`_next`
    is scheduled, which begins the next turn; **full** (`is_full`) from the moment the budget is used up until
    then.

    Args:
        one_at_a_time: True if waiting work is done one piece per turn.
        is_held_back: returns True while queued work must wait for something other than a turn.

    Attributes:
        is_full: True if the budget of this turn is used up.
    """

    __slots__ = (
        "__weakref__", "_call_later", "_call_soon", "_holder", "_is_begun", "_line", "_one_at_a_time",
        "_seconds", "_used", "is_full", "is_held_back", "monotonic",
    )  # fmt: skip

    def __init__(
        self,
        seconds: float,
        call_soon: CallSoon,
        call_later: CallLater,
        monotonic: Callable[[], float] = time.monotonic,
        *,
        one_at_a_time: bool = False,
        is_held_back: Callable[[], bool] | None = None,
    ) -> None:
        self._seconds = seconds
        self._call_soon = call_soon
        self._call_later = call_later
        self.monotonic = monotonic
        self._one_at_a_time = one_at_a_time
        self.is_held_back = is_held_back
        self._line: deque[Callable[[], object]] = deque()
        self._is_begun = False
        self._holder: object = None
        self._used = 0.0  # seconds
        self.is_full = False

    @property
    def must_wait(self) -> bool:
        """True if work in order has to wait: the turn is full, or other work is queued."""
        return self.is_full or bool(self._line) or (self.is_held_back is not None and self.is_held_back())

    def note(self, seconds: float) -> None:
        """Count work that was done in this turn."""
        self._used += seconds
        self.is_full = self._used > self._seconds
        self._begin()

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

    def retry(self, ask: Callable[[], None]) -> None:
        """Call `ask` after a delay, for work that waits for something other than a turn."""
        self._call_later(RETRY_SECONDS, ask)

    def _begin(self) -> None:
        if not self._is_begun:
            self._is_begun = True
            self._call_soon(self._next)

    def _next(self) -> None:
        self._is_begun = self.is_full = False
        self._used = 0.0
        self._holder = None
        line, held_back = self._line, self.is_held_back
        # Counted before the work begins, so that work which puts itself off waits for the next turn.
        pieces = min(len(line), 1) if self._one_at_a_time else len(line)
        over = self.monotonic() + self._seconds if pieces > 1 else 0.0
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
        if line:
            self._begin()


class Batches:
    """Callbacks of an event loop, at whose end the work is done that they cause, in place of the next turn.

    A turn polls the sockets, which costs more than a small message. If other callbacks follow in the same
    turn, the work waits for the next one, where it is done for all of them together. On loops other than
    asyncio's own, such as uvloop, all work waits for the next turn.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        # Private: the callbacks that follow in this turn.
        self._following: deque[object] | None = getattr(loop, "_ready", None)
        self._is_open = False
        self._calls: list[Callable[[], None]] = []

    def run(self, call: Callable[[], None]) -> None:
        """Call a function, and do the work that it causes."""
        if self._is_open or self._following is None:
            call()
            return
        self._is_open = True
        try:
            call()
        finally:
            self._is_open = False
            calls, self._calls = iter(self._calls), []
            try:
                for each in calls:
                    if self._following:
                        self._loop.call_soon(each)
                    else:
                        each()
            finally:
                for each in calls:  # Those behind a call that raised.
                    self._loop.call_soon(each)

    def call_soon(self, call: Callable[[], None]) -> None:
        """Call a function at the end of the batch, or in the next turn."""
        if self._is_open:
            self._calls.append(call)
        else:
            self._loop.call_soon(call)


_batches: Final[WeakValueDictionary[asyncio.AbstractEventLoop, Batches]] = WeakValueDictionary()
"""Batches by event loop; an entry ends with its last user."""


def loop_batches() -> Batches:
    """Return the batches of the running event loop, which is asyncio's."""
    loop = asyncio.get_running_loop()
    return _batches.setdefault(loop, Batches(loop))


def loop_turns(seconds: float, *, is_held_back: Callable[[], bool] | None = None) -> Turns:
    """Return turns of the running event loop."""
    token: object = anyio.lowlevel.current_token()
    loop: Any = getattr(token, "native_token", token)  # anyio before 4.11 returns it unwrapped.
    if hasattr(loop, "call_soon"):
        return Turns(seconds, loop.call_soon, loop.call_later, is_held_back=is_held_back)
    return Turns(seconds, loop.run_sync_soon, _call_later_on_trio, is_held_back=is_held_back)


def _call_later_on_trio(seconds: float, call: Callable[[], None]) -> None:
    import trio  # optional dependency

    async def wait() -> None:
        await trio.sleep(seconds)
        call()

    trio.lowlevel.spawn_system_task(wait)


def no_turns() -> Turns:
    """Return turns for use without an event loop: deferred work is done at once."""
    return Turns(float("inf"), lambda call: call(), lambda _, call: call())


async def in_turns(steps: Steps[T], seconds: float = BODY_SECONDS) -> T:
    """Run steps in a task, for `seconds` of each turn of the event loop, and return their result."""
    until = time.perf_counter() + seconds
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
        if time.perf_counter() > until:
            await anyio.lowlevel.checkpoint()
            until = time.perf_counter() + seconds
