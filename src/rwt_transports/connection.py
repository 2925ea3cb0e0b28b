"""One connection that carries messages, without I/O, and what all those of a listener share."""

from __future__ import annotations

import logging
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Final, Protocol

import anyio

from rwt_protocol.frames import Buffer
from rwt_transports.api import (
    DriverCallbacks,
    FlowControlled,
    Framing,
    HangUp,
    HangUpAware,
    Holding,
    Link,
    OversizeAware,
    StepTaking,
    StepWise,
    Wire,
    WireEvents,
)
from rwt_transports.background import Paced, TaskStarter
from rwt_transports.endpoint import Accept, Endpoint, PeerInfo
from rwt_transports.errors import Refused, log_exception
from rwt_transports.http.addresses import AddressCount
from rwt_transports.http.routes import EVERY_NAME, NO_PROXIES, Hosts, Proxies
from rwt_transports.limits import Limits
from rwt_transports.outbox import Outbox
from rwt_transports.websocket.close_codes import ABNORMAL, GOING_AWAY, INTERNAL_ERROR, POLICY
from rwt_transports.websocket.deflate import deflate_server
from rwt_transports.websocket.extensions import DeflateTerms
from rwt_transports.websocket.wire import SERVER_FRAMING
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

logger = logging.getLogger("rwt_transports")

TICK_SECONDS = 0.5

MakeWire = Callable[[WireEvents, Limits, ReceiveBufferPool], Wire]
"""Makes the wire of one new connection."""


class PeerConnection(DriverCallbacks, Protocol):
    """What stands behind one peer's link, as its listener sees it: HTTP, or a wire's messages."""

    @property
    def address(self) -> str:
        """The peer's address, empty where there is none."""

    def begin(self) -> None:
        """Start, with the link at hand."""

    def tick(self, now: float) -> None:
        """Check the time-outs; `now` is monotonic, in seconds."""

    def close(self, code: int, reason: str) -> None:
        """Begin to close."""

    def abort(self) -> None:
        """Cut the connection."""


MakeConnection = Callable[["ListenerState", Link, str, int], PeerConnection]
"""Makes what serves a new peer: the state, its link, its address and its port."""


@dataclass(slots=True)
class ListenerState:
    """What all connections of one listener share.

    Attributes:
        accept: makes the endpoint of a new peer.
        make_wire: makes its wire.
        http: makes what serves a new peer until its upgrade; None for transports without HTTP.
        transport: the URL scheme, for :class:`~rwt_transports.endpoint.PeerInfo`.
        single: whether everything ends with the one peer that there is.
        idle_seconds: silence after which a peer counts as gone; 0 for never.
        max_message_size: bytes of the largest message that can be sent; 0 for any.
        addresses: how many connections each address has.
        hosts: the names by which HTTP requests may address the listener.
        proxies: whose word about their clients counts.
        access_log: whether each HTTP request is logged.
        subprotocols: what WebSockets may speak besides rosbridge.
        ended: set when the one peer has gone, and when the listener has closed.
        tasks: where an HTTP handler runs that waits or streams; there while the listener is open.
        requests: those over HTTP, of which one turn of the event loop reads few.
        connections: those that are open.
    """

    accept: Accept
    make_wire: MakeWire
    limits: Limits
    http: MakeConnection | None
    transport: str
    single: bool = False
    idle_seconds: float = 0.0
    max_message_size: int = 0
    addresses: AddressCount = field(default_factory=AddressCount)
    hosts: Hosts = EVERY_NAME
    proxies: Proxies = NO_PROXIES
    access_log: bool = False
    subprotocols: frozenset[str] = frozenset()
    tasks: TaskStarter | None = None
    requests: Paced = field(default_factory=Paced)
    ended: anyio.Event = field(default_factory=anyio.Event)
    buffers: ReceiveBufferPool = field(default_factory=ReceiveBufferPool)
    connections: set[PeerConnection] = field(default_factory=set)
    closing: bool = False
    _empty: anyio.Event | None = None

    def attach(self, link: Link, address: str, port: int) -> None:
        """A new peer has connected."""
        self.add((self.http or Connection)(self, link, address, port), link)

    def add(self, connection: PeerConnection, link: Link) -> None:
        """Let a connection have its link, and begin."""
        self.connections.add(connection)
        self.addresses.enter(connection.address)
        link.set_callbacks(connection)
        too_many = len(self.connections) > 2 * self.limits.connections
        if self.closing or too_many or self.addresses.is_flooding(connection.address):
            connection.abort()
        else:
            connection.begin()

    def replace(self, former: PeerConnection, connection: PeerConnection, link: Link) -> None:
        """Let `connection`, which has begun already, take over the link of `former`."""
        self.connections.discard(former)
        self.connections.add(connection)
        link.set_callbacks(connection)

    def tick(self, now: float) -> None:
        """Check the time-outs of every connection; `now` is monotonic, in seconds."""
        for connection in tuple(self.connections):
            try:
                connection.tick(now)
            except Exception:
                # One failure must not keep the others waiting.
                log_exception("the time-outs of %s failed; cutting it", connection)
                connection.abort()

    def close(self, code: int, reason: str) -> None:
        """Begin to close every connection, and accept no more."""
        self.closing = True
        for connection in tuple(self.connections):
            connection.close(code, reason)

    async def watch(self) -> None:
        """Check the time-outs of every connection about twice a second, until cancelled."""
        while True:
            self.tick(time.monotonic())
            await anyio.sleep(TICK_SECONDS)

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[None]:
        """Let handlers run and check time-outs within the block; then close every connection with 1001."""
        async with anyio.create_task_group() as tasks:
            self.tasks = TaskStarter()
            tasks.start_soon(self.tasks.run, tasks)
            tasks.start_soon(self.requests.run)
            tasks.start_soon(self.watch)
            try:
                yield
            finally:
                await self.end(GOING_AWAY, "the server is going away")
                tasks.cancel_scope.cancel()

    async def end(self, code: int, reason: str) -> None:
        """Close every connection, and cut those that are still open after ``limits.close_seconds``."""
        with anyio.CancelScope(shield=True):
            self.close(code, reason)
            with anyio.move_on_after(self.limits.close_seconds):
                await self._emptied()
            for connection in tuple(self.connections):
                connection.abort()
            await self._emptied()

    async def _emptied(self) -> None:
        while self.connections:
            self._empty = anyio.Event()
            await self._empty.wait()

    def detach(self, connection: PeerConnection) -> None:
        """A connection has ended."""
        self.connections.discard(connection)
        self.addresses.leave(connection.address)
        if not self.connections and self._empty is not None:
            self._empty.set()
        if self.single:
            self.ended.set()


