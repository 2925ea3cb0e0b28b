"""Connections that carry messages, without I/O, and the state that the connections of a listener share."""

from __future__ import annotations

import logging
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Final, Protocol

import anyio

from rwt_protocol.extensions import imported_on_call
from rwt_protocol.frames import Framing
from rwt_protocol.states import StateEnum
from rwt_transports.api import (
    DriverCallbacks,
    FlowControlled,
    HangUp,
    HangUpAware,
    HoldableWire,
    HoldingWire,
    Link,
    OversizeAware,
    SizeLimitedWire,
    SizeLimiting,
    StepTaking,
    UnbufferedCallbacks,
    Wire,
    WireEvents,
    drop_message,
)
from rwt_transports.background import TaskStarter, background_tasks
from rwt_transports.endpoint import Accept, Admit, Endpoint, Identify, PeerInfo, anonymous
from rwt_transports.errors import Refused, log_exception
from rwt_transports.http.addresses import AddressCount, holder_of
from rwt_transports.http.proxies import NO_PROXIES, Proxies
from rwt_transports.http.routes import EVERY_NAME, Hosts, HttpRequest, HttpResponse, Routes
from rwt_transports.limits import Limits
from rwt_transports.outbox import Outbox
from rwt_transports.scheduler import REQUESTS, Scheduler
from rwt_transports.shared_pool import Holder, PoolFull, PoolRow, Share, SharedPool
from rwt_transports.websocket.close_codes import (
    ABNORMAL,
    GOING_AWAY,
    INTERNAL_ERROR,
    POLICY,
    TRY_AGAIN_LATER,
)
from rwt_transports.websocket.extensions import DeflateTerms
from rwt_transports.websocket.wire import SERVER_FRAMING
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

if TYPE_CHECKING:
    from rwt_transports.websocket.deflate import DeflateWire

logger = logging.getLogger("rwt_transports")

# Imported with the first client that agrees to compression.
_deflated: Callable[..., DeflateWire] = imported_on_call("rwt_transports.websocket.deflate:DeflateWire")

TICK_SECONDS = 0.5

CONNECTIONS: Final = PoolRow("connections", "limits.connections", "connections of this server")
PENDING: Final = PoolRow("pending connections", "limits.connections", "pending connections of this server")

MakeWire = Callable[[WireEvents, Limits, ReceiveBufferPool], Wire]
"""Factory of the wire of a new connection."""


class PeerConnection(DriverCallbacks, Protocol):
    """Connection of a peer as its listener sees it: HTTP, or the messages of a wire."""

    @property
    def address(self) -> str:
        """Address of the peer; empty if it has none."""

    holder: Holder
    """Client to which the connection counts."""

    def begin(self) -> None:
        """Start after the link is attached."""

    def tick(self, now: float) -> None:
        """Check the timeouts; `now` is monotonic, in seconds."""

    def close(self, code: int, reason: str) -> None:
        """Begin to close."""

    def displace(self, reason: str) -> None:
        """Close in favour of another client."""

    def abort(self) -> None:
        """Cut the connection."""


MakeConnection = Callable[["ListenerState", Link, str, int], PeerConnection]
"""Factory of the connection of a new peer, called with the listener's state, the link, the address and the
port."""


