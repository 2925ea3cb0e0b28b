"""Plain HTTP on a transport's port: routes, and the conversation up to an upgrade, without I/O (on h11)."""

from __future__ import annotations

import logging
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable, Coroutine, Iterable, Mapping
from dataclasses import dataclass, field
from email.utils import formatdate
from enum import Enum, auto
from http import HTTPStatus
from typing import Literal, NamedTuple, Protocol

import h11

from rwt_transports.limits import Limits
from rwt_transports.websocket.handshake import HandshakeAnswer, answer_handshake, wants_websocket

logger = logging.getLogger("rwt_transports.http")

TEXT = "text/plain; charset=utf-8"


@dataclass(frozen=True, slots=True)
class HttpRequest:
    """One plain HTTP request.

    Attributes:
        method: upper case.
        path: without the query, percent-encoding as it came.
        query: what follows the question mark, undecoded.
        headers: names in lower case; repeated ones joined with a comma.
        body: the whole body.
        address: the peer's address.
    """

    method: str
    path: str
    query: str = ""
    headers: Mapping[str, str] = field(default_factory=dict)
    body: bytes = b""
    address: str = ""


@dataclass(frozen=True, slots=True)
class HttpResponse:
    """What a route answers.

    Attributes:
        body: all of it, or an iterator of chunks that are sent as they come; the iterator is closed when
            the peer goes away.
        status: HTTP status.
        content_type: the ``Content-Type`` header.
        headers: further headers.
    """

    body: bytes | AsyncIterator[bytes] = b""
    status: int = 200
    content_type: str = TEXT
    headers: Mapping[str, str] = field(default_factory=dict)


Handler = Callable[[HttpRequest], HttpResponse | Awaitable[HttpResponse]]
"""A route: a plain function, or a coroutine function, which then runs in a task of its own."""


class Reader(Protocol):
    """Who asks for a page, as far as pages need to know: what of the robot they may see."""

    def may_subscribe(self, topic: str) -> bool:
        """Whether the reader may subscribe to `topic`, an absolute name without remappings to follow."""


Page = Callable[[HttpRequest, Reader], HttpResponse | Awaitable[HttpResponse]]
"""What answers the requests of a route; it shows what its reader may see."""


class Audience(Enum):
    """Who may ask for a route. Each route declares it; there is no default."""

    ANYBODY = auto()
    """Everybody, without credentials: the page reveals nothing of the robot (a health check)."""
    ADMITTED = auto()
    """Clients that may connect; the page shows what its :class:`Reader` may see."""
    EVERY_TOPIC = auto()
    """Clients that may subscribe to every topic: the page names them all (metrics)."""


@dataclass(frozen=True, slots=True)
class Route:
    """One path that a node serves.

    Attributes:
        path: as :class:`Routes` takes it, ``/stream`` or ``/packages/*``.
        page: what answers ``GET`` and ``HEAD``.
        audience: who may ask.
    """

    path: str
    page: Page
    audience: Audience


class MetricFamily(NamedTuple):
    """One metric with its samples, for ``/metrics``.

    Attributes:
        name: as Prometheus writes it; that of a counter ends in ``_total``.
        kind: its type.
        help: one sentence.
        samples: labels and value of each.
    """

    name: str
    kind: Literal["counter", "gauge"]
    help: str
    samples: Iterable[tuple[Mapping[str, str], float]]


@dataclass(frozen=True, slots=True)
class HttpExtension:
    """What a node brings to the server's HTTP port. A node that brings something has it as its `http`.

    Attributes:
        routes: its pages.
        section: what it adds to the index page: HTML, of what the reader may see.
        metrics: what it adds to ``/metrics``.
    """

    routes: tuple[Route, ...] = ()
    section: Callable[[HttpRequest, Reader], str] | None = None
    metrics: Callable[[], Iterable[MetricFamily]] | None = None


class Routes:
    """Method and path → handler. ``HEAD`` is answered by what answers ``GET``.

    A path that ends in ``/*`` takes everything below it; the longest such path wins, an exact one before all.
    """

    def __init__(self) -> None:
        self._handlers: dict[str, dict[str, Handler]] = {}

    def add(self, path: str, handler: Handler, method: str = "GET") -> None:
        """Serve `path`; a second handler for the same method and path replaces the first."""
        self._handlers.setdefault(path, {})[method.upper()] = handler

    def get(self, path: str, handler: Handler) -> None:
        """Serve ``GET`` and ``HEAD`` of `path`."""
        self.add(path, handler, "GET")

    @property
    def paths(self) -> tuple[str, ...]:
        """Every path that is served, in the order they were added."""
        return tuple(self._handlers)

    def find(self, method: str, path: str) -> Handler | HttpResponse:
        """The handler, or the 404 or 405 to answer in its place."""
        handlers = self._handlers.get(path) or self._below(path)
        if handlers is None:
            return self._not_found(path)
        handler = handlers.get("GET" if method == "HEAD" else method)
        if handler is not None:
            return handler
        allowed = ", ".join(sorted(handlers.keys() | ({"HEAD"} if "GET" in handlers else set())))
        text = f"{method} is not possible for {path}; use {allowed}\n"
        return HttpResponse(text.encode(), 405, headers={"Allow": allowed})

    def _below(self, path: str) -> dict[str, Handler] | None:
        fitting = [known for known in self._handlers if known.endswith("/*") and path.startswith(known[:-1])]
        return self._handlers[max(fitting, key=len)] if fitting else None

    def _not_found(self, path: str) -> HttpResponse:
        known = ", ".join(sorted(self._handlers)) or "nothing but WebSocket connections"
        return HttpResponse(f"there is no {path} here; this port serves {known}\n".encode(), 404)


