"""Adapter that serves an ASGI application, such as the SDK's transport, as a page."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from http import HTTPStatus
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import anyio

from rwt.gateways.visitors import Metered
from rwt_transports.http.routes import TEXT, HttpResponse

if TYPE_CHECKING:
    from anyio.abc import TaskGroup
    from anyio.streams.memory import MemoryObjectReceiveStream

    from rwt_transports.asgi.types import App, Event, Scope
    from rwt_transports.http.routes import HttpRequest

#: Headers that this server writes itself, and hop-by-hop headers.
_OWN_HEADERS: Final = frozenset({b"content-type", b"content-length", b"connection", b"transfer-encoding"})

_EVENTS: Final = "text/event-stream"

#: Headers of a stream that this module starts: proxies must not store or buffer it.
_EVENT_HEADERS: Final = MappingProxyType(
    {"Cache-Control": "no-cache, no-transform", "X-Accel-Buffering": "no"}
)

#: Seconds after which a response that has not begun becomes a stream. The disconnection of a stream's reader
#: is noticed at once, and its request is cancelled; before the response begins, it is not noticed.
_PATIENCE: Final = 0.25


class Exchange:
    """Request that an ASGI application answers in a task of its own; cancelled when the client disconnects.

    Args:
        on_gone: called when the reader has disconnected, or the response has ended.
        on_end: called once when the application has ended.
        has_head: True if the head of the response carries information, such as the id of a session: then
            it is waited for, however long it takes.
    """

    def __init__(
        self,
        application: App,
        request: HttpRequest,
        extra: Mapping[str, object],
        on_gone: Callable[[], None],
        on_end: Callable[[], None],
        charge: Callable[[float], object],
        *,
        has_head: bool = False,
    ) -> None:
        self._has_head = has_head
        self._gone = anyio.Event()
        self._on_gone = on_gone
        self._application = application
        self._request = request
        self._scope_extra = extra
        self._on_end = on_end
        self._charge = charge
        self._started = anyio.Event()
        self._head: tuple[int, Iterable[tuple[bytes, bytes]]] | None = None
        self._written, self._chunks = anyio.create_memory_object_stream[bytes](0)
        self._is_received = False
        self._cancel = anyio.CancelScope()

    async def respond(self, tasks: TaskGroup) -> HttpResponse:
        """Return the response once its head is known."""
        tasks.start_soon(self._run)
        try:
            with anyio.move_on_after(_PATIENCE if self._takes_events() else None):
                await self._started.wait()
        except anyio.get_cancelled_exc_class():
            self._leave()
            raise
        body = _ResponseBody(self._chunks, self._leave)
        if not self._started.is_set():
            late = _LateBody(body, self._started, lambda: self._kind == _EVENTS)
            return HttpResponse(late, 200, _EVENTS, _EVENT_HEADERS)
        if self._head is None:
            self._chunks.close()
            return HttpResponse(b"internal error\n", 500)
        status, pairs = self._head
        headers = {
            name.decode("latin-1"): value.decode("latin-1")
            for name, value in pairs
            if name.lower() not in _OWN_HEADERS
        }
        if self._kind == _EVENTS:
            return HttpResponse(body, status, _EVENTS, headers)
        try:
            return HttpResponse(b"".join([chunk async for chunk in body]), status, self._kind, headers)
        finally:
            await body.aclose()

    def _takes_events(self) -> bool:
        if self._has_head:
            return False
        return self._request.method == "POST" and _EVENTS in self._request.headers.get("accept", "")

    @property
    def _kind(self) -> str:
        """Return the content type without parameters, once the head is known."""
        pairs = () if self._head is None else self._head[1]
        kinds = [value.decode("latin-1") for name, value in pairs if name.lower() == b"content-type"]
        return kinds[0].partition(";")[0].strip() if kinds else TEXT

    async def _run(self) -> None:
        try:
            with self._cancel:
                answering = self._application(self._scope(), self._receive, self._send)
                await Metered(answering, self._charge, time.monotonic)
        finally:
            self._started.set()
            self._written.close()
            self._on_end()

    def _scope(self) -> Scope:
        request = self._request
        return {
            "type": "http",
            "asgi": {"version": "3.0", "spec_version": "2.3"},
            "http_version": "1.1",
            "method": request.method,
            "scheme": request.headers.get("x-forwarded-proto", "http"),
            "path": request.path,
            "raw_path": request.path.encode("latin-1"),
            "query_string": request.query.encode("latin-1"),
            "root_path": request.prefix,
            "headers": [
                (name.encode("latin-1"), value.encode("latin-1")) for name, value in request.headers.items()
            ],
            "client": (request.address, 0),
            "server": None,
            **self._scope_extra,
        }

    async def _receive(self) -> Event:
        if not self._is_received:
            self._is_received = True
            return {"type": "http.request", "body": self._request.body, "more_body": False}
        await self._gone.wait()
        return {"type": "http.disconnect"}

    async def _send(self, message: Event) -> None:
        if message["type"] == "http.response.start":
            HTTPStatus(message["status"])  # Raises ValueError for an invalid status before it is sent.
            self._head = (message["status"], tuple(message.get("headers", ())))
            self._started.set()
            return
        body = message.get("body", b"")
        if body:
            try:
                await self._written.send(bytes(body))
            except (anyio.BrokenResourceError, anyio.ClosedResourceError):
                return  # The reader has disconnected; the task is cancelled.
        if not message.get("more_body", False):
            self._written.close()

    def _leave(self) -> None:
        self._gone.set()
        self._on_gone()
        self._chunks.close()
        self._cancel.cancel()


class _ResponseBody(AsyncIterator[bytes]):
    """Body that an application writes; closing it early ends the exchange."""

    def __init__(self, chunks: MemoryObjectReceiveStream[bytes], leave: Callable[[], None]) -> None:
        self._chunks = chunks
        self._leave = leave
        self._is_over = False

    async def __anext__(self) -> bytes:
        try:
            return await self._chunks.receive()
        except (anyio.EndOfStream, anyio.ClosedResourceError):
            self._is_over = True  # The application may continue after its response.
            self._chunks.close()
            raise StopAsyncIteration from None

    async def aclose(self) -> None:
        if not self._is_over:
            self._is_over = True
            self._leave()


class _LateBody(AsyncIterator[bytes]):
    """Events of a late response: those of the application, or its single answer as one event.

    Args:
        started: set when it is known what that is.
        is_events: True if it writes events.
    """

    def __init__(self, body: _ResponseBody, started: anyio.Event, is_events: Callable[[], bool]) -> None:
        self._body = body
        self._started = started
        self._is_events = is_events
        self._is_begun = False

    async def __anext__(self) -> bytes:
        if not self._is_begun:
            self._is_begun = True
            return b": it takes its time\r\n\r\n"  # A comment, so that the head goes out.
        await self._started.wait()
        if self._is_events():
            return await anext(self._body)
        answer = b"".join([chunk async for chunk in self._body])
        if not answer:
            raise StopAsyncIteration
        lines = b"\r\ndata: ".join(answer.splitlines())
        return b"event: message\r\ndata: " + lines + b"\r\n\r\n"

    async def aclose(self) -> None:
        await self._body.aclose()
