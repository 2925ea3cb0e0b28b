"""Injected faults between a server and its clients."""

from __future__ import annotations

import fnmatch
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Literal, Self, TypeAlias, TypedDict, Unpack

from rwt.extensions.testing.errors import ScriptError
from rwt_participant.spelling import did_you_mean
from rwt_protocol.ops import OPS

#: Receiver of a message.
To: TypeAlias = Literal["client", "server", "both"]

#: Op of a message, and its topic, service or action (empty if it has none).
Subject: TypeAlias = tuple[str, str]


class Scope(TypedDict, total=False):
    """Messages that a fault applies to; see :meth:`Faults.drop`."""

    op: str
    to: To
    count: int | None
    every: int


class FaultKind(StrEnum):
    """Kind of a fault."""

    DROP = "drop"
    DELAY = "delay"
    DUPLICATE = "duplicate"
    REFUSE = "refuse"
    SLOW_READER = "slow_reader"


@dataclass(frozen=True, slots=True)
class FaultAction:
    """Effect of the faults on one message.

    Attributes:
        copies: number of times the message is sent; 0 drops it.
        delay: seconds of the robot's clock until then.
        remark: remark in the transcript.
    """

    copies: int = 1
    delay: float = 0.0
    remark: str = ""


PASS = FaultAction()

#: Fragments and PNG images count as the op that they contain.
_KNOWN_OPS: Final = OPS.keys() - {"fragment", "png"}