class HttpEvents(Protocol):
    """What a conversation asks of its connection."""

    def answer(self, data: bytes) -> None:
        """Send these bytes."""

    def upgrade(self, request: HttpRequest, answer: HandshakeAnswer, rest: bytes) -> HttpResponse | None:
        """The peer may become a WebSocket: send the answer's head, feed it `rest`. A response refuses
        instead."""

    def spawn(self, work: Callable[[], Coroutine[object, object, None]]) -> None:
        """Run `work` in a task that is cancelled when the connection is gone."""

    async def drained(self) -> None:
        """Wait until everything sent so far has been taken by the network."""

    def overrun(self) -> None:
        """The peer sends more while an answer is being made than may wait: cut it."""

    def hang_up(self) -> None:
        """Close once everything is sent."""


class HttpConversation:
    """One connection's HTTP, request after request (RFC 9112), until it is upgraded or closed."""

    def __init__(self, routes: Routes, limits: Limits, events: HttpEvents, address: str) -> None:
        self._routes = routes
        self._limits = limits
        self._events = events
        self._address = address
        self._h11 = h11.Connection(h11.SERVER, max_incomplete_event_size=limits.http_header_bytes)
        self._request: h11.Request | None = None
        self._body = bytearray()
        self._busy = False
        self._streaming = False
        self._ahead = 0  # bytes that came while an answer was being made
        self._over = False
        self._served = False
        self._deadline: float | None = None

    @property
    def busy(self) -> bool:
        """Whether a handler is at work or a body is being sent."""
        return self._busy

    @property
    def streaming(self) -> bool:
        """Whether a body is being sent that comes piece by piece, and may have no end."""
        return self._streaming

    def feed(self, data: bytes) -> None:
        """Take bytes from the peer."""
        if self._over:
            return
        if self._busy:
            self._ahead += len(data)
            if self._ahead > self._limits.http_header_bytes + self._limits.http_body_bytes:
                self._over = True
                self._events.overrun()
                return
        try:
            self._h11.receive_data(data)
            self._next_events()
        except h11.RemoteProtocolError as error:
            self._fail(error.error_status_hint)

    def eof(self) -> None:
        """The peer will send nothing more. An answer under way is still sent; a stream is ended, since a
        browser that leaves it half-closes the connection and no more."""
        if not self._busy or self._streaming:
            self._end()

    def tick(self, now: float) -> None:
        """Check the time-outs; `now` is monotonic, in seconds. Bytes that trickle in extend nothing."""
        if self._busy or self._over:
            return
        if self._deadline is None:
            limits = self._limits
            self._deadline = now + (limits.idle_http_seconds if self._served else limits.handshake_seconds)
        elif now >= self._deadline:
            self._timed_out()

    def _timed_out(self) -> None:
        if self._h11.trailing_data[0] or self._request is not None:
            self._fail(408)
        self._end()

    # -- reading -------------------------------------------------------------------------------------------

    def _next_events(self) -> None:
        while not self._busy and not self._over:
            event = self._h11.next_event()
            if event is h11.NEED_DATA:
                self._continue_if_asked()
                return
            if isinstance(event, h11.Request):
                self._request = event
                self._body = bytearray()
                if _size(event) > self._limits.http_header_bytes:
                    self._fail(431)
            elif isinstance(event, h11.Data):
                self._body += event.data
                if len(self._body) > self._limits.http_body_bytes:
                    self._fail(413)
            elif isinstance(event, h11.EndOfMessage) and self._request is not None:
                self._requested(self._request)
            else:
                self._end()

    def _continue_if_asked(self) -> None:
        if self._h11.they_are_waiting_for_100_continue:
            self._send(h11.InformationalResponse(status_code=100, headers=[]))

    def _requested(self, raw: h11.Request) -> None:
        target = raw.target.decode("latin-1")
        pairs = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in raw.headers]
        headers: dict[str, str] = {}
        for name, value in pairs:
            headers[name] = f"{headers[name]}, {value}" if name in headers else value
        path, _, query = target.partition("?")
        method = raw.method.decode("latin-1")
        request = HttpRequest(method, path, query, headers, bytes(self._body), self._address)
        if wants_websocket(pairs):
            if raw.http_version < b"1.1":  # RFC 6455 section 4.2.1; a proxy's default, more often than not
                self._respond_text(426, "a WebSocket needs HTTP/1.1, this request is HTTP/1.0\n")
            else:
                self._upgrade(request, target, pairs)
            return
        found = self._routes.find(method, path)
        self._respond(found if isinstance(found, HttpResponse) else self._call(found, request))

    def _upgrade(self, request: HttpRequest, target: str, pairs: list[tuple[str, str]]) -> None:
        answer = answer_handshake(target, pairs, self._limits.deflate) if request.method == "GET" else None
        if answer is None or answer.status != 101:
            reason = answer.reason if answer else "a WebSocket is opened with GET"
            self._respond_text(
                answer.status if answer else 405, f"{reason}\n", {"Sec-WebSocket-Version": "13"}
            )
            return
        self._over = True
        refusal = self._events.upgrade(request, answer, self._h11.trailing_data[0])
        if refusal is not None:
            self._over = False
            self._respond(refusal)

    # -- answering -----------------------------------------------------------------------------------------

    def _call(self, handler: Handler, request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        try:
            return handler(request)
        except Exception:
            logger.exception("the handler of %s %s failed", request.method, request.path)
            return _INTERNAL_ERROR

    def _respond(self, response: HttpResponse | Awaitable[HttpResponse]) -> None:
        if isinstance(response, HttpResponse) and isinstance(response.body, bytes):
            self._send_whole(response, response.body)
            self._responded()
        else:
            self._busy = True
            self._events.spawn(lambda: self._respond_later(response))

    async def _respond_later(self, response: HttpResponse | Awaitable[HttpResponse]) -> None:
        if not isinstance(response, HttpResponse):
            response = await _awaited(response)
        if isinstance(response.body, bytes):
            self._send_whole(response, response.body)
        else:
            await self._stream(response, response.body)
        self._busy = False
        self._ahead = 0
        self._responded()
        try:
            self._next_events()
        except h11.RemoteProtocolError as error:
            self._fail(error.error_status_hint)

    async def _stream(self, response: HttpResponse, chunks: AsyncIterator[bytes]) -> None:
        self._send_head(response, None)
        self._streaming = True
        try:
            if not self._is_head():
                async for chunk in chunks:
                    self._send(h11.Data(data=chunk))
                    await self._events.drained()
        except Exception:
            logger.exception("a streamed body failed")
            self._end()
        else:
            self._send(h11.EndOfMessage())
        finally:
            self._streaming = False
            await _close_iterator(chunks)

    def _is_head(self) -> bool:
        return self._request is not None and self._request.method == b"HEAD"

    def _send_whole(self, response: HttpResponse, body: bytes) -> None:
        # A response that never has a body must not announce a size (RFC 9110 section 8.6).
        self._send_head(response, None if response.status in (204, 304) else len(body))
        if body and not self._is_head():
            self._send(h11.Data(data=body))
        self._send(h11.EndOfMessage())

    def _send_head(self, response: HttpResponse, size: int | None) -> None:
        headers = [("Date", formatdate(usegmt=True)), ("Content-Type", response.content_type)]
        if size is not None:
            headers.append(("Content-Length", str(size)))
        headers.extend(response.headers.items())
        phrase = HTTPStatus(response.status).phrase
        self._send(h11.Response(status_code=response.status, headers=headers, reason=phrase))

    def _send(self, event: h11.Event) -> None:
        if self._over:
            return
        data = self._h11.send(event)
        if data:
            self._events.answer(data)

    def _responded(self) -> None:
        """The answer is complete: wait for the next request, or close."""
        self._request = None
        self._served = True
        self._deadline = None
        if self._over:
            return
        if self._h11.our_state is h11.DONE and self._h11.their_state is h11.DONE:
            self._h11.start_next_cycle()
        else:
            self._end()

    def _respond_text(self, status: int, text: str, headers: Mapping[str, str] | None = None) -> None:
        self._respond(HttpResponse(text.encode(), status, headers=headers or {}))

    def _fail(self, status: int) -> None:
        """Answer a broken request, if an answer is still possible, and close."""
        if self._h11.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            text = _BROKEN.get(status, _BROKEN[400])
            self._send_whole(HttpResponse(text, status, headers={"Connection": "close"}), text)
        self._end()

    def _end(self) -> None:
        if not self._over:
            self._over = True
            self._events.hang_up()


_INTERNAL_ERROR = HttpResponse(b"internal error\n", 500)
_BROKEN = {
    400: b"this is not a valid HTTP request\n",
    408: b"the request did not arrive in time (handshake_seconds)\n",
    413: b"the request body is too large (http_body_bytes)\n",
    431: b"the request's headers are too large (http_header_bytes)\n",
}


def _size(request: h11.Request) -> int:
    """Bytes of the request line and the headers; h11 bounds only what arrives in pieces."""
    return len(request.target) + sum(len(name) + len(value) + 4 for name, value in request.headers)


async def _awaited(response: Awaitable[HttpResponse]) -> HttpResponse:
    try:
        return await response
    except Exception:
        logger.exception("a route's handler failed")
        return _INTERNAL_ERROR


async def _close_iterator(chunks: AsyncIterator[bytes]) -> None:
    """Let a generator run its clean-up now, and not when it is collected."""
    if isinstance(chunks, AsyncGenerator):
        await chunks.aclose()