@dataclass(slots=True)
class ListenerState:
    """State that the connections of one listener share.

    All but ``connections``, the shares and ``closing`` is constant while connections are open. ``closing`` is
    set once, in :meth:`close`; from then on, new connections are cut.

    Connections are shares of one of two pools. A new one gets a place if there is room. Otherwise it is
    pending: it may request pages, be refused with a reason, or :meth:`claim` the place of another client once
    its own client is known. Pending connections are as many again, and count to networks: nothing else is
    known of them.

    Attributes:
        accept: factory of the endpoint of a new peer.
        http: factory of the connection that serves a new peer until its upgrade; None for transports without
            HTTP.
        transport: URL scheme, for :class:`~rwt_transports.endpoint.PeerInfo`.
        single: True if the listener ends with its only peer.
        idle_seconds: silence after which a peer counts as gone; 0 for never.
        max_message_size: size of the largest message that can be sent, in bytes; 0 for any.
        addresses: number of connections of each address.
        identify: returns the credential of a connection or request.
        hosts: names by which HTTP requests may address the listener.
        proxies: proxies whose headers about their clients are trusted.
        access_log: True if each HTTP request is logged.
        subprotocols: WebSocket subprotocols other than rosbridge.
        admit: decides about WebSockets in place of `accept`, and may wait; None: `accept` decides at once.
        tasks: starts HTTP handlers that wait or stream; None until the listener is open.
        requests: scheduler of the reading of HTTP requests.
        ended: set when the only peer is gone, and when the listener has closed.
        places: shares of the open connections.
        pending: shares of those without a place.
        closing: True if no more connections are accepted.
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
    admit: Admit | None = None
    identify: Identify = anonymous
    tasks: TaskStarter | None = None
    requests: Scheduler = field(default_factory=partial(Scheduler.immediate, REQUESTS))
    ended: anyio.Event = field(default_factory=anyio.Event)
    buffers: ReceiveBufferPool = field(default_factory=ReceiveBufferPool)
    connections: set[PeerConnection] = field(default_factory=set)
    places: dict[PeerConnection, Share] = field(default_factory=dict)
    pending: dict[PeerConnection, Share] = field(default_factory=dict)
    closing: bool = False
    _empty: anyio.Event | None = None
    _pool: SharedPool = field(init=False)
    _pending_pool: SharedPool = field(init=False)

    def __post_init__(self) -> None:
        self._pool = SharedPool(CONNECTIONS, self.limits.connections)
        self._pending_pool = SharedPool(PENDING, self.limits.connections)

    def attach(self, link: Link, address: str, port: int) -> None:
        if self.http is None:  # No request will name the client of a proxy.
            address, _ = self.proxies.resolve(address, {})
        self.add((self.http or Connection)(self, link, address, port), link)

    def add(self, connection: PeerConnection, link: Link) -> None:
        """Attach a connection to its link, and begin."""
        self.connections.add(connection)
        self.addresses.enter(connection.address)
        # Before the checks, since a driver reports the loss of a refused link, too.
        link.set_callbacks(connection)
        is_flooding = self.addresses.is_flooding(connection.address)
        if self.closing or is_flooding or not self._has_room_for(connection):
            connection.abort()
        else:
            # May end the connection at once: nothing may use it after this call.
            connection.begin()

    def _has_room_for(self, connection: PeerConnection) -> bool:
        """Give a new connection a free place, or else one among the pending; False if there is none."""
        if not self._pool.is_full:
            self._take_place(connection)
            return True
        end = partial(self._displace, self.pending, connection)
        try:
            self.pending[connection] = self._pending_pool.take(connection.holder.network, end)
        except PoolFull:
            return False
        return True

    def claim(self, connection: PeerConnection, peer: PeerInfo) -> None:
        """Give a connection a place, if need be that of another client; no-op before it has authenticated.

        Raises:
            PoolFull: `limits.connections` is reached.
        """
        credential = self.identify(peer)
        if credential is not None:
            connection.holder = holder_of(connection.address, credential)
            self._take_place(connection)

    def _take_place(self, connection: PeerConnection) -> None:
        place = self.places.get(connection)
        if place is not None:
            self._pool.move(place, connection.holder)
            return
        end = partial(self._displace, self.places, connection)
        self.places[connection] = self._pool.take(connection.holder, end)
        self._release(connection, self.pending, self._pending_pool)

    def _displace(self, shares: dict[PeerConnection, Share], connection: PeerConnection, reason: str) -> None:
        del shares[connection]
        logger.info("closing %s: %s", connection, reason)
        # Those that are being closed have no share: they are bounded, too.
        if len(self.connections) - len(self.places) - len(self.pending) > self.limits.connections:
            connection.abort()
        else:
            connection.displace(reason)

    def _release(
        self, connection: PeerConnection, shares: dict[PeerConnection, Share], pool: SharedPool
    ) -> None:
        share = shares.pop(connection, None)
        if share is not None:
            pool.release(share)

    def count_again(self, connection: PeerConnection, address: str) -> None:
        """Count a connection whose client has turned out to be another; `address` is the former one.

        A pending one may still claim a place later.
        """
        if address != connection.address:
            self.addresses.leave(address)
            self.addresses.enter(connection.address)
        if connection in self.places:
            self._pool.move(self.places[connection], connection.holder)
        elif connection in self.pending:
            self._pending_pool.move(self.pending[connection], connection.holder.network)

    def authenticated(self, connection: PeerConnection) -> None:
        """Give a connection a place whose client is known only now; it is closed if there is none."""
        try:
            self._take_place(connection)
        except PoolFull as full:
            connection.displace(full.reason)

    def credential_of(self, head: HttpRequest) -> str | None:
        """Return the credential of a request, as :data:`~rwt_transports.endpoint.Identify` does."""
        return self.identify(PeerInfo(self.transport, head.address, 0, head.target, head.headers))

    def body_limit(self, routes: Routes, head: HttpRequest) -> tuple[int, int]:
        """Return the maximum size of a request's body, and the status beyond it: small if no route would use
        it, or only with credentials."""
        limits = self.limits
        if not routes.is_public(head.method, head.path) and self.credential_of(head) is None:
            return limits.unknown_bytes, 401
        if head.method in ("GET", "HEAD"):
            return limits.http_header_bytes, 413
        is_used = not isinstance(routes.find(head.method, head.path), HttpResponse)
        return limits.http_body_bytes if is_used else limits.http_header_bytes, 413

    def replace(self, former: PeerConnection, connection: PeerConnection, link: Link) -> None:
        """Attach `connection`, which has started, to the link of `former`."""
        self.connections.discard(former)
        self.connections.add(connection)
        for shares in (self.places, self.pending):
            share = shares.pop(former, None)
            if share is not None:
                share.end = partial(self._displace, shares, connection)
                shares[connection] = share
        link.set_callbacks(connection)

    def tick(self, now: float) -> None:
        # A copy: a timeout may end the connection, which leaves the set.
        for connection in tuple(self.connections):
            try:
                connection.tick(now)
            except Exception:
                # One failing connection must not block the others.
                log_exception("the time-outs of %s failed; cutting it", connection)
                connection.abort()

    def close(self, code: int, reason: str) -> None:
        self.closing = True
        for connection in tuple(self.connections):
            connection.close(code, reason)

    async def watch(self) -> None:
        """Check the timeouts of every connection about twice a second, until cancelled."""
        while True:
            self.tick(time.monotonic())
            await anyio.sleep(TICK_SECONDS)

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[None]:
        """Run handlers and check timeouts inside the block; then close every connection with 1001."""
        async with background_tasks() as tasks:
            self.tasks = TaskStarter()
            self.requests = Scheduler.of_loop(REQUESTS)
            tasks.start_soon(self.tasks.run, tasks)
            tasks.start_soon(self.watch)
            try:
                yield
            finally:
                await self.end(GOING_AWAY, "the server is going away")

    async def end(self, code: int, reason: str) -> None:
        """Close every connection, and cut those that are still open after ``limits.close_seconds``."""
        # Shielded, since this runs while the server is cancelled: peers are told why, within `close_seconds`.
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
        self.connections.discard(connection)
        self.addresses.leave(connection.address)
        self._release(connection, self.places, self._pool)
        self._release(connection, self.pending, self._pending_pool)
        if not self.connections and self._empty is not None:
            self._empty.set()
        if self.single:
            self.ended.set()


class _ConnectionState(StateEnum):
    OPENING = "OPEN", "CLOSING", "LOST"
    OPEN = "CLOSING", "LOST"
    CLOSING = "CLOSING", "LOST"
    LOST = ()


class Connection:
    """Mediator between a driver's link, a wire and an endpoint; see :mod:`rwt_transports.api`.

    Life cycle::

        OPENING ── accepted ──> OPEN ── close(), end of stream, ──> CLOSING ── link gone ──> LOST
           │                             end of the protocol           ^
           └────────────────────────── rejected ───────────────────────┘

    * **OPENING**: no endpoint yet; messages are dropped.
    * **OPEN**: messages go to the endpoint.
    * **CLOSING**: nothing more is queued for sending. The endpoint stays until the peer agrees, the wire
      fails, or the link is gone; after ``limits.close_seconds`` the link is cut.
    * **LOST**: nothing refers to the wire or the endpoint.

    A link can be lost in every state. `hand_over` exchanges the endpoint while there is one.

    Attributes by purpose:

    * Wiring: ``_state``, ``_listener``, ``_link``, ``_hang_up_aware`` (the link again, if it can tell),
      ``_wire``, ``_inflating`` (the wire again, if it inflates messages), ``_holdable`` (the wire again, if
      it can be held), ``_endpoint``, ``_holding`` (the endpoint again, if it holds the wire), ``outbox``, and
      what the driver calls on the wire and the outbox directly: ``get_buffer``, ``take``, ``put_back``.
    * Peer: ``address``, ``holder``, ``_port``, ``_largest_bytes`` (maximum size of its messages).
    * Closing: ``_closed_with`` (code and reason of :meth:`close`), ``_deadline`` (monotonic time to cut the
      link).
    * Signs of life: ``_is_alive`` (True if something arrived since the last :meth:`tick`), ``_heard``
      (monotonic time of the last such tick), ``_is_pinged`` (True if silence was answered with a ping).
    * Flow control: ``_is_paused`` (by the endpoint), ``_is_late`` (True while the wire waits for another
      turn), ``_is_probed`` (True if a peer that sends no more was pinged, to learn whether it still reads).
    """

    __slots__ = (
        "_closed_with", "_deadline", "_endpoint", "_hang_up_aware", "_heard", "_holdable", "_holding",
        "_inflating", "_is_alive", "_is_late", "_is_paused", "_is_pinged", "_is_probed", "_largest_bytes",
        "_link", "_listener", "_port", "_state", "_wire", "address", "get_buffer", "holder", "outbox",
        "put_back", "take",
    )  # fmt: skip

    def __init__(
        self, state: ListenerState, link: Link, address: str, port: int, terms: DeflateTerms | None = None
    ) -> None:
        limits = state.limits
        self._state = _ConnectionState.OPENING
        self._listener = state
        self._link = link
        self._hang_up_aware = link if isinstance(link, HangUpAware) else None
        self._inflating = None if terms is None else _deflated(terms, self, limits, state.buffers)
        self._wire: Wire = self._inflating or state.make_wire(self, limits, state.buffers)
        self._holdable = self._wire if isinstance(self._wire, HoldableWire) else None
        self._endpoint: Endpoint | None = None
        self._holding: HoldingWire | None = None
        self.outbox = _ConnectionSink(self, self._wire.framing, limits, link.wake)
        # The driver calls the wire and the outbox directly here, since it does so for every message.
        self.get_buffer: Callable[[], memoryview | None] = self._wire.get_buffer
        self.take = self.outbox.take
        self.put_back = self.outbox.put_back
        self.address = address
        self.holder = holder_of(address)
        self._port = port
        self._largest_bytes = limits.message_bytes
        self._closed_with: tuple[int, str] | None = None
        self._deadline: float | None = None
        self._is_alive = True
        self._heard: float | None = None
        self._is_pinged = False
        self._is_paused = self._is_late = False
        self._is_probed = False

    @property
    def _is_ending(self) -> bool:
        return self._state in (_ConnectionState.CLOSING, _ConnectionState.LOST)

    def begin(self) -> None:
        """Open a connection without a handshake."""
        state = self._listener
        peer = PeerInfo(state.transport, self.address, self._port, max_message_size=state.max_message_size)
        try:
            state.claim(self, peer)
            state.addresses.check(self.address)
            self.open(peer)
        except PoolFull as full:
            logger.warning("no room for %s: %s", self, full.reason)
            self._link.abort()
        except Refused as refused:
            self.close(POLICY, refused.reason)
        except Exception:
            log_exception("the accept function failed for %s", self)
            self.close(INTERNAL_ERROR, "internal error")

    # -- the driver's side ---------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        self._is_alive = True
        self.outbox.received += len(data)
        try:
            self._wire.feed(data)
        except Exception:
            self._broken_inside()

    def buffer_updated(self, count: int) -> None:
        self._is_alive = True
        self.outbox.received += count
        try:
            self._wire.buffer_updated(count)
        except Exception:
            self._broken_inside()

    def progress(self) -> None:
        self._is_alive = True

    def eof(self) -> None:
        """Begin to close: the peer has closed its sending side."""
        self._end_endpoint(ABNORMAL, "the peer went away without a word")
        self._state = self._state.become(_ConnectionState.CLOSING)
        # A peer that only closed its sending side still gets the pending answers.
        self.outbox.when_empty(self._link.close)

    def lost(self) -> None:
        self._listener.detach(self)
        self._listener.buffers.release(self._wire)
        self._listener.buffers.is_read(self._wire)
        self._state = self._state.become(_ConnectionState.LOST)
        # Before the endpoint is told, so that what it sends in `closed` is dropped.
        self.outbox.discard()
        self._end_endpoint(ABNORMAL, "the connection was lost")
        # Break the cycles: they would live until a full garbage collection.
        self._wire, self._inflating, self._holdable = _NO_WIRE, None, None
        self.get_buffer = _NO_WIRE.get_buffer

    # -- the endpoint's side -------------------------------------------------------------------------------

    def close(self, code: int = 1000, reason: str = "") -> None:
        if self._is_ending:
            return
        self._state = self._state.become(_ConnectionState.CLOSING)
        self._closed_with = (code, reason)
        last = self._wire.close(code, reason)
        self.outbox.finish(last)
        # Without a closing handshake the link closes once everything is sent; otherwise when the peer
        # agrees.
        if not last:
            self.outbox.when_empty(self._link.close)

    def displace(self, reason: str) -> None:
        self.close(TRY_AGAIN_LATER, reason)

    def abort(self) -> None:
        self._link.abort()

    def count_for(self, holder: Holder) -> None:
        """See :meth:`rwt_transports.endpoint.Sink.count_for`."""
        self.holder = holder
        if self in self._listener.connections:
            self._listener.authenticated(self)

    # -- the endpoint's flow control -----------------------------------------------------------------------

    def pause(self) -> None:
        self._is_paused = True
        self._listener.buffers.keep_unread(self._wire)
        self._link.pause()
        holding = self._holding
        if self._holdable is not None and (
            self._inflating is not None or (holding is not None and holding.holds_wire)
        ):
            self._holdable.hold()

    def resume(self) -> None:
        self._is_paused = False
        self._listener.buffers.is_read(self._wire)
        if not self._is_late:
            self._read_on()

    def _read_on(self) -> None:
        self._link.resume()
        if self._holdable is not None and self._endpoint is not None:
            try:
                self._holdable.go_on()
            except Exception:
                self._broken_inside()

    def when_empty(self, callback: Callable[[], None]) -> None:
        if not self._is_ending:
            self.outbox.when_empty(callback)

    def overflow(self, reason: str) -> None:
        """Close because the peer leaves too many replies unread."""
        logger.warning("closing %s: %s", self, reason)
        # The peer reads too slowly for its replies: only the close frame follows those that are ready.
        self.outbox.stop_sending()
        self.close(POLICY, reason)

    def _broken_inside(self) -> None:
        log_exception("an endpoint or a wire failed; closing %s", self)
        self.close(INTERNAL_ERROR, "internal error")

    # -- what the wire reports (WireEvents) ----------------------------------------------------------------

    def oversized(self, size: int) -> bool:
        return isinstance(self._endpoint, OversizeAware)

    def oversized_head(self, size: int, head: bytes) -> None:
        endpoint: object = self._endpoint
        if isinstance(endpoint, OversizeAware):
            endpoint.oversized(size, self._largest_bytes, head)

    def answer(self, data: bytes) -> None:
        self.outbox.push(data)

    def pong(self, data: bytes) -> None:
        self.outbox.push_if_read(data)

    def read_on_later(self) -> None:
        if not self._is_late:
            self._is_late = True
            self._link.pause()
            self._listener.requests.wait(self._end_lateness)

    def _end_lateness(self) -> None:
        self._is_late = False
        if not self._is_paused and self._state is not _ConnectionState.LOST:
            self._read_on()

    def ended(self, code: int, reason: str, *, agreed: bool) -> None:
        """Close; half-close if the peer broke the protocol, so that it can still read why."""
        self._state = self._state.become(_ConnectionState.CLOSING)
        if not agreed:
            logger.info("closing %s: %s", self, reason)
        self._end_endpoint(*(self._closed_with or (code, reason)))
        self.outbox.when_empty(self._link.close if agreed else self._link.finish)

    # -- life cycle ----------------------------------------------------------------------------------------

    def open(self, peer: PeerInfo, accept: Accept | None = None) -> None:
        """Get an endpoint from the accept function, by default the listener's, and raise what it raises."""
        endpoint = (accept or self._listener.accept)(self.outbox, peer)
        if self._state is _ConnectionState.OPENING:  # The accept function may have closed the connection.
            self._state = self._state.become(_ConnectionState.OPEN)
        self._set_endpoint(endpoint)

    def _set_endpoint(self, endpoint: Endpoint) -> None:
        self._endpoint = endpoint
        self._holding = endpoint if isinstance(endpoint, HoldingWire) else None
        if isinstance(endpoint, FlowControlled):
            endpoint.set_flow_control(self)
        if self._inflating is not None:
            self._inflating.take_steps = endpoint.take_steps if isinstance(endpoint, StepTaking) else None
        largest = self._listener.limits.message_bytes
        if isinstance(endpoint, SizeLimiting):
            largest = min(largest, endpoint.largest_bytes)
        if largest != self._largest_bytes and isinstance(self._wire, SizeLimitedWire):
            self._largest_bytes = largest
            self._wire.limit(largest)
        if not self._is_ending:
            self._wire.message = endpoint.receive

    @property
    def ended_with(self) -> tuple[int, str]:
        """Return code and reason of a lost connection."""
        return self._closed_with or (ABNORMAL, "the connection was lost")

    def hand_over(self, endpoint: Endpoint) -> None:
        if self._endpoint is None:
            endpoint.closed(*self.ended_with)
        else:
            self._set_endpoint(endpoint)

    def _end_endpoint(self, code: int, reason: str) -> None:
        endpoint, self._endpoint, self._holding = self._endpoint, None, None
        if endpoint is not None:
            self.outbox.stop_sending()
            self._wire.message = drop_message
            if self._inflating is not None:
                self._inflating.take_steps = None
            endpoint.closed(*(self._closed_with or (code, reason)))

    def tick(self, now: float) -> None:
        if self._is_alive or self._heard is None:
            self._is_alive = self._is_pinged = False
            # A tick's precision is enough: receiving only sets a flag, since it runs for every read.
            self._heard = now
        silent = now - self._heard
        limits = self._listener.limits
        if self._is_paused and self._hang_up_aware is not None:
            self._look_for_hang_up(self._hang_up_aware)
        if self._is_ending:
            # Set by the first tick after the end, so that close() needs no clock.
            if self._deadline is None:
                self._deadline = now + limits.close_seconds
            elif now >= self._deadline:
                self._link.abort()
        elif self._listener.idle_seconds and silent >= self._listener.idle_seconds:
            self._forget(f"silent for {silent:.0f} s")
        elif limits.ping_seconds and silent >= limits.ping_seconds:
            self._ping(silent)

    def _look_for_hang_up(self, link: HangUpAware) -> None:
        """Drop the peer if it has disconnected: while reading is paused, no other event reports this."""
        hang_up = link.hang_up()
        if hang_up is HangUp.GONE:
            self._forget("the peer went away while it was held back")
        elif hang_up is HangUp.SENDS_NO_MORE and not self._is_probed:
            # The peer may have closed only its sending side. If its process was killed, its system answers
            # the ping with a reset.
            self._is_probed = True
            self._send_ping()

    def _ping(self, silent: float) -> None:
        limits = self._listener.limits
        if not self._is_pinged:
            # In a protocol without pings, silence means nothing (TCP-04): the system's keep-alive finds peers
            # that are gone.
            self._is_pinged = self._send_ping()
        elif silent >= limits.ping_seconds + limits.pong_seconds:
            logger.info("%s answers no ping, counted as gone", self)
            self._forget(f"no sign of life for {silent:.0f} s")

    def _send_ping(self) -> bool:
        """Send a ping. Returns False if the protocol has none."""
        ping = self._wire.ping()
        if ping:
            self.outbox.push(ping)
        return bool(ping)

    def _forget(self, why: str) -> None:
        self._end_endpoint(ABNORMAL, why)
        self._link.abort()

    def __repr__(self) -> str:
        return f"<{self._listener.transport} connection {self.address}:{self._port}>"


class _NoWire(UnbufferedCallbacks):
    """Wire of a lost connection: drops everything. Implements :class:`rwt_transports.api.Wire`."""

    framing = SERVER_FRAMING

    def __init__(self) -> None:
        self.message: Callable[[bytes, bool], None] = drop_message

    def feed(self, data: bytes) -> None:
        """Drop `data`."""

    def give_up(self, reason: str) -> None:
        """No-op."""

    def close(self, code: int, reason: str) -> bytes:
        return b""

    def ping(self) -> bytes:
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
        if self._connection is not None:
            self._connection.close(code, reason)

    def count_for(self, holder: Holder) -> None:
        if self._connection is not None:
            self._connection.count_for(holder)

    def hand_over(self, endpoint: Endpoint) -> None:
        if self._connection is not None:
            self._connection.hand_over(endpoint)
        else:
            endpoint.closed(*self._ended_with)

    def discard(self) -> None:
        super().discard()
        if self._connection is not None:
            self._ended_with = self._connection.ended_with
            self._connection = None