class Connection:
    """Stands between a driver and an endpoint; see :mod:`rwt_transports.api`."""

    __slots__ = (
        "_alive",
        "_closed_with",
        "_deadline",
        "_ending",
        "_endpoint",
        "_hang_up_aware",
        "_heard",
        "_holding",
        "_is_asked",
        "_is_paused",
        "_link",
        "_pinged",
        "_port",
        "_state",
        "_step_wise",
        "_wire",
        "address",
        "outbox",
        "put_back",
        "take",
        "take_pieces",
    )

    def __init__(
        self, state: ListenerState, link: Link, address: str, port: int, terms: DeflateTerms | None = None
    ) -> None:
        self._state = state
        self._link = link
        self.address = address
        self._port = port
        limits = state.limits
        self._wire: Wire = (
            state.make_wire(self, limits, state.buffers)
            if terms is None
            else deflate_server(terms, self, limits, state.buffers)
        )
        wire: object = self._wire
        self._holding = wire if isinstance(wire, Holding) else None
        self._step_wise = wire if isinstance(wire, StepWise) else None
        self.outbox = _ConnectionSink(self, self._wire.framing, limits, link.wake)
        self.take: Callable[[], Buffer | None] = self.outbox.take
        self.take_pieces: Callable[[], Sequence[Buffer]] = self.outbox.take_pieces
        self.put_back: Callable[[Sequence[Buffer]], None] = self.outbox.put_back
        self._endpoint: Endpoint | None = None
        self._closed_with: tuple[int, str] | None = None
        self._ending = False
        self._deadline: float | None = None
        self._heard: float | None = None
        self._alive = True
        self._pinged = False
        self._hang_up_aware = link if isinstance(link, HangUpAware) else None
        self._is_paused = False
        self._is_asked = False  # to answer, since it sends no more

    def begin(self) -> None:
        """Open at once, where the transport has no handshake."""
        state = self._state
        peer = PeerInfo(state.transport, self.address, self._port, max_message_size=state.max_message_size)
        if len(state.connections) > state.limits.connections:
            logger.warning("no room for %s: %d connections", self, state.limits.connections)
            self._link.abort()
            return
        try:
            state.addresses.check(self.address)
            self.open(peer)
        except Refused as refused:
            self.close(POLICY, refused.reason)
        except Exception:
            log_exception("the accept function failed for %s", self)
            self.close(INTERNAL_ERROR, "internal error")

    # -- the driver's side ---------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Bytes arrived."""
        self._alive = True
        self.outbox.received += len(data)
        try:
            self._wire.feed(data)
        except Exception:
            self._broken_inside()

    def get_buffer(self) -> memoryview | None:
        """Where the next bytes may be received directly."""
        return self._wire.get_buffer()

    def buffer_updated(self, count: int) -> None:
        """`count` bytes were received into the buffer that :meth:`get_buffer` gave."""
        self._alive = True
        self.outbox.received += count
        try:
            self._wire.buffer_updated(count)
        except Exception:
            self._broken_inside()

    def progress(self) -> None:
        """The network took bytes again."""
        self._alive = True

    def eof(self) -> None:
        """The peer will send nothing more."""
        self._end_endpoint(ABNORMAL, "the peer went away without a word")
        self._ending = True
        # A peer that only closed its sending side still gets the answers made so far.
        self.outbox.when_empty(self._link.close)

    def lost(self) -> None:
        """The link is gone."""
        self._state.detach(self)
        self._state.buffers.release(self._wire)
        self._state.buffers.is_read(self._wire)
        self._ending = True
        self.outbox.discard()
        self._end_endpoint(ABNORMAL, "the connection was lost")
        # What it refers to refers to it, and would stay until a full collection of garbage.
        self._wire, self._holding, self._step_wise = _NO_WIRE, None, None

    # -- the endpoint's side -------------------------------------------------------------------------------

    def close(self, code: int = 1000, reason: str = "") -> None:
        """Close after what is queued in the control lane; a second call does nothing."""
        if self._ending:
            return
        self._ending = True
        self._closed_with = (code, reason)
        last = self._wire.close(code, reason)
        self.outbox.finish(last)
        if not last:
            self.outbox.when_empty(self._link.close)

    def abort(self) -> None:
        """Cut the connection."""
        self._link.abort()

    # -- the endpoint's flow control -----------------------------------------------------------------------

    def pause(self) -> None:
        """Take nothing more from the peer for now."""
        self._is_paused = True
        self._state.buffers.keep_unread(self._wire)
        self._link.pause()
        if self._holding is not None:
            self._holding.hold()

    def resume(self) -> None:
        """Read from the peer again."""
        self._is_paused = False
        self._state.buffers.is_read(self._wire)
        self._link.resume()
        if self._holding is not None and self._endpoint is not None:  # Else nobody wants what it holds.
            try:
                self._holding.go_on()
            except Exception:
                self._broken_inside()

    def when_empty(self, callback: Callable[[], None]) -> None:
        """Call `callback` once everything sent has been taken."""
        if not self._ending:
            self.outbox.when_empty(callback)

    def overflow(self, reason: str) -> None:
        """Close, since the peer leaves too many replies unread."""
        logger.warning("closing %s: %s", self, reason)
        self.outbox.stop_sending()
        self.close(POLICY, reason)

    def _broken_inside(self) -> None:
        log_exception("an endpoint or a wire failed; closing %s", self)
        self.close(INTERNAL_ERROR, "internal error")

    # -- what the wire reports (WireEvents) ----------------------------------------------------------------

    def oversized(self, size: int) -> bool:
        """A message larger than the limit has begun."""
        return isinstance(self._endpoint, OversizeAware)

    def oversized_head(self, size: int, head: bytes) -> None:
        """What a message begins with that is skipped."""
        endpoint: object = self._endpoint
        if isinstance(endpoint, OversizeAware):
            endpoint.oversized(size, self._state.limits.message_bytes, head)

    def answer(self, data: bytes) -> None:
        """Send bytes of the protocol itself."""
        self.outbox.push(data)

    def pong(self, data: bytes) -> None:
        """Send the reply to a ping, unless the peer does not read."""
        self.outbox.push_if_read(data)

    def ended(self, code: int, reason: str, *, agreed: bool) -> None:
        """The wire is at its end: close, or half-close where the peer broke the protocol and has yet to read
        why."""
        self._ending = True
        if not agreed:
            logger.info("closing %s: %s", self, reason)
        self._end_endpoint(*(self._closed_with or (code, reason)))
        self.outbox.when_empty(self._link.close if agreed else self._link.finish)

    # -- life ----------------------------------------------------------------------------------------------

    def open(self, peer: PeerInfo) -> None:
        """Ask the accept function for an endpoint. Raises what that raises."""
        self._set_endpoint(self._state.accept(self.outbox, peer))

    def _set_endpoint(self, endpoint: Endpoint) -> None:
        """Feed `endpoint` from the next message on."""
        self._endpoint = endpoint
        if isinstance(endpoint, FlowControlled):
            endpoint.set_flow_control(self)
        if self._step_wise is not None:
            self._step_wise.take_steps = endpoint.take_steps if isinstance(endpoint, StepTaking) else None
        if not self._ending:
            self._wire.message = endpoint.receive

    @property
    def ended_with(self) -> tuple[int, str]:
        """Code and reason, once the connection is lost."""
        return self._closed_with or (ABNORMAL, "the connection was lost")

    def hand_over(self, endpoint: Endpoint) -> None:
        """Let `endpoint` take the place of the present one."""
        if self._endpoint is None:
            endpoint.closed(*self.ended_with)
        else:
            self._set_endpoint(endpoint)

    def _end_endpoint(self, code: int, reason: str) -> None:
        """Call the endpoint's `closed`, once."""
        endpoint, self._endpoint = self._endpoint, None
        if endpoint is not None:
            self.outbox.stop_sending()
            self._wire.message = _ignore
            if self._step_wise is not None:
                self._step_wise.take_steps = None
            endpoint.closed(*(self._closed_with or (code, reason)))

    def tick(self, now: float) -> None:
        """Check the time-outs of this connection; `now` is monotonic, in seconds."""
        if self._alive or self._heard is None:
            self._alive = self._pinged = False
            self._heard = now
        silent = now - self._heard
        limits = self._state.limits
        if self._is_paused and self._hang_up_aware is not None:
            self._look_for_hang_up(self._hang_up_aware)
        if self._ending:
            if self._deadline is None:
                self._deadline = now + limits.close_seconds
            elif now >= self._deadline:
                self._link.abort()
        elif self._state.idle_seconds and silent >= self._state.idle_seconds:
            self._forget(f"silent for {silent:.0f} s")
        elif limits.ping_seconds and silent >= limits.ping_seconds:
            self._ping(silent)

    def _look_for_hang_up(self, link: HangUpAware) -> None:
        """Drop what waits for its turn of a peer that has gone: nothing is read from it, so that nobody would
        see it before all is done."""
        hang_up = link.hang_up()
        if hang_up is HangUp.GONE:
            self._forget("the peer went away while it was held back")
        elif hang_up is HangUp.SENDS_NO_MORE and not self._is_asked:
            # It may have sent all that it had to say, and still read. The system of one that was killed
            # answers whatever it is sent with a reset.
            self._is_asked = True
            ping = self._wire.ping()
            if ping:
                self.outbox.push(ping)

    def _ping(self, silent: float) -> None:
        limits = self._state.limits
        if not self._pinged:
            ping = self._wire.ping()
            # Where the protocol has no ping, silence means nothing (TCP-04): the system's own keep-alive
            # finds peers that have gone.
            self._pinged = bool(ping)
            if ping:
                self.outbox.push(ping)
        elif silent >= limits.ping_seconds + limits.pong_seconds:
            logger.info("%s answers no ping, counted as gone", self)
            self._forget(f"no sign of life for {silent:.0f} s")

    def _forget(self, why: str) -> None:
        self._end_endpoint(ABNORMAL, why)
        self._link.abort()

    def __repr__(self) -> str:
        return f"<{self._state.transport} connection {self.address}:{self._port}>"


