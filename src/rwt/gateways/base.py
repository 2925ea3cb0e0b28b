"""Base of every gateway: admission, the client's view of the graph, turns, counters and log lines.

A gateway translates one protocol into verbs of the graph; what is the same in all protocols is here.

* :class:`Gateway`: what the server starts, asks for pages and metrics, and closes.
* :class:`ConnectionGateway` and :class:`ConnectedClient`: for protocols whose clients keep a connection
  (rosbridge, Foxglove). Over HTTP, clients are present from request to request: :mod:`rwt.gateways.visitors`.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any, ClassVar, Final, Generic, NamedTuple, Protocol, TypeVar

from rwt.access.access import Access
from rwt.access.audit import Audit, LineRate, is_written, one_line
from rwt.access.client_graph import ClientGraph
from rwt.access.decisions import declare
from rwt.access.graph_view import GraphView
from rwt.access.roles import Role
from rwt.delivery.shared_graph import SharedGraph, scheduler_of
from rwt.gateways.early_look import MAX_STOP_BYTES, EarlyLook, LookState, Seen
from rwt_graph.api import Graph
from rwt_graph.clock import Clock
from rwt_protocol.states import StateEnum
from rwt_transports.api import FlowControl
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.errors import Refused
from rwt_transports.http.routes import HttpExtension
from rwt_transports.limits import RateLimit
from rwt_transports.scheduler import MESSAGES, Scheduler
from rwt_transports.websocket.close_codes import POLICY

ALONE_BYTES: Final = 2 * 1024 * 1024
"""Larger messages of a connection wait for a turn of their own: receiving one has used a good part of this
turn."""

LARGE_BYTES: Final = 64 * 1024
"""Maximum size of a message that waits for nothing but a turn, in bytes."""

_SMALL_BYTES: Final = 4096
"""Maximum size of a message that is read in a turn that is full, but not twice full."""

_MAX_AHEAD: Final = 64
"""Maximum number of frames of one read that are queued to look for a press of the stop behind others."""

_COUNTED_SECONDS: Final = 0.001
"""Work of small messages of all clients that is counted in a turn together: to count each costs too much."""

T = TypeVar("T")
W = TypeVar("W")
C = TypeVar(
    "C", bound="ConnectedClient[Any, Any]"
)  # Any: each gateway defines the form in which its messages wait.


class AcceptPeer(Protocol):
    """Accept function of a gateway, for one WebSocket subprotocol."""

    def __call__(self, sink: Sink, info: PeerInfo, *, loopback: bool) -> Endpoint:
        """Accept a new client.

        Args:
            loopback: True if the listener can only be reached from this machine.

        Raises:
            Refused: the client is not admitted.
        """


class Gateway(ABC):
    """Gateway of one protocol to the graph.

    Attributes:
        name: name of the protocol, in metrics and for the gate (`rosbridge:3`).
        verbs: verbs that its clients may request (:data:`rwt.access.decisions.VERBS`); others are rejected.
        shared: the gateway's part in the graph, which all of its clients share, and their counters.
        websockets: accept functions by WebSocket subprotocol.
        http: pages, section of the index page, and metrics of the gateway.

    Args:
        node: absolute name of the node as which all clients act. The robot displaces what it holds; other
            processes know that only of the names in :func:`rwt_graph.names.is_for_clients`.
        linger: seconds that a publisher outlives its last user among the clients.
    """

    name: ClassVar[str]
    verbs: ClassVar[tuple[str, ...]] = ()

    def __init__(self, graph: Graph, access: Access, node: str, linger: float) -> None:
        if self.verbs:
            declare(self.name, *self.verbs)
        self.access = access
        self.shared = SharedGraph(graph, node, linger, partial(access.audit.write, logging.INFO, "%s"))
        self.websockets: Mapping[str, AcceptPeer] = {}
        self.http: HttpExtension[GraphView] = HttpExtension()

    @property
    def clients(self) -> Sequence[ConnectedClient[Any, Any]]:
        """Connected clients, oldest first. Requests over HTTP are only counted."""
        return ()

    @abstractmethod
    def reload_roles(self) -> None:
        """Give each client the role of the current settings, and withdraw what that role does not allow.

        Called after :meth:`rwt.access.access.Access.reload`. Overriding methods call this one first.
        """
        self.shared.publishers.end_latched(self.access.may_latch)

    def close(self) -> None:
        """Leave the graph. Call it after all clients have been disconnected."""
        self.shared.close()


MakeGateway = Callable[["Graph", "Access"], Gateway]
"""Factory of a gateway for a running graph."""


def client_scheduler(clock: Clock) -> Scheduler:
    """Return the scheduler that all clients of a gateway share.

    Waiting work is done one client at a time, and so is the work of clients beyond their rate. So however
    many clients have much to do, one that sends a small message now and then waits for one of them at most.
    They lose nothing while no other client needs the server: turns follow each other at once.
    """
    return scheduler_of(clock, MESSAGES, one_at_a_time=True)


class ConnectionGateway(Gateway, Generic[C]):
    """Gateway whose clients keep a connection.

    Attributes:
        log_prefix: first word of log lines about clients, followed by a space.
    """

    log_prefix: ClassVar[str] = ""

    def __init__(self, graph: Graph, access: Access, node: str, linger: float) -> None:
        super().__init__(graph, access, node, linger)
        self.scheduler = client_scheduler(graph.clock)
        self._clients: dict[int, C] = {}
        self._count = 0
        graph.observers.add(self._on_connection)
        graph.problems.observers.add(self._on_problem)

    @property
    def clients(self) -> tuple[C, ...]:
        """Connected clients, oldest first."""
        return tuple(self._clients.values())

    @property
    def client_count(self) -> int:
        """Number of connected clients."""
        return len(self._clients)

    def _on_connection(self, text: str, is_connected: bool) -> None:
        """Report to the clients that the graph has lost other processes, or has found them again."""
        for client in self.clients:
            client.report_connection(text, is_connected)

    def _on_problem(self, name: str, text: str) -> None:
        """Report to the clients that use a topic why that is not possible."""
        for client in self.clients:
            client.report_problem(name, text)

    def close(self) -> None:
        """See :meth:`Gateway.close`."""
        self.shared.graph.observers.discard(self._on_connection)
        self.shared.graph.problems.observers.discard(self._on_problem)
        super().close()

    @abstractmethod
    def accept(self, sink: Sink, info: PeerInfo, *, loopback: bool) -> Endpoint:
        """Accept a new client, see :class:`AcceptPeer`."""

    def join(self, role: Role, info: PeerInfo, make: Callable[[int, ClientGraph], C]) -> C:
        """Create the client of an admitted connection by `make(number, graph)`; count and log it."""
        self._count += 1
        number = self._count
        graph = self.access.client(
            self.shared, role, info.address, f"{self.name}:{number}", info.headers.get("user-agent", "")
        )
        client = self._clients[number] = make(number, graph)
        self.shared.counters.clients += 1
        self.access.audit.write(
            logging.INFO, f"{self.log_prefix}client %d joined from %s over %s as %s",
            number, info.address or "?", info.transport, role.described, client=f"{self.name}:{number}",
        )  # fmt: skip
        return client

    def left(self, client: C) -> None:
        """Remove a client whose connection has ended, and keep its counts."""
        del self._clients[client.number]
        self.shared.counters.left(client.messages, client.sink.traffic)

    def reload_roles(self) -> None:
        """See :meth:`Gateway.reload_roles`. A client that is no longer admitted is disconnected."""
        super().reload_roles()
        for client in self.clients:
            client.reload_role()


class ReplySender:
    """Sender of messages besides samples to one client, with their size limit; logs lines about the client.

    Attributes:
        max_bytes: size of the largest message (`limits.outgoing_message_bytes`).
    """

    __slots__ = ("_audit", "_name", "_number", "_prefix", "log_rate", "max_bytes", "monotonic", "sink")

    def __init__(self, gateway: ConnectionGateway[Any], number: int, sink: Sink) -> None:
        self.sink = sink
        self.log_rate = LineRate(per_second=1, burst=50)
        self.monotonic = gateway.shared.graph.clock.monotonic
        self._audit: Audit = gateway.access.audit
        self.max_bytes = gateway.access.limits.outgoing_message_bytes
        self._number = number
        self._prefix = gateway.log_prefix
        self._name = f"{gateway.name}:{number}"

    def too_large(self, size: int) -> str | None:
        """Return why a message of `size` bytes is not sent; None if it is within the limit."""
        if size <= self.max_bytes:
            return None
        return f"a message of {size} bytes, and {self.max_bytes} is the limit (limits.outgoing_message_bytes)"

    def log(self, level: int, text: str, id_: object = None) -> None:
        """Log a line with the client's number and the id of the op, within the rates of lines."""
        if not is_written(level):
            return
        now, others = self.monotonic(), self._audit.rejections
        # Before anything is formatted: most lines of a flood are dropped.
        if not (self.log_rate.admit(now) and others.admit(now)):
            return
        note = "" if id_ is None else f"[id: {one_line(str(id_))}] "
        line = f"{note}{one_line(text)}{self.log_rate.note()}{others.note()}"
        self._audit.write(
            level, f"[{self._prefix}client %d] %s", self._number, line, client=self._name, op_id=id_
        )

    def log_internal_error(self, op: str, error: Exception, id_: object = None) -> None:
        """Log a fault of the server with its traceback. The client only receives "internal error"."""
        self._audit.write(
            logging.ERROR, "internal error in %s", op, client=self._name, op_id=id_, error=error
        )


