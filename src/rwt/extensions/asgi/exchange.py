"""HTTP request that an ASGI app answers in a task of its own."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Mapping
from http import HTTPStatus
from typing import ClassVar, Final
from urllib.parse import unquote

import anyio
from anyio.streams.memory import MemoryObjectReceiveStream, MemoryObjectSendStream

from rwt.extensions.asgi.types import App, Event, Scope
from rwt_transports.http.routes import TEXT, HttpResponse, joined_headers

logger = logging.getLogger("rwt.extensions.asgi")

_OURS: Final = frozenset({"content-length", "transfer-encoding", "connection", "date", "content-type"})
"""Headers that the server writes itself."""


def scope_of(
    kind: str, scheme: str, target: str, headers: Mapping[str, str], address: str, port: int = 0
) -> Scope:
    """Return the scope of a request or WebSocket, as far as all apps have it in common."""
    path, _, query = target.partition("?")
    return {
        "type": kind,
        "asgi": {"version": "3.0", "spec_version": "2.4"},
        "http_version": "1.1",
        "scheme": scheme,
        "path": unquote(path),
        "raw_path": path.encode("latin-1"),
        "query_string": query.encode("latin-1"),
        "headers": [(name.encode("latin-1"), value.encode("latin-1")) for name, value in headers.items()],
        "client": (address, port) if address else None,
        "server": None,
    }


class Exchange:
    """Request and the app's response.

    The head of a response is not sent before its body begins, so that a body of one piece has a length.

    Attributes:
        headed: set when the head of the response is known.
        started: set when the beginning of its body is known, too.
        gone: set when the reader has disconnected, or has read everything.
        default_kind: content type of a response that names none.
    """

    default_kind: ClassVar = "application/octet-stream"

    def __init__(self, app: App, scope: Scope, body: bytes) -> None:
        self._app = app
        self._scope = scope
        self._body: bytes | None = body
        self.headed = anyio.Event()
        self.started = anyio.Event()
        self.gone = anyio.Event()
        self._status = 500
        self._headers: list[tuple[str, str]] = []
        self._whole: bytes | None = None
        self._chunks: MemoryObjectSendStream[bytes] | None = None
        self._read: MemoryObjectReceiveStream[bytes] | None = None

    async def run(self) -> None:
        try:
            await self._app(self._scope, self._receive, self._send)
        except Exception as error:
            # An error that the disconnection of the client has caused is not a failure.
            if not (self.gone.is_set() and _is_leave(error)):
                logger.exception("a mounted app failed at %s", self._scope["path"])
        finally:
            if self._chunks is not None:
                self._chunks.close()
            # The app has returned or failed without a body.
            elif self._whole is None:
                self._status, self._headers, self._whole = 500, [], b"internal error\n"
            self.headed.set()
            self.started.set()

    async def _receive(self) -> Event:
        body, self._body = self._body, None
        if body is not None:
            return {"type": "http.request", "body": body, "more_body": False}
        await self.gone.wait()
        return {"type": "http.disconnect"}

    async def _send(self, event: Event) -> None:
        if event["type"] == "http.response.start":
            self._status = HTTPStatus(event["status"]).value  # Raises ValueError for an invalid status.
            pairs = event.get("headers", ())
            self._headers = [(n.decode("latin-1").lower(), v.decode("latin-1")) for n, v in pairs]
            self.headed.set()
        elif event["type"] == "http.response.body" and self._whole is None:
            chunk, more = bytes(event.get("body", b"")), event.get("more_body", False)
            if self._chunks is None:
                # A body of one piece: the response gets a length, and no stream.
                if not more:
                    self._whole = chunk
                    self.started.set()
                    return
                self._chunks, self._read = anyio.create_memory_object_stream[bytes](0)
                self.started.set()
            if self.gone.is_set():
                raise OSError("the client has gone")  # Required by the specification since version 2.4.
            if chunk:
                try:
                    await self._chunks.send(chunk)
                except (anyio.BrokenResourceError, anyio.ClosedResourceError):
                    raise OSError("the client has gone") from None
            if not more:
                self._chunks.close()

    def leave(self) -> None:
        """Report to the app that the reader has disconnected."""
        self.gone.set()
        if self._read is not None:
            self._read.close()

    @property
    def kind(self) -> str:
        """Content type of the response, once its head is known."""
        kinds = (value for name, value in self._headers if name == "content-type")
        return next(kinds, self.default_kind if self._headers else TEXT)

    def response(self, body: AsyncIterator[bytes] | None = None) -> HttpResponse:
        """Return the response; `body` in place of the app's own, which :meth:`chunk` returns."""
        headers = joined_headers(
            (name, value) for name, value in self._headers if name not in _OURS and name != "set-cookie"
        )
        cookies = tuple(value for name, value in self._headers if name == "set-cookie")
        own = self._whole if self._read is None else ResponseBody(self)
        return HttpResponse(body or own or b"", self._status, self.kind, headers, cookies)

    async def chunk(self) -> bytes:
        """Return the next piece of the body, once there is one; empty at the end."""
        await self.started.wait()
        if self._read is None:
            whole, self._whole = self._whole or b"", b""
            return whole
        try:
            return await self._read.receive()
        except (anyio.EndOfStream, anyio.ClosedResourceError):
            self._read.close()
            return b""


class ResponseBody(AsyncIterator[bytes]):
    """Body of an exchange. Closing it before its end lets the client leave, even if nothing was read."""

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange
        self._is_over = False

    async def __anext__(self) -> bytes:
        chunk = await self._exchange.chunk()
        if not chunk:
            self._is_over = True
            self._exchange.gone.set()
            raise StopAsyncIteration
        return chunk

    async def aclose(self) -> None:
        if not self._is_over:
            self._is_over = True
            self._exchange.leave()


def _is_leave(error: BaseException) -> bool:
    """Return True if an error, its cause or a whole group comes from the client's disconnection."""
    if isinstance(error, BaseExceptionGroup):
        return all(map(_is_leave, error.exceptions))
    known = (error, error.__cause__, error.__context__)
    return any(isinstance(each, OSError) for each in known)