class Fault:
    """Active fault, until :meth:`remove` or the end of the block ``with faults.drop(...):``.

    Attributes:
        amount: seconds of a delay, copies of a duplicate, messages per second of a slow reader, HTTP status
            of a refusal.
        hits: number of affected messages or connections.
    """

    def __init__(
        self,
        faults: Faults,
        what: FaultKind,
        amount: float = 0.0,
        *,
        name: str = "*",
        op: str = "*",
        to: To = "both",
        count: int | None = None,
        every: int = 1,
    ) -> None:
        if to not in ("client", "server", "both"):
            raise ScriptError(f'a fault is `to` "client", "server" or "both", not {to!r}')
        if every < 1 or (count is not None and count < 0):
            raise ScriptError("a fault's `every` must be at least 1, and its `count` at least 0")
        if not fnmatch.filter(_KNOWN_OPS, op):
            meant = did_you_mean(op, _KNOWN_OPS) or f"; known are {', '.join(sorted(_KNOWN_OPS))}"
            raise ScriptError(f"a fault's `op` {op!r} matches no op of a message{meant}")
        self.what = what
        self.amount = amount
        self.hits = 0
        self._faults = faults
        self._name = name if name.startswith(("/", "*")) else f"/{name}"
        self._op = op
        self._to = to
        self._left = count
        self._every = every
        self._seen = 0

    def matches(self, to: Literal["client", "server"], subjects: Sequence[Subject]) -> bool:
        """True if the fault applies to this message; each match counts."""
        if self._to not in ("both", to) or not any(map(self._is_about, subjects)):
            return False
        self._seen += 1
        return self._seen % self._every == 0 and self.hit()

    def hit(self) -> bool:
        """Count a match. Returns False if `count` is used up."""
        if self._left is not None:
            if self._left == 0:
                return False
            self._left -= 1
        self.hits += 1
        return True

    def _is_about(self, subject: Subject) -> bool:
        op, name = subject
        absolute = name if name.startswith("/") or not name else f"/{name}"
        return fnmatch.fnmatchcase(op, self._op) and fnmatch.fnmatchcase(absolute, self._name)

    def remove(self) -> None:
        """End the fault. Messages that are already delayed stay delayed."""
        self._faults.remove(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.remove()


class Faults:
    """Faults of one server. All methods may be called from any thread.

    A fault applies to a message whose topic, service or action matches the glob `name` and whose op matches
    the glob `op`; `*` also matches `/`. If several faults apply, a drop wins, delays add up, and copies
    multiply.

    Args:
        hang_up: closes every connection with a code and a reason, and returns their number.
    """

    def __init__(self, hang_up: Callable[[int, str], int]) -> None:
        self._lock = threading.Lock()
        self._faults: tuple[Fault, ...] = ()
        self._hang_up = hang_up

    def drop(self, name: str = "*", **scope: Unpack[Scope]) -> Fault:
        """Drop messages.

        Args:
            name: glob of the topic, service or action.
            op: glob of the op, for example ``publish`` or ``service_*``.
            to: "client" or "server", to affect only messages to that side.
            count: maximum number of messages; None: no limit.
            every: affect only every n-th message.

        Raises:
            ScriptError: an argument is invalid.
        """
        return self._add(Fault(self, FaultKind.DROP, name=name, **scope))

    def delay(self, seconds: float, name: str = "*", **scope: Unpack[Scope]) -> Fault:
        """Delay messages by seconds of the robot's clock; other arguments as in :meth:`drop`."""
        if seconds < 0:
            raise ScriptError(f"a delay must not be negative, as {seconds} s is")
        return self._add(Fault(self, FaultKind.DELAY, seconds, name=name, **scope))

    def duplicate(self, name: str = "*", *, copies: int = 2, **scope: Unpack[Scope]) -> Fault:
        """Send messages `copies` times; other arguments as in :meth:`drop`."""
        if copies < 2:
            raise ScriptError(f"a duplicate has at least 2 copies, not {copies}")
        return self._add(Fault(self, FaultKind.DUPLICATE, copies, name=name, **scope))

    def refuse(self, status: int = 503, *, count: int | None = None) -> Fault:
        """Refuse new clients; the WebSocket handshake is answered with `status`.

        Args:
            count: maximum number of refusals; None: no limit.

        Raises:
            ScriptError: `status` is not an HTTP error status.
        """
        if not 400 <= status <= 599:
            raise ScriptError(f"a refusal needs an HTTP status from 400 to 599, not {status}")
        return self._add(Fault(self, FaultKind.REFUSE, status, count=count))

    def slow_reader(self, messages_per_second: float) -> Fault:
        """Limit how fast each client reads, by the robot's clock.

        Queued messages follow the rules for slow clients: replies wait in order; of a topic, the newest
        messages within its queue length are kept.
        """
        if messages_per_second <= 0:
            raise ScriptError(f"a slow reader reads more than 0 messages a second, not {messages_per_second}")
        return self._add(Fault(self, FaultKind.SLOW_READER, messages_per_second))

    def disconnect(self, code: int = 1011, reason: str = "a fault of the test") -> int:
        """Disconnect every client with a code of RFC 6455 section 7.4, and return their number."""
        return self._hang_up(code, reason)

    def clear(self) -> None:
        """Remove every fault."""
        with self._lock:
            self._faults = ()

    def remove(self, fault: Fault) -> None:
        """Remove a fault; no-op if it is already removed."""
        with self._lock:
            self._faults = tuple(each for each in self._faults if each is not fault)

    def _add(self, fault: Fault) -> Fault:
        with self._lock:
            self._faults = (*self._faults, fault)
        return fault

    # Queries of the wire, on the graph's thread

    def __bool__(self) -> bool:
        return bool(self._faults)

    def action_for(self, to: Literal["client", "server"], subjects: Sequence[Subject]) -> FaultAction:
        """Return the action for a message; :data:`PASS` if no fault applies."""
        copies, delay, remarks = 1, 0.0, []
        for fault in self._faults:
            if fault.what in (FaultKind.REFUSE, FaultKind.SLOW_READER) or not fault.matches(to, subjects):
                continue
            if fault.what is FaultKind.DROP:
                return FaultAction(0, 0.0, "(dropped by a fault)")
            if fault.what is FaultKind.DELAY:
                delay += fault.amount
                remarks.append(f"delayed by {fault.amount:g} s")
            else:
                copies *= int(fault.amount)
                remarks.append(f"{int(fault.amount)} times")
        return FaultAction(copies, delay, f"({', '.join(remarks)})") if remarks else PASS

    def refusal(self) -> int | None:
        """Return the HTTP status with which to refuse a connection; None to accept it."""
        for fault in self._faults:
            if fault.what is FaultKind.REFUSE and fault.hit():
                return int(fault.amount)
        return None

    @property
    def read_rate(self) -> float | None:
        """Messages per second that each client reads; None: no limit."""
        rates = [fault.amount for fault in self._faults if fault.what is FaultKind.SLOW_READER]
        return min(rates, default=None)
