"""HTTP of one connection up to its upgrade to a WebSocket, without I/O (on h11)."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from email.utils import formatdate
from http import HTTPStatus
from typing import Final

import anyio
import h11

from rwt_protocol.frames import Buffer
from rwt_protocol.states import StateEnum
from rwt_transports.api import DeliveryAware, Link, UnbufferedCallbacks
from rwt_transports.connection import Connection, ListenerState
from rwt_transports.endpoint import Accept, PeerInfo
from rwt_transports.errors import Refused, log_exception
from rwt_transports.http.addresses import holder_of
from rwt_transports.http.routes import Handler, HttpRequest, HttpResponse, Routes, joined_headers
from rwt_transports.outbox import Outbox
from rwt_transports.shared_pool import PoolFull
from rwt_transports.websocket.handshake import HandshakeAnswer, answer_handshake, wants_websocket
from rwt_transports.websocket.wire import SERVER_FRAMING
from rwt_transports.wires.receive_buffer import STAGING_BYTES

logger = logging.getLogger("rwt_transports.http")
access = logging.getLogger("rwt_transports.access")

EARLY_BYTES: Final = 8192
"""Maximum size of a request that is answered early, in bytes."""

LIVE_QUEUE_SECONDS: Final = 0.1
"""Delay by a queue on the path above which the next chunk of a live body waits."""
LIVE_PART: Final = 0.25
"""Share of a chunk that may still be in flight when the next one is made."""
LIVE_POLL_SECONDS: Final = 0.01


class _HttpState(StateEnum):
    READING = "READING", "WAITING", "ANSWERING", "ENDED"
    WAITING = "READING", "ENDED"
    ANSWERING = "READING", "STREAMING", "ENDED"
    STREAMING = "ANSWERING", "ENDED"
    ENDED = ()


class HttpConnection(UnbufferedCallbacks):
    """HTTP of one connection, request after request (RFC 9112), until it closes or becomes a WebSocket.

    A :class:`~rwt_transports.connection.Connection` then takes over its link.

    States::

        WAITING <── turn is full ──── READING ──── request is complete ──> ANSWERING <───> STREAMING
            └──────── a turn ──────────> ^ <──────── answer is sent ───────────┘

    * **READING**: requests are read as their bytes arrive.
    * **WAITING**: received bytes wait for a turn, unless they are an early request (`Routes.early`).
    * **ANSWERING**: a handler runs, or the network has not yet accepted the answer. Requests behind it wait.
    * **STREAMING**: the answer's body comes piece by piece, and may have no end.
    * **ENDED**: nothing more is read or sent; reached from every state, and final. The link closes once the
      network has accepted what is queued, or already belongs to a WebSocket.

    Attributes by purpose:

    * Wiring: ``_state``, ``_routes``, ``_listener``, ``_limits``, ``_link``, ``outbox``, ``take``
      and ``put_back`` (of the outbox, for the driver).
    * Peer: ``address`` (the client's, which a proxy may name), ``holder``, ``_peer`` (address of the link),
      ``_port``, ``_identity`` (of the connection, for its requests), ``_refused`` (answer to every request of
      this address, or None).
    * Request: ``_h11``, ``_request``, ``_head`` (the request without its body), ``_body``,
      ``_body_limit`` (its maximum size, and the status beyond it; None before its first piece), ``_ahead``
      (bytes that arrived while others wait or are answered).
    * Answer: ``_scope`` (cancels the handler), ``_served`` (True after the first answer), ``_half_closed``
      (True if the peer sends nothing more).
    * Timeouts, monotonic: ``_deadline`` (for the next request, or to close), ``_stalled`` (for the network to
      accept some bytes), ``_taken`` (bytes that it had accepted at the last :meth:`tick`).
    """

    def __init__(self, routes: Routes, state: ListenerState, link: Link, address: str, port: int) -> None:
        self._state = _HttpState.READING
        self._routes = routes
        self._listener = state
        self._limits = limits = state.limits
        self._link = link
        self.outbox = Outbox(SERVER_FRAMING, limits, link.wake, self._overflow)
        self.take = self.outbox.take
        self.put_back = self.outbox.put_back
        self._peer = self.address = address
        self.holder = holder_of(address)
        self._port = port
        self._identity = object()
        self._refused: Refused | None = None
        self._h11 = h11.Connection(h11.SERVER, max_incomplete_event_size=limits.http_header_bytes)
        self._request: h11.Request | None = None
        self._head = HttpRequest("", "")
        self._body = bytearray()
        self._body_limit: tuple[int, int] | None = None
        self._ahead = 0
        self._scope: anyio.CancelScope | None = None
        self._served = False
        self._half_closed = False
        self._deadline: float | None = None
        self._stalled: float | None = None
        self._taken = 0

    def _become(self, state: _HttpState) -> None:
        if not self._is_over:
            self._state = self._state.become(state)

    @property
    def _is_over(self) -> bool:
        return self._state is _HttpState.ENDED

    @property
    def _is_waiting(self) -> bool:
        return self._state is _HttpState.WAITING

    @property
    def _is_answering(self) -> bool:
        return self._state in (_HttpState.ANSWERING, _HttpState.STREAMING)

    # -- the driver's side ---------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        if self._is_over:
            return
        self.outbox.received += len(data)
        if self._state is not _HttpState.READING:
            self._ahead += len(data)
            if self._ahead > self._limits.http_header_bytes + self._limits.http_body_bytes:
                self._overflow("too many requests before the answer to the first (http_body_bytes)")
                return
        with self._cutting("a route or the handshake"):
            self._h11.receive_data(data)
            if self._state is _HttpState.READING:
                self._go_on()
            elif self._is_waiting:
                self._answer_early()

    def eof(self) -> None:
        """Handle the end of the peer's stream.

        A pending answer is still sent. A stream is ended: a browser that leaves it only half-closes the
        connection.
        """
        self._half_closed = True
        if self._state in (_HttpState.READING, _HttpState.STREAMING):
            self._end()

    def lost(self) -> None:
        self._become(_HttpState.ENDED)
        self._listener.detach(self)
        self._listener.buffers.release(self)
        self.outbox.discard()
        if self._scope is not None:
            self._scope.cancel()

    # -- the listener's side -------------------------------------------------------------------------------

    def begin(self) -> None:
        """Wait for a request; if the address has too many connections, each request is refused."""
        self._check_address()

    def _check_address(self) -> None:
        self._refused = None
        try:
            self._listener.addresses.check(self.address, notes=False)
        except Refused as refused:
            self._refused = refused

    def _count_as(self, address: str, credential: str = "") -> None:
        """Count for another client: behind a proxy, each request may come from another."""
        holder = holder_of(address, credential)
        if holder != self.holder or address != self.address:
            former, self.address, self.holder = self.address, address, holder
            self._listener.count_again(self, former)
            self._check_address()

    def close(self, code: int, reason: str) -> None:
        """Close after the pending answer; end a stream."""
        if self._state is not _HttpState.ANSWERING:
            self._end()

    def abort(self) -> None:
        self._become(_HttpState.ENDED)
        self._link.abort()

    def tick(self, now: float) -> None:
        """Check the timeouts; `now` is monotonic, in seconds. Bytes that trickle in do not extend them."""
        limits = self._limits
        if self.outbox.is_waited_for:
            # Progress counts, not duration: a slow peer may take a long response for as long as it reads.
            if self._taken != self.outbox.taken or self._stalled is None:
                self._taken = self.outbox.taken
                self._stalled = now + limits.stalled_http_seconds
            elif now >= self._stalled:
                self.abort()
            self._deadline = None
            return
        self._stalled = None
        # The time of a handler is its own: only the network and the peer have timeouts.
        if self._is_answering:
            return
        if self._deadline is None:
            usual = limits.idle_http_seconds if self._served else limits.handshake_seconds
            self._deadline = now + (limits.close_seconds if self._is_over else usual)
        elif now >= self._deadline:
            if self._is_over:
                self._link.abort()
            else:
                if self._h11.trailing_data[0] or self._request is not None:
                    self._fail(408)
                self._end()

    @contextmanager
    def _cutting(self, what: str) -> Iterator[None]:
        """Cut the connection if `what` fails."""
        try:
            yield
        except Exception:
            log_exception("%s failed; cutting %s", what, self)
            self.abort()

    def _overflow(self, reason: str) -> None:
        logger.warning("closing %s: %s", self, reason)
        self.abort()

    # -- reading -------------------------------------------------------------------------------------------

    def _go_on(self) -> None:
        scheduler = self._listener.requests
        if scheduler.must_wait:
            self._become(_HttpState.WAITING)
            scheduler.wait(self._take_waiting)
            self._answer_early()
        else:
            scheduler.do(self._take_requests)

    def _answer_early(self) -> None:
        """Answer a request that waits for its turn, if it is complete and admitted as an early one."""
        early = self._routes.early
        if early is None or self._ahead > EARLY_BYTES:
            return
        data = self._h11.trailing_data[0]
        target = b"" if self._request is None else self._request.target
        if len(data) > EARLY_BYTES or not early.may_begin(self._identity, target + data):
            return
        request = self._small_request(data)
        if request is None or not early.begin(request):
            return
        self._become(_HttpState.READING)
        try:
            self._listener.requests.do(self._take_requests)
        finally:
            early.end(self._identity)

    def _small_request(self, data: bytes) -> HttpRequest | None:
        """Return a request with a body that waits to be read, without an effect on h11.

        None if it is incomplete, or has a form in which few clients send a small request.
        """
        raw = self._request
        if raw is None:
            head, _, body = data.partition(b"\r\n\r\n")
            first, *lines = head.decode("latin-1").split("\r\n")
            method, target = (*first.split(" "), "", "")[:2]
            pairs = [
                (name.lower(), value.strip()) for name, _, value in (line.partition(":") for line in lines)
            ]
        else:
            body = bytes(self._body) + data
            method, target = raw.method.decode("latin-1"), raw.target.decode("latin-1")
            pairs = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in raw.headers]
        headers = joined_headers(pairs)
        if headers.get("content-length") != str(len(body)):
            return None
        path, _, query = target.partition("?")
        return HttpRequest(method, path, query, headers, body, self.address, connection=self._identity)

    def _take_waiting(self) -> None:
        if not self._is_waiting:
            return  # Ended, or answered early.
        self._become(_HttpState.READING)
        with self._cutting("a route"):
            self._take_requests()
            if self._half_closed and self._state is _HttpState.READING:
                self._end()  # The end of stream arrived before, see eof().

    def _take_requests(self) -> None:
        try:
            self._next_events()
        except h11.RemoteProtocolError as error:
            self._fail(error.error_status_hint)
        self._ahead = len(self._h11.trailing_data[0]) if self._is_answering else 0

    def _next_events(self) -> None:
        scheduler = self._listener.requests
        until = scheduler.monotonic() + scheduler.budget.share
        while self._state is _HttpState.READING:
            event = self._h11.next_event()
            if event is h11.NEED_DATA:
                if self._h11.they_are_waiting_for_100_continue:
                    self._send(h11.InformationalResponse(status_code=100, headers=[]))
                return
            if isinstance(event, h11.Request):
                self._begin_request(event)
            elif isinstance(event, h11.Data):
                self._body += event.data
                # Once for all pieces of the body.
                if self._body_limit is None:
                    self._body_limit = self._listener.body_limit(self._routes, self._head)
                if len(self._body) > self._body_limit[0]:
                    self._fail(self._body_limit[1])
                elif len(self._body) >= STAGING_BYTES:
                    self._listener.buffers.hold(self, len(self._body), self.holder)
                # A body may come in chunks of one byte, of which each is an event: 140 ms for 64 KiB at once.
                if scheduler.monotonic() >= until and self._state is _HttpState.READING:
                    self._become(_HttpState.WAITING)
                    scheduler.wait(self._take_waiting)
            elif isinstance(event, h11.EndOfMessage) and self._request is not None:
                if len(self._body) >= STAGING_BYTES:
                    self._listener.buffers.release(self)
                self._requested(self._request)
            else:
                self._end()

    def _begin_request(self, raw: h11.Request) -> None:
        self._request = raw
        self._body = bytearray()
        self._body_limit = None
        if _size(raw) > self._limits.http_header_bytes:
            self._fail(431)
            return
        if _has_doubtful_length(raw):
            self._fail(400)
            return
        headers = joined_headers(_pairs(raw))
        path, _, query = raw.target.decode("latin-1").partition("?")
        method = raw.method.decode("latin-1")
        address, prefix = self._listener.proxies.resolve(self._peer, headers)
        self._head = HttpRequest(method, path, query, headers, b"", address, prefix, self._identity)
        self._count_as(address, self._listener.credential_of(self._head) or "")

    def _requested(self, raw: h11.Request) -> None:
        headers = self._head.headers
        request = replace(self._head, body=bytes(self._body)) if self._body else self._head
        try:
            self._listener.addresses.check_host(self._listener.hosts, headers.get("host", ""), self.address)
        except Refused as refused:
            self._respond(HttpResponse.refusing(refused))
            return
        if self._refused is not None:
            self._listener.addresses.note_refusal("connections", self.address, self._refused.reason)
            self._respond(HttpResponse.refusing(self._refused))
            return
        if wants_websocket(pairs := _pairs(raw)):
            if raw.http_version < b"1.1":  # RFC 6455 section 4.2.1; often a proxy's default
                self._respond_text(426, "a WebSocket needs HTTP/1.1, this request is HTTP/1.0\n")
            else:
                self._upgrade(request, raw.target.decode("latin-1"), pairs)
            return
        found = self._routes.find(request.method, request.path)
        self._respond(found if isinstance(found, HttpResponse) else self._call(found, request))

    def _upgrade(self, request: HttpRequest, target: str, pairs: list[tuple[str, str]]) -> None:
        answer = HandshakeAnswer(405, reason="a WebSocket is opened with GET")
        if request.method == "GET":
            answer = answer_handshake(target, pairs, self._limits.deflate, self._listener.subprotocols)
        if answer.status != 101:
            self._respond_text(answer.status, f"{answer.reason}\n", {"Sec-WebSocket-Version": "13"})
            return
        peer = PeerInfo(
            self._listener.transport,
            self.address,
            self._port,
            request.target,
            request.headers,
            subprotocol=answer.subprotocol,
        )
        if self._listener.admit is not None:
            self._respond(self._admitted(self._listener.admit(peer), peer, answer))
            return
        refusal = self._open(peer, answer)
        if refusal is not None:
            self._respond(refusal)

    async def _admitted(
        self, admission: Awaitable[Accept], peer: PeerInfo, answer: HandshakeAnswer
    ) -> HttpResponse | None:
        """Become a WebSocket once it is admitted. Returns a response if it is refused."""
        try:
            accept = await admission
        except Refused as refused:
            return HttpResponse.refusing(refused)
        return self._open(peer, answer, accept)

    def _open(
        self, peer: PeerInfo, answer: HandshakeAnswer, accept: Accept | None = None
    ) -> HttpResponse | None:
        """Become a WebSocket. Returns a response if the listener or the accept function refuses."""
        state = self._listener
        if state.closing:
            return HttpResponse(b"this server is closing\n", 503)
        try:
            state.claim(self, peer)
        except PoolFull as full:
            return HttpResponse.refusing(full)
        connection = Connection(state, self._link, self.address, self._port, answer.deflate)
        connection.holder = self.holder
        # These bytes precede frames that the endpoint sends from its constructor.
        unsent: list[Buffer] = []
        more = True
        while more:
            pieces, more = self.take()
            unsent += pieces
        for data in (*unsent, answer.head):
            connection.outbox.push(data)
        try:
            connection.open(peer, accept)
        except Refused as refused:
            refusal = HttpResponse.refusing(refused)
        except Exception:
            log_exception("the accept function failed for %s", self)
            refusal = _INTERNAL_ERROR
        else:
            self._become(_HttpState.ENDED)
            self._log_access(101, None)
            state.replace(self, connection, self._link)
            rest = self._h11.trailing_data[0]
            # Bytes behind the request are received once more below.
            connection.outbox.received = self.outbox.received - len(rest)
            self.outbox.discard()  # Break the cycle: it refers to this connection.
            if rest:
                connection.receive(rest)
            if self._half_closed:
                connection.eof()  # It arrived while the admission was awaited.
            return None
        # Taken for the WebSocket that was refused: earlier answers still come before the refusal.
        for data in unsent:
            self.outbox.push(data)
        return refusal

    # -- answering -----------------------------------------------------------------------------------------

    def _call(self, handler: Handler, request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        try:
            return handler(request)
        except Exception:
            logger.exception("the handler of %s %s failed", request.method, request.path)
            return _INTERNAL_ERROR

    def _respond(self, response: HttpResponse | Awaitable[HttpResponse | None]) -> None:
        if isinstance(response, HttpResponse) and isinstance(response.body, bytes):
            self._send_whole(response, response.body)
            if self.outbox.room > 0 and not self._h11.trailing_data[0]:
                self._responded()
            else:
                # Following requests wait: a client gets no more answers than it reads, and requests that
                # arrived together do not share one turn.
                self._become(_HttpState.ANSWERING)
                self.outbox.when_empty(self._taken_whole)
        else:
            # Handlers that await need a task; all others are answered within the call that received them.
            tasks = self._listener.tasks
            if tasks is None:
                raise RuntimeError("the listener is not open")
            self._become(_HttpState.ANSWERING)
            tasks.start_soon(self._respond_in_scope, response)

    def _taken_whole(self) -> None:
        self._become(_HttpState.READING)
        with self._cutting("an HTTP answer"):
            self._responded()
            self._become(_HttpState.WAITING)
            self._listener.requests.wait(self._take_waiting)

    async def _respond_in_scope(self, response: HttpResponse | Awaitable[HttpResponse | None]) -> None:
        with anyio.CancelScope() as self._scope:
            # Ended between start_soon() and the start of the task: nothing else would cancel it.
            if self._is_over:
                self._scope.cancel()
            with self._cutting("an HTTP answer"):
                await self._respond_later(response)
        self._scope = None

    async def _respond_later(self, awaited: HttpResponse | Awaitable[HttpResponse | None]) -> None:
        response: HttpResponse | None = awaited if isinstance(awaited, HttpResponse) else None
        if not isinstance(awaited, HttpResponse):
            try:
                response = await awaited
            except Exception:
                logger.exception("a route's handler failed")
                response = _INTERNAL_ERROR
        if response is None:
            return  # The connection is a WebSocket now.
        if isinstance(response.body, bytes):
            self._send_whole(response, response.body)
            if self.outbox.room <= 0:
                await self._drained()
        else:
            await self._stream(response, response.body)
        self._become(_HttpState.READING)
        self._responded()
        self._go_on()

    async def _stream(self, response: HttpResponse, chunks: AsyncIterator[bytes]) -> None:
        self._send_head(response, None)
        self._become(_HttpState.STREAMING)
        try:
            if self._half_closed:
                self._end()  # The end of stream arrived before the stream began, see eof().
            elif not self._is_head():
                async for chunk in chunks:
                    self._send(h11.Data(data=chunk))
                    await self._drained()
                    if response.is_live:
                        await self._delivered(len(chunk))
        except ConnectionError as error:
            # The source failed, for example the robot behind a hub: not a fault of this program.
            logger.info("the answer to %s broke off: %s", self, error)
            self._end()
        except Exception:
            logger.exception("a streamed body failed")
            self._end()
        else:
            self._send(h11.EndOfMessage())
        finally:
            self._become(_HttpState.ANSWERING)
            await close_iterator(chunks)

    async def _drained(self) -> None:
        empty = anyio.Event()
        if not self._is_over:
            self.outbox.when_empty(empty.set)
        await empty.wait()

    async def _delivered(self, size: int) -> None:
        """Wait until most of a chunk of `size` bytes has arrived, or until it flows without a queue."""
        while isinstance(self._link, DeliveryAware) and not self._is_over:
            delivery = self._link.delivery()
            flows = not delivery.unsent and delivery.queue_seconds < LIVE_QUEUE_SECONDS
            if flows or delivery.unacknowledged <= size * LIVE_PART:
                return
            await anyio.sleep(LIVE_POLL_SECONDS)

    def _is_head(self) -> bool:
        return self._request is not None and self._request.method == b"HEAD"

    def _send_whole(self, response: HttpResponse, body: bytes) -> None:
        # A response that never has a body must not announce a size (RFC 9110 section 8.6).
        self._send_head(response, None if response.status in (204, 304) else len(body))
        if body and not self._is_head():
            self._send(h11.Data(data=body))
        self._send(h11.EndOfMessage())

    def _log_access(self, status: int, size: int | None) -> None:
        if self._listener.access_log and self._request is not None:
            method, target = self._request.method.decode("ascii"), self._request.target.decode("latin-1")
            # Without the query, which may contain a token.
            access.info(
                "%s %s %s %d %s",
                self.address,
                method,
                ascii(target.partition("?")[0])[1:-1],
                status,
                "-" if size is None else size,
            )

    def _send_head(self, response: HttpResponse, size: int | None) -> None:
        self._log_access(response.status, size)
        headers = [("Date", formatdate(usegmt=True))]
        if response.status != 204:
            headers.append(("Content-Type", response.content_type))
        if size is not None:
            headers.append(("Content-Length", str(size)))
        headers.extend({**SAFE_HEADERS, **response.headers}.items())
        headers.extend(("Set-Cookie", cookie) for cookie in response.cookies)
        phrase = HTTPStatus(response.status).phrase
        self._send(h11.Response(status_code=response.status, headers=headers, reason=phrase))

    def _send(self, event: h11.Event) -> None:
        if self._is_over:
            return
        data = self._h11.send(event)
        if data:
            self.outbox.push(data)

    def _responded(self) -> None:
        self._request = None
        self._served = True
        self._deadline = None
        if self._is_over:
            return
        done = self._h11.our_state is h11.DONE and self._h11.their_state is h11.DONE
        if done and not (self._half_closed and not self._h11.trailing_data[0]):
            self._h11.start_next_cycle()
            self._count_as(self._peer)
        else:
            self._end()

    def _respond_text(self, status: int, text: str, headers: Mapping[str, str] | None = None) -> None:
        self._respond(HttpResponse(text.encode(), status, headers=headers or {}))

    def give_up(self, reason: str) -> None:
        """Refuse the request whose body is incomplete: all bodies together are too large."""
        logger.info("closing %s: %s", self, reason)
        self._fail(503, f"{reason}\n".encode())

    def displace(self, reason: str) -> None:
        """Close in favour of another client: refuse the request in progress, or cut its answer."""
        if self._scope is not None:
            self._scope.cancel()
        if self._request is not None or not self._served:
            self._fail(503, f"{reason}\n".encode())
        else:
            self._end()

    def _fail(self, status: int, text: bytes = b"") -> None:
        """Answer an invalid request, if an answer is still possible, and close."""
        if self._h11.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            text = text or BROKEN.get(status, BROKEN[400])
            self._send_whole(HttpResponse(text, status, headers={"Connection": "close"}), text)
        self._end()

    def _end(self) -> None:
        if not self._is_over:
            self._become(_HttpState.ENDED)
            self._deadline = None
            self.outbox.when_empty(self._link.close)

    def __repr__(self) -> str:
        return f"<{self._listener.transport} connection {self.address}:{self._port}>"


SAFE_HEADERS = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}
"""Headers of every response: browsers must not guess its type, nor pass on its URL, which may contain a
token."""


_INTERNAL_ERROR = HttpResponse(b"internal error\n", 500)
BROKEN = {
    400: b"this is not a valid HTTP request\n",
    401: b"without credentials (auth.tokens), the request body is too large (auth.message_bytes)\n",
    408: b"the request did not arrive in time (limits.handshake_seconds)\n",
    413: b"the request body is too large (http_body_bytes)\n",
    431: b"the request's headers are too large (http_header_bytes)\n",
}


def _pairs(request: h11.Request) -> list[tuple[str, str]]:
    return [(name.decode("latin-1"), value.decode("latin-1")) for name, value in request.headers]


def _size(request: h11.Request) -> int:
    """Return the size of the request line and the headers; h11 limits only those that arrive in pieces."""
    return len(request.target) + sum(len(name) + len(value) + 4 for name, value in request.headers)


def _has_doubtful_length(request: h11.Request) -> bool:
    """Return True if a proxy may see the end of a request elsewhere (RFC 9112 section 6.1).

    Such a request may hide another one; h11 itself lets Transfer-Encoding win.
    """
    names = {name for name, _ in request.headers}
    if b"transfer-encoding" not in names:
        return False
    return b"content-length" in names or request.http_version < b"1.1"


async def close_iterator(chunks: AsyncIterator[bytes]) -> None:
    """Close an iterator that has `aclose`, so that it cleans up now and not when it is collected."""
    close: Callable[[], Awaitable[object]] | None = getattr(chunks, "aclose", None)
    if close is not None:
        with anyio.CancelScope(shield=True):
            await close()
