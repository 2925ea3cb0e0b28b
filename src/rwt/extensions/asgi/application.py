"""Listener without a port: clients connect through an ASGI server, below any path."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from dataclasses import replace
from typing import Final
from urllib.parse import quote

import anyio

from rwt.declarations import HostedApp, PortOptions
from rwt.extensions.asgi.messages import AsgiWire, close_bytes, close_of
from rwt.extensions.asgi.types import Receive, Scope, Send
from rwt_transports.connection import Connection, ListenerState
from rwt_transports.drivers.task_link import TaskLink
from rwt_transports.endpoint import Accept, Identify, PeerInfo, anonymous
from rwt_transports.errors import Refused, log_exception
from rwt_transports.http.addresses import AddressCount
from rwt_transports.http.connection import BROKEN, SAFE_HEADERS, close_iterator
from rwt_transports.http.proxies import NO_PROXIES, Proxies
from rwt_transports.http.routes import (
    Hosts,
    HttpRequest,
    HttpResponse,
    Routes,
    is_local,
    joined_headers,
)
from rwt_transports.limits import Limits
from rwt_transports.websocket.close_codes import NO_STATUS, POLICY, may_travel
from rwt_transports.websocket.handshake import choose_subprotocol
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.whole_messages import BINARY, CLOSE, HEADER, TEXT, MessageCutter

access = logging.getLogger("rwt_transports.access")

_NOT_RUNNING = (
    "the robot's server does not run: enter it in the lifespan of the app that this is mounted in"
    " (`async with server:`)\n"
)


class AsgiLink(TaskLink):
    """Accepted WebSocket of one scope.

    The writing task awaits the ASGI server's backpressure. Meanwhile, the connection's outbox queues frames
    within its limits.
    """

    __slots__ = ("_receive", "_send")

    def __init__(self, receive: Receive, send: Send) -> None:
        super().__init__()
        self._receive = receive
        self._send = send

    def finish(self) -> None:
        self.close()

    async def _read(self) -> None:
        receive = self._callbacks.receive
        while True:
            await self._reading.wait()
            event = await self._receive()
            if event["type"] == "websocket.receive":
                text = event.get("text")
                # surrogatepass: a server that decodes leniently must not cost the connection.
                data = event["bytes"] if text is None else text.encode("utf-8", "surrogatepass")
                receive(HEADER.pack(BINARY if text is None else TEXT, len(data)))
                receive(data)
            elif event["type"] == "websocket.disconnect":
                code = event.get("code") or NO_STATUS
                data = close_bytes(code, event.get("reason") or "")
                receive(HEADER.pack(CLOSE, len(data)))
                receive(data)
                self.close()
                return

    async def _write(self) -> None:
        cutter = MessageCutter(self._callbacks.take)
        while not self._closing:
            await self._woken()
            while (message := cutter.next()) is not None:
                data, kind = message
                if kind == CLOSE:
                    await self._send_close(*close_of(data))
                    return
                try:
                    await self._send(_event(kind, data))
                except OSError:  # The client has disconnected; the specification lets servers raise this.
                    return
                self._callbacks.progress()

    async def _send_close(self, code: int, reason: str) -> None:
        code = code if may_travel(code) else 1000
        try:
            await self._send({"type": "websocket.close", "code": code, "reason": reason})
        except (OSError, RuntimeError):  # Some servers raise this if the client has disconnected.
            return


def _event(kind: int, data: bytes) -> dict[str, object]:
    if kind == BINARY:
        return {"type": "websocket.send", "bytes": data}
    return {"type": "websocket.send", "text": data.decode("utf-8", "replace")}


class AsgiListener:
    """Serves scopes of HTTP and WebSocket, while its block lasts (:func:`asgi_listener`)."""

    def __init__(self, state: ListenerState, routes: Routes) -> None:
        self._state = state
        self._routes = routes

    @property
    def connections(self) -> int:
        return len(self._state.connections)

    # -- HTTP ----------------------------------------------------------------------------------------------

    async def http(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = self._request_of(scope)
        addresses = self._state.addresses
        addresses.enter(request.address)
        try:
            try:
                self._check(request)
                response = await self._answer(request, receive)
            except Refused as refused:
                response = HttpResponse.refusing(refused)
            if response is not None:
                self._log(request, response)
                await _respond(request, response, receive, send)
        finally:
            addresses.leave(request.address)

    def _request_of(self, scope: Scope) -> HttpRequest:
        headers = joined_headers(
            (name.decode("latin-1").lower(), value.decode("latin-1")) for name, value in scope["headers"]
        )
        client = scope.get("client") or (UNKNOWN_CLIENT, 0)
        address, prefix = self._state.proxies.resolve(str(client[0]), headers)
        if scope.get("scheme") in ("https", "wss"):
            headers["x-forwarded-proto"] = "https"
        path, mounted = _split_path(scope)
        query = scope.get("query_string", b"").decode("latin-1")
        method = scope.get("method", "GET").upper()
        # Servers that read a proxy's headers leave out the port; then the connection is not known.
        connection = tuple(client) if client[1] else None
        return HttpRequest(method, path, query, headers, b"", address, prefix + mounted, connection)

    def _check(self, request: HttpRequest) -> None:
        """Raise Refused if the listener does not answer a request."""
        host = request.headers.get("host", "")
        self._state.addresses.check_host(self._state.hosts, host, request.address)
        if self._state.closing:
            raise Refused(503, "this server is closing")
        self._state.addresses.check(request.address)

    async def _answer(self, request: HttpRequest, receive: Receive) -> HttpResponse | None:
        """Return the response; None if the client left before its request was complete."""
        found = self._routes.find(request.method, request.path)
        body = await _body(receive, *self._state.body_limit(self._routes, request))
        if body is None or isinstance(body, HttpResponse):
            return body
        if isinstance(found, HttpResponse):
            return found
        try:
            answer = found(replace(request, body=body))
            return answer if isinstance(answer, HttpResponse) else await answer
        except Exception:
            log_exception("the handler of %s %s failed", request.method, request.path)
            return HttpResponse(b"internal error\n", 500)

    def _log(self, request: HttpRequest, response: HttpResponse) -> None:
        if self._state.access_log:
            shown = ascii(request.path)[1:-1]
            access.info("%s %s %s %d -", request.address, request.method, shown, response.status)

    # -- WebSocket -----------------------------------------------------------------------------------------

    async def websocket(self, scope: Scope, receive: Receive, send: Send) -> None:
        if (await receive())["type"] != "websocket.connect":
            return
        request = self._request_of(scope)
        state = self._state
        client = scope.get("client") or ("", 0)
        state.addresses.enter(request.address)
        subprotocol = choose_subprotocol(scope.get("subprotocols", ()), state.subprotocols)
        link = AsgiLink(receive, send)
        connection = Connection(state, link, request.address, int(client[1] or 0))
        target = f"{request.path}?{request.query}" if request.query else request.path
        peer = PeerInfo(
            "wss" if scope.get("scheme") == "wss" else "ws",
            request.address,
            int(client[1] or 0),
            target,
            request.headers,
            subprotocol=subprotocol or "",
        )
        link.set_callbacks(connection)
        refusal: HttpResponse | None = None
        try:
            self._check(request)
            state.claim(connection, peer)
            connection.open(peer)
        except Refused as refused:
            refusal = HttpResponse.refusing(refused)
        except Exception:
            log_exception("the accept function failed for %s", connection)
            refusal = HttpResponse(b"internal error\n", 500)
        if refusal is not None:
            state.detach(connection)
            await _refuse(scope, send, refusal)
            return
        state.connections.add(connection)
        try:
            await send({"type": "websocket.accept", "subprotocol": subprotocol})
        except BaseException:
            connection.lost()
            raise
        await link.run()


def _split_path(scope: Scope) -> tuple[str, str]:
    raw = scope.get("raw_path") or b""
    path = raw.decode("latin-1").partition("?")[0] or quote(scope["path"])
    remaining = scope.get("path_remaining")  # Set by Django Channels' URLRouter, which keeps the path.
    if remaining is not None:
        below = f"/{quote(remaining).lstrip('/')}"
        return below, path.removesuffix(below).removesuffix(quote(remaining)).rstrip("/")
    mounted = quote(scope.get("root_path") or "").rstrip("/")
    # Some servers include the mount point in the path, as the specification now requires; others do not.
    if mounted and (path == mounted or path.startswith(mounted + "/")):
        path = path.removeprefix(mounted)
    return path or "/", mounted


async def _body(receive: Receive, most: int, status: int) -> bytes | HttpResponse | None:
    body = bytearray()
    while True:
        event = await receive()
        if event["type"] != "http.request":
            return None
        body += event.get("body", b"")
        if len(body) > most:
            return HttpResponse(BROKEN[status], status, headers={"Connection": "close"})
        if not event.get("more_body", False):
            return bytes(body)


async def _respond(request: HttpRequest, response: HttpResponse, receive: Receive, send: Send) -> None:
    body = response.body
    pairs = _pairs(response, SAFE_HEADERS)
    await send({"type": "http.response.start", "status": response.status, "headers": pairs})
    if isinstance(body, bytes):
        await send({"type": "http.response.body", "body": b"" if request.method == "HEAD" else body})
        return
    try:
        if request.method != "HEAD":
            await _stream(body, receive, send)
        await send({"type": "http.response.body", "body": b""})
    finally:
        await close_iterator(body)


async def _stream(chunks: AsyncIterator[bytes], receive: Receive, send: Send) -> None:
    async with anyio.create_task_group() as tasks:

        async def watch() -> None:
            while (await receive())["type"] != "http.disconnect":
                pass
            tasks.cancel_scope.cancel()

        tasks.start_soon(watch)
        try:
            async for chunk in chunks:
                await send({"type": "http.response.body", "body": chunk, "more_body": True})
        except OSError:  # The client has disconnected; the specification lets servers raise this.
            pass
        except Exception:
            log_exception("a streamed body failed")
        tasks.cancel_scope.cancel()


def _pairs(response: HttpResponse, others: Mapping[str, str]) -> list[tuple[bytes, bytes]]:
    """Return the headers of a response as ASGI has them, and others that it does not set itself."""
    headers = {name.lower(): value for name, value in (*others.items(), *response.headers.items())}
    headers = {"content-type": response.content_type, **headers}
    if isinstance(response.body, bytes) and response.status not in (204, 304):
        headers["content-length"] = str(len(response.body))
    cookies = [("set-cookie", cookie) for cookie in response.cookies]
    return [(n.encode("latin-1"), v.encode("latin-1")) for n, v in (*headers.items(), *cookies)]


async def _refuse(scope: Scope, send: Send, response: HttpResponse) -> None:
    """Reject a WebSocket, with a response if the server supports `websocket.http.response`."""
    reason = response.body if isinstance(response.body, bytes) else b""
    if "websocket.http.response" not in (scope.get("extensions") or {}):
        text = reason.decode("utf-8", "replace").strip()[:120]
        await send({"type": "websocket.close", "code": POLICY, "reason": text})
        return
    start = {"status": response.status, "headers": _pairs(response, {})}
    await send({"type": "websocket.http.response.start", **start})
    await send({"type": "websocket.http.response.body", "body": reason})


@asynccontextmanager
async def asgi_listener(
    accept: Accept,
    *,
    routes: Routes,
    hosts: Iterable[str] = (),
    proxies: Proxies = NO_PROXIES,
    access_log: bool = False,
    subprotocols: Iterable[str] = (),
    addresses: AddressCount | None = None,
    identify: Identify = anonymous,
    limits: Limits | None = None,
    buffers: ReceiveBufferPool | None = None,
    loopback: bool = False,
) -> AsyncIterator[AsgiListener]:
    """Serve scopes within the block; leaving it closes every WebSocket with 1001.

    Args:
        accept, routes, hosts, proxies, access_log, subprotocols, addresses, identify, limits, buffers: as of
            :func:`rwt_transports.listener.listen`.
        loopback: True if the clients' server is only reached from this machine.
    """
    chosen = Limits() if limits is None else limits
    state = ListenerState(
        accept,
        AsgiWire,
        chosen,
        None,
        "ws",
        addresses=addresses or AddressCount(chosen.connections_per_address),
        buffers=buffers or chosen.receive_pool(),
        proxies=proxies,
        access_log=access_log,
        subprotocols=frozenset(subprotocols),
        identify=identify,
        hosts=Hosts(hosts, loopback=loopback),
    )
    async with state.serving():
        yield AsgiListener(state, routes)


UNKNOWN_CLIENT: Final = "unknown"
"""Address of all clients that the ASGI server does not name, as behind a Unix socket: one, with limits."""

Lifespan = Callable[[], AbstractAsyncContextManager[object]]
"""Factory of the context in which an app runs."""


class AsgiApplication(HostedApp):
    """ASGI 3 application of a server: HTTP, server-sent events and WebSocket, below any path.

    It serves while it has listeners. If it is the whole app, the lifespan protocol starts and stops its
    server.

    Args:
        lifespan: context manager that the lifespan of the ASGI server enters and exits.
    """

    def __init__(self, lifespan: Lifespan) -> None:
        self._lifespan = lifespan
        self._listeners: dict[bool, AsgiListener] = {}

    @asynccontextmanager
    async def serving(self, port: Callable[[bool], tuple[Accept, PortOptions]]) -> AsyncIterator[None]:
        async with AsyncExitStack() as stack:
            for loopback in (True, False):
                accept, options = port(loopback)
                listener = asgi_listener(accept, **options._asdict(), loopback=loopback)
                self._listeners[loopback] = await stack.enter_async_context(listener)
            try:
                yield
            finally:
                self._listeners.clear()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        kind = scope["type"]
        if kind == "lifespan":
            await _live(self._lifespan, receive, send)
            return
        if kind not in ("http", "websocket"):
            raise RuntimeError(f"no ASGI scope of type {kind!r} is served here: http and websocket are")
        server = scope.get("server")
        listener = self._listeners.get(server is None or is_local(str(server[0])) or not server[1])
        if listener is None:
            await _say_not_running(kind, scope, receive, send)
        elif kind == "http":
            await listener.http(scope, receive, send)
        else:
            await listener.websocket(scope, receive, send)


async def _live(lifespan: Lifespan, receive: Receive, send: Send) -> None:
    if (await receive())["type"] != "lifespan.startup":
        return
    began = False
    try:
        async with lifespan():
            began = True
            await send({"type": "lifespan.startup.complete"})
            await receive()
    except Exception as error:
        log_exception("the server %s", "could not end" if began else "could not start")
        await send({"type": f"lifespan.{'shutdown' if began else 'startup'}.failed", "message": str(error)})
        return
    await send({"type": "lifespan.shutdown.complete"})


async def _say_not_running(kind: str, scope: Scope, receive: Receive, send: Send) -> None:
    response = HttpResponse(_NOT_RUNNING.encode(), 503)
    if kind == "websocket":
        await receive()
        await _refuse(scope, send, response)
    else:
        await _respond(HttpRequest(scope["method"], scope["path"]), response, receive, send)
