"""Adapter that serves the SDK's transport, an ASGI app, as a page."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable, Mapping
from types import MappingProxyType
from typing import Final

import anyio
from anyio.abc import TaskGroup

from rwt.extensions.asgi.exchange import Exchange, ResponseBody, scope_of
from rwt.extensions.asgi.types import App
from rwt.gateways.visitors import Metered
from rwt_transports.http.routes import TEXT, HttpRequest, HttpResponse

_EVENTS: Final = "text/event-stream"

#: Headers of a stream that this module starts: proxies must not store or buffer it.
_EVENT_HEADERS: Final = MappingProxyType(
    {"Cache-Control": "no-cache, no-transform", "X-Accel-Buffering": "no"}
)

#: Seconds after which a response that has not begun becomes a stream. The disconnection of a stream's reader
#: is noticed at once, and its request is cancelled; before the response begins, it is not noticed.
PATIENCE_SECONDS: Final = 0.25


class AgentExchange(Exchange):
    """Request of an agent, which is cancelled when the agent disconnects.

    Args:
        extra: further members of the scope.
        on_gone: called when the reader has disconnected.
        on_end: called once when the app has ended.
        charge: called with the seconds of work.
        has_head: True if the head of the response carries information, such as the id of a session: then
            it is waited for, however long it takes.
    """

    default_kind = TEXT

    def __init__(
        self,
        app: App,
        request: HttpRequest,
        extra: Mapping[str, object],
        on_gone: Callable[[], None],
        on_end: Callable[[], None],
        charge: Callable[[float], object],
        *,
        has_head: bool = False,
    ) -> None:
        scheme = request.headers.get("x-forwarded-proto", "http")
        target = f"{request.path}?{request.query}"
        scope = scope_of("http", scheme, target, request.headers, request.address)
        scope["method"], scope["root_path"] = request.method, request.prefix
        # From 2.4 on, Starlette does not wait for a disconnection, which has to cancel the request.
        scope["asgi"] = {"version": "3.0", "spec_version": "2.3"}
        super().__init__(app, {**scope, **extra}, request.body)
        accepts = request.headers.get("accept", "")
        self._takes_events = not has_head and request.method == "POST" and _EVENTS in accepts
        self._on_gone = on_gone
        self._on_end = on_end
        self._charge = charge
        self._cancel = anyio.CancelScope()

    @property
    def has_events(self) -> bool:
        """True if the app answers by a stream of events."""
        return self.kind.partition(";")[0].strip() == _EVENTS

    async def respond(self, tasks: TaskGroup) -> HttpResponse:
        """Return the response once its head is known."""
        tasks.start_soon(self.run)
        try:
            with anyio.move_on_after(PATIENCE_SECONDS if self._takes_events else None):
                await self.headed.wait()
            body = ResponseBody(self)
            if not self.headed.is_set():
                return HttpResponse(_LateBody(self, body), 200, _EVENTS, _EVENT_HEADERS)
            if not self.has_events:
                await self.started.wait()
            return self.response(body if self.has_events else None)
        except anyio.get_cancelled_exc_class():
            self.leave()
            raise

    async def run(self) -> None:
        """Let the app answer, until the agent leaves."""
        try:
            with self._cancel:
                await Metered(super().run(), self._charge, time.monotonic)
        finally:
            self._on_end()

    def leave(self) -> None:
        """Cancel the answer."""
        super().leave()
        self._on_gone()
        self._cancel.cancel()


class _LateBody(AsyncIterator[bytes]):
    """Events of a late response: those of the app, or its single answer as one event."""

    def __init__(self, exchange: AgentExchange, body: ResponseBody) -> None:
        self._exchange = exchange
        self._body = body
        self._is_begun = False

    async def __anext__(self) -> bytes:
        if not self._is_begun:
            self._is_begun = True
            return b": it takes its time\r\n\r\n"  # A comment, so that the head goes out.
        await self._exchange.headed.wait()
        if self._exchange.has_events:
            return await anext(self._body)
        answer = b"".join([chunk async for chunk in self._body])
        if not answer:
            raise StopAsyncIteration
        lines = b"\r\ndata: ".join(answer.splitlines())
        return b"event: message\r\ndata: " + lines + b"\r\n\r\n"

    async def aclose(self) -> None:
        await self._body.aclose()