def _ignore(data: bytes, binary: bool) -> None:
    """Takes what comes when the endpoint has gone, which nothing here refers to any more."""


class _NoWire:
    """Stands in for that of a connection that is lost; satisfies :class:`rwt_transports.api.Wire`."""

    framing = SERVER_FRAMING

    def __init__(self) -> None:
        self.message: Callable[[bytes, bool], None] = _ignore

    def feed(self, data: bytes) -> None:
        """Drop it."""

    def get_buffer(self) -> None:
        """There is none."""

    def buffer_updated(self, count: int) -> None:
        """Drop it."""

    def give_up(self, reason: str) -> None:
        """It is over already."""

    def close(self, code: int, reason: str) -> bytes:
        """It is over already."""
        return b""

    def ping(self) -> bytes:
        """There is none."""
        return b""


_NO_WIRE: Final = _NoWire()


class _ConnectionSink(Outbox):
    """Outbox of a connection as its endpoint sees it. Implements :class:`rwt_transports.endpoint.Sink`."""

    __slots__ = ("_connection", "_ended_with")

    def __init__(
        self, connection: Connection, framing: Framing, limits: Limits, wake: Callable[[], None]
    ) -> None:
        super().__init__(framing, limits, wake, connection.overflow)
        self._connection: Connection | None = connection
        self._ended_with = (ABNORMAL, "the connection was lost")

    def close(self, code: int = 1000, reason: str = "") -> None:
        """Close the connection after what is queued in the control lane; data still queued is not sent."""
        if self._connection is not None:
            self._connection.close(code, reason)

    def hand_over(self, endpoint: Endpoint) -> None:
        """Feed `endpoint` from the next message on."""
        if self._connection is not None:
            self._connection.hand_over(endpoint)
        else:
            endpoint.closed(*self._ended_with)

    def discard(self) -> None:
        """The peer is gone: free everything, and let nothing follow."""
        super().discard()
        if self._connection is not None:
            self._ended_with = self._connection.ended_with
            self._connection = None