class Arriving(NamedTuple):
    """Message that is read in steps while `may_go_on` returns True."""

    steps: Iterator[None]
    may_go_on: Callable[[], bool] = lambda: True


class UnreadFrame(NamedTuple):
    """Frame that waits for a later turn before it is read."""

    data: bytes
    binary: bool


class _ClientState(StateEnum):
    READING = "HELD", "RELEASING"
    HELD = "READING", "RELEASING"
    RELEASING = "GONE"
    GONE = ()


_READING: Final = _ClientState.READING


class ConnectedClient(ABC, Generic[T, W]):
    """Client with a connection, whose messages are read in turns. Each connection is a new client (DIS-06).

    Life cycle::

        READING ── something waits ──> HELD ── closed() ──> RELEASING ── all is released ──> GONE
           │ ^─── nothing waits ────────┘                       ^
           └──────────────────────── closed() ──────────────────┘

    * **READING**: each frame is read when it arrives.
    * **HELD**: frames, messages, or the rest of one wait; nothing is read from the client.
    * **RELEASING**: the connection has ended. What the client holds is released one thing per step, for a
      share of each turn. Whatever waited is dropped.
    * **GONE**: nothing is left.

    The way of a frame: its size, turn and rate are checked, in this order; then it is read once, by the
    gateway's `decode`, and its messages are run.

    A frame waits beyond the client's share of a turn (`MESSAGES`), in turns that all clients together have
    filled, and beyond the client's rate of work. A client that exceeds its rate of messages, or is no longer
    admitted, is disconnected. Before a frame waits or its client is disconnected, it may get an early look
    (:mod:`rwt.gateways.early_look`).

    Attributes by purpose:

    * Connection: ``number``, ``info``, ``sink``, ``replies``, ``_flow_control`` (None without one, and once
      over).
    * View of the graph: ``graph``, and ``is_role_by_auth`` (True once an `auth` op gave the role).
    * Reading: ``_decode``.
    * Accounting: ``messages`` (received so far), ``_rate`` (limit on them, None without one), ``_work``.
    * Emergency stop: ``_look`` (early look of the connection).
    * Work, in seconds: ``_worked`` (in all), ``_counted`` (of these, charged to the client), ``_noted`` (of
      these, counted in a turn of all clients), ``_turn_began`` (``_worked`` at the beginning of this turn),
      ``_began`` (monotonic time at which the current frame began).
    * This turn: ``_received`` (bytes that had arrived at the last read: another number is another turn),
      ``_is_beyond`` (True if the client is beyond its rate), ``_needs_turn`` (True if it then needs a turn of
      its own), ``_is_put_off`` (True if its only message waits since others have overfilled the turn).
    * Queue: ``_state``, ``_waiting``.

    Args:
        decode: reads a frame (its bytes, True if it is binary, and the monotonic time) and returns its
            messages in order. Never raises.
    """

    def __init__(
        self,
        gateway: ConnectionGateway[Any],
        number: int,
        info: PeerInfo,
        graph: ClientGraph,
        replies: ReplySender,
        decode: Callable[[bytes, bool, float], Sequence[T]],
    ) -> None:
        limits = gateway.access.limits
        rate = limits.messages_per_second
        self._gateway = gateway
        self._turns = gateway.scheduler
        self._monotonic = graph.clock.monotonic
        self.number = number
        self.info = info
        self.sink = replies.sink
        self.replies = replies
        self.graph = graph
        self.is_role_by_auth = False
        self._decode = decode
        self.messages = 0
        self._rate = RateLimit(rate, limits.messages_burst) if rate else None
        self._work = graph.work
        self._look = EarlyLook(gateway.scheduler)
        self._flow_control: FlowControl | None = None
        self._state = _READING
        self._received = 0
        self._worked = self._counted = self._noted = self._turn_began = 0.0
        self._is_beyond = self._needs_turn = graph.work.excess > 0.0
        self._is_put_off = False
        self._began = 0.0
        self._waiting: deque[T | W | UnreadFrame | Arriving] = deque()

    @property
    def _is_held(self) -> bool:
        return self._state is _ClientState.HELD

    @property
    def _is_over(self) -> bool:
        return self._state in (_ClientState.RELEASING, _ClientState.GONE)

    def receive(self, data: bytes, binary: bool) -> None:
        """Process one frame, or queue it if the client has used its share of the turn.

        Without calls that could be saved, because it runs for each message.
        """
        received = self.sink.received
        # More bytes have arrived since the last frame: this is another read, so another turn.
        if received != self._received:
            self._received = received
            self._turn_began = self._worked
            self._needs_turn = self._is_beyond
        size = len(data)
        if size > LARGE_BYTES and (
            (size > ALONE_BYTES and self._flow_control is not None)
            or self._is_held_up(UnreadFrame(data, binary))
        ):
            self._wait_unread(data, binary)
            return
        if (
            self._state is not _READING
            or self._needs_turn
            or self._turns.is_full
            or self._worked - self._turn_began > MESSAGES.share
        ) and self._must_wait(size):
            self._put_off(data, binary)
            return
        now = self._began = self._monotonic()
        if self._rate is None or self._is_within_rate(now, data, binary):
            self.messages += 1
            if size > LARGE_BYTES:
                self._read(data, binary, now)
            else:  # Without that call.
                self._run(self._decode(data, binary, now), now)
        took = self._monotonic() - now
        self._worked += took
        self._noted += took
        turns = self._turns
        turns.uncounted += took
        if turns.uncounted > _COUNTED_SECONDS:
            turns.count()
        if self._worked - self._counted > MESSAGES.share:
            self._count_work()

    def _put_off(self, data: bytes, binary: bool) -> None:
        """Queue a frame, unless it is for the emergency stop and has an early look."""
        seen = self._look_at(data, binary)
        if seen is Seen.OTHER:
            self._wait_unread(data, binary)
        elif seen is Seen.REFUSED:
            self._is_within_rate(self._began)  # Charged after all, like any other message.

    def _look_at(self, data: bytes, binary: bool) -> Seen:
        """Press the emergency stop ahead of all that waits, if a frame asks for it and has an early look."""
        if (
            len(data) > MAX_STOP_BYTES
            or not self.graph.is_stop_due
            or not self._names_stop(data, binary)
            or not self._look.begin()
        ):
            return Seen.OTHER
        now = self._began = self._monotonic()
        is_for_stop = False
        try:
            # Decoded twice: the first time has no effects, so a frame for something else can still wait.
            is_for_stop = self._presses_stop(data, binary)
            if is_for_stop:
                self.messages += 1
                self._run(self._decode(data, binary, now), now)
        finally:
            is_stopped = self.graph.is_stopped
            self._look.end(is_stopped=is_stopped)
            self._worked += self._monotonic() - now
            self._count_work()
        if is_for_stop:
            return Seen.PRESSED if is_stopped else Seen.REFUSED
        return Seen.OTHER

    @abstractmethod
    def report_connection(self, text: str, is_connected: bool) -> None:
        """Send a notice about the graph's connection to other processes."""

    @abstractmethod
    def _names_stop(self, data: bytes, binary: bool) -> bool:
        """Return True if a small frame may be for the emergency stop. Decodes nothing."""

    @abstractmethod
    def report_problem(self, topic: str, text: str) -> None:
        """Send a problem of a topic to a client that uses it; no-op for other topics."""

    def _presses_stop(self, data: bytes, binary: bool) -> bool:
        """Return True if a frame that names the emergency stop only presses it. Has no effects."""
        return True

    def _wait_unread(self, data: bytes, binary: bool) -> None:
        # The wire reuses its buffers.
        self._wait(UnreadFrame(data if type(data) is bytes else bytes(data), binary))

    @abstractmethod
    def _resume(self, what: T | W, now: float) -> None:
        """Run a message that waited for this turn, or the rest of one."""

    @abstractmethod
    def _run(self, messages: Sequence[T], now: float) -> None:
        """Process the messages of one frame. The first is already counted."""

    def _run_several(self, messages: Sequence[T], now: float) -> None:
        """Process the messages of a frame one by one, as :meth:`receive` does frames."""
        for number, message in enumerate(messages):
            if number:
                if (
                    self._waiting
                    or self._worked - self._turn_began + self._monotonic() - now > MESSAGES.share
                ):
                    for later in messages[number:]:
                        self._wait(later)
                    return
                self.messages += 1
                if not self._is_within_rate(now):
                    return
            self._run((message,), now)

    def _read(self, data: bytes, binary: bool, now: float) -> None:
        """Read an admitted frame and run its messages. Gateways may read large frames in steps."""
        self._run(self._decode(data, binary, now), now)

    def _is_within_rate(self, now: float, data: bytes = b"", binary: bool = False) -> bool:
        """Return True if one more message is within the rate, and disconnect the client otherwise.

        Without disconnecting, further reading would favour the client over all others. A frame that presses
        the emergency stop in its early look is beyond the rate, too.
        """
        if self._rate is None or self._rate.take(now):
            return True
        if self._look_at(data, binary) is not Seen.PRESSED:
            rate = self._gateway.access.limits.messages_per_second
            reason = f"more than {rate} messages a second (limits.messages_per_second)"
            self.replies.log(logging.WARNING, reason)
            self.sink.close(POLICY, reason)
        return False

    @property
    def holds_wire(self) -> bool:
        """True if frames behind one that waits stay on the wire: none of them may press the stop ahead."""
        return (
            len(self._waiting) >= _MAX_AHEAD
            or not self.graph.is_stop_due
            or self._look.state is LookState.SUSPENDED
        )

    def set_flow_control(self, flow_control: FlowControl) -> None:
        """Pause this client through `flow_control` while its messages wait."""
        self._flow_control = flow_control

    def _must_wait(self, size: int) -> bool:
        worked = self._worked - self._turn_began
        if (
            self._waiting
            or worked > MESSAGES.share
            or (self._turns.is_full and (worked or size > _SMALL_BYTES))
        ):
            return True
        if self._turns.is_overfull:
            self._is_put_off = not self._is_beyond
            return True
        if self._needs_turn:
            self._is_beyond = self._work.excess > 0.0
            # Once per read, which is within one turn.
            self._needs_turn = self._is_beyond and not self._turns.take(self)
        return self._needs_turn

    def _has_time(self) -> bool:
        """Return True if another step of a large message may begin in this turn."""
        return self._worked - self._turn_began + self._monotonic() - self._began <= MESSAGES.steps

    def _count_work(self) -> None:
        """Charge the work since the last call; too slow for every message."""
        seconds, unnoted = self._worked - self._counted, self._worked - self._noted
        self._counted = self._noted = self._worked
        self._work.add(seconds, "messages")
        self._turns.note(unnoted)
        self._is_beyond = self._needs_turn = self._work.excess > 0.0

    def take_steps(self, steps: Iterator[None], may_go_on: Callable[[], bool]) -> None:
        """Adopt the steps in which the wire reads a message, charged to the client."""
        self._wait(Arriving(steps, may_go_on))

    def _wait(self, what: T | W | UnreadFrame | Arriving) -> None:
        """Queue a frame, a message, or the rest of one, and pause reading from this client."""
        if self._is_over:
            return
        self._waiting.append(what)
        if self._state is _READING:
            self._state = self._state.become(_ClientState.HELD)
            if self._flow_control is not None:
                self._flow_control.pause()
            self._ask_for_turn()
        elif len(self._waiting) == _MAX_AHEAD and self._flow_control is not None:
            self._flow_control.pause()  # Again, since now it also holds the wire.

    def _ask_for_turn(self) -> None:
        if self._is_beyond:
            self._work.note_wait()
        if self._is_put_off:
            self._is_put_off = False
            self._turns.wait_briefly(partial(self._go_on, is_brief=True))
        else:
            self._turns.wait(self._go_on)

    def _is_held_up(self, what: T | W | UnreadFrame) -> bool:
        """Return True if `what` has to wait for something other than a turn."""
        return False

    def _go_on(self, *, is_brief: bool = False) -> None:
        """Process queued work within the time of this turn; only one message if `is_brief`."""
        if self._waiting:
            first = self._waiting[0]
            if not first.may_go_on() if isinstance(first, Arriving) else self._is_held_up(first):
                self._turns.retry(self._ask_for_turn)
                return
        # What is put off meanwhile is the rest of the message in progress, so it stays in front of the
        # others.
        waiting, self._waiting = self._waiting, deque()
        self._turn_began = self._worked
        try:
            while waiting and not (self._waiting or self._is_over):
                if self._worked - self._turn_began > MESSAGES.share:
                    break
                what = waiting.popleft()
                now = self._began = self._monotonic()
                if isinstance(what, Arriving):
                    self._read_on(what)
                elif isinstance(what, UnreadFrame):
                    if self._is_within_rate(now, *what):
                        self.messages += 1
                        self._read(*what, now)
                else:
                    self._resume(what, now)
                self._worked += self._monotonic() - now
                if is_brief:
                    self._turn_began = self._worked - 2 * MESSAGES.share  # The share is used up.
        finally:
            # `closed()` has released everything: the remaining steps have no client.
            if not self._is_over:
                self._waiting += waiting
                self._count_work()
            if self._waiting:
                self._ask_for_turn()
            else:
                if self._is_held:
                    # Before the connection is resumed, which delivers what it has kept within this call.
                    self._state = self._state.become(_READING)
                if self._flow_control is not None:
                    self._flow_control.resume()
                if self._is_over:
                    self._flow_control = None

    def _read_on(self, arriving: Arriving) -> None:
        for _ in arriving.steps:
            if not self._has_time():
                self._wait(arriving)
                return

    def take_role(self, role: Role) -> None:
        """Switch to another role. Open resources stay open until :meth:`withdraw_refused`."""
        self.graph.take_role(role)

    def withdraw_refused(self) -> None:
        """Withdraw what the client's role does not allow."""
        self.graph.withdraw_refused()

    def reload_role(self) -> None:
        """Apply the client's role in the current settings; disconnect it if it is no longer admitted."""
        try:
            role = self._gateway.access.admission.role_now(
                self.info, self.graph.role.name if self.is_role_by_auth else None
            )
        except Refused as refused:
            self.sink.close(POLICY, refused.reason)
            return
        self.take_role(role)
        self.withdraw_refused()

    def closed(self, code: int, reason: str) -> None:
        """Called when the connection has ended: release everything (DIS-01 … DIS-07)."""
        if not self._is_held:  # Else the next turn resumes the connection first.
            self._flow_control = None  # Break the cycle: the connection refers to this client.
        self._state = self._state.become(_ClientState.RELEASING)
        self._waiting.clear()
        steps = self.graph.leave()
        self._gateway.left(self)
        self._release_in_turns(chain(self._releases(), steps))
        reason = one_line(reason)
        if left_out := self.replies.log_rate.left_out:
            reason += f" ({left_out} lines about it were left out)"
        self._gateway.access.audit.write(
            logging.INFO, f"{self._gateway.log_prefix}client %d left: %s",
            self.number, one_line(f"{code} {reason}".rstrip()),  # The client may have chosen the reason.
            client=f"{self._gateway.name}:{self.number}",
        )  # fmt: skip

    @abstractmethod
    def _releases(self) -> Iterator[None]:
        """Release what the client holds besides its graph, one thing per step."""

    def _release_in_turns(self, steps: Iterator[None]) -> None:
        """Run steps for this turn's share, and the rest in later turns."""
        self._began = self._monotonic()
        self._turn_began = self._worked
        try:
            for _ in steps:
                if self._turns.is_full or not self._has_time():
                    self._turns.wait(partial(self._release_in_turns, steps))
                    return
            self._state = self._state.become(_ClientState.GONE)
        finally:
            self._worked += self._monotonic() - self._began
            self._count_work()
