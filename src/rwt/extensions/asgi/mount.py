"""Third-party ASGI app below a path of the server's port: HTTP, streams, WebSocket and lifespan."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Final

import anyio

from rwt.access.settings import SettingsError
from rwt.declarations import Mounts
from rwt.extensions.asgi.exchange import Exchange, scope_of
from rwt.extensions.asgi.types import App, Event, Scope
from rwt_protocol.frames import Frame
from rwt_transports.api import FlowControl
from rwt_transports.background import TaskStarter, background_tasks
from rwt_transports.endpoint import Accept, Endpoint, PeerInfo, Sink
from rwt_transports.http.routes import HttpRequest, HttpResponse, Routes
from rwt_transports.websocket.close_codes import INTERNAL_ERROR, NORMAL

logger = logging.getLogger("rwt.extensions.asgi")

METHODS: Final = ("GET", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")

_UNREAD_BYTES: Final = 1024 * 1024
"""Maximum unread bytes of an app; beyond it, reading from the client pauses."""

_EVENT_BYTES: Final = 256
"""Overhead counted for each message, in bytes."""

_UNSENT_BYTES: Final = 256 * 1024
"""Maximum unsent bytes of a client; beyond it, the app waits."""


class AsgiMount:
    """App below one path. It applies its own rules, and the limits of the port."""

    def __init__(self, path: str, app: App) -> None:
        self.path = path
        self._app = app
        self._tasks = TaskStarter()
        self._state: dict[str, object] = {}

    def serves(self, path: str) -> bool:
        """Return True if a path, with or without its query, belongs to the app."""
        path = path.partition("?")[0]
        return path == self.path or path.startswith(f"{self.path}/")

    @asynccontextmanager
    async def running(self) -> AsyncIterator[AsgiMount]:
        """Run the app's lifespan and accept requests within the block.

        Raises:
            RuntimeError: the app reported that it could not start.
        """
        async with background_tasks() as tasks:
            lifespan = _Lifespan(self._app, self._state)
            tasks.start_soon(self._tasks.run, tasks)
            tasks.start_soon(lifespan.run)
            try:
                await lifespan.began(self.path)
                yield self
            finally:
                with anyio.CancelScope(shield=True):
                    await lifespan.end()

    # -- HTTP ----------------------------------------------------------------------------------------------

    async def handle(self, request: HttpRequest, *, secure: bool = False) -> HttpResponse:
        """Pass a request to the app."""
        secure = secure or request.headers.get("x-forwarded-proto") in ("https", "wss")
        target = f"{request.path}?{request.query}" if request.query else request.path
        scope = self._scope("http", "https" if secure else "http", target, request.headers, request.address)
        scope["method"], scope["root_path"] = request.method, request.prefix + self.path
        if request.prefix:
            scope["path"], scope["raw_path"] = (
                request.prefix + scope["path"],
                request.prefix.encode() + scope["raw_path"],
            )
        exchange = Exchange(self._app, scope, request.body)
        self._tasks.start_soon(exchange.run)
        try:
            await exchange.started.wait()
        except BaseException:
            exchange.leave()
            raise
        return exchange.response()

    def _scope(
        self, kind: str, scheme: str, target: str, headers: Mapping[str, str], address: str, port: int = 0
    ) -> Scope:
        scope = scope_of(kind, scheme, target, headers, address, port)
        return {**scope, "root_path": self.path, "state": dict(self._state)}

    # -- WebSocket -----------------------------------------------------------------------------------------

    def accept(self, sink: Sink, info: PeerInfo) -> Endpoint:
        """Pass a WebSocket to the app. The handshake is already done; an app that rejects it closes it."""
        scope = self._scope("websocket", info.transport, info.path, info.headers, info.address, info.port)
        scope["subprotocols"] = [info.subprotocol] if info.subprotocol else []
        socket = _Socket(self._app, scope, sink)
        self._tasks.start_soon(socket.run)
        return socket


class AsgiMounts(Mounts):
    """Apps by path; of nested paths, the longest counts."""

    def __init__(self, apps: Mapping[str, App]) -> None:
        mounts = (AsgiMount(path, app) for path, app in apps.items())
        self._mounts = sorted(mounts, key=lambda mount: len(mount.path), reverse=True)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        async with AsyncExitStack() as stack:
            for mount in reversed(self._mounts):
                await stack.enter_async_context(mount.running())
            yield

    def wrap(self, accept: Accept) -> Accept:
        def accept_any(sink: Sink, info: PeerInfo) -> Endpoint:
            for mount in self._mounts:
                if mount.serves(info.path):
                    return mount.accept(sink, info)
            return accept(sink, info)

        return accept_any

    def add_to(self, routes: Routes, *, secure: bool) -> None:
        for mount in self._mounts:
            taken = [path for path in routes.paths if mount.serves(path)]
            if taken:
                raise SettingsError(
                    f"mounts: {mount.path!r} is taken by this server's {taken[0]}: choose another path"
                )
            for method in METHODS:
                for path in (mount.path, f"{mount.path}/*"):
                    routes.add(path, partial(mount.handle, secure=secure), method, is_public=True)


class _Lifespan:
    """Lifespan of an app. An app that does not support it raises, and runs without it."""

    def __init__(self, app: App, state: dict[str, object]) -> None:
        self._app = app
        self._state = state
        self._answered = anyio.Event()
        self._ending = anyio.Event()
        self._over = anyio.Event()
        self._asked = False
        self._failure = ""

    async def run(self) -> None:
        scope: Scope = {
            "type": "lifespan",
            "asgi": {"version": "3.0", "spec_version": "2.0"},
            "state": self._state,
        }
        try:
            await self._app(scope, self._receive, self._send)
        except Exception as error:
            if self._answered.is_set():
                logger.exception("the lifespan of a mounted app failed")
            else:
                logger.debug("a mounted app has no lifespan: %s", error)
        finally:
            self._answered.set()
            self._over.set()

    async def _receive(self) -> Event:
        if not self._asked:
            self._asked = True
            return {"type": "lifespan.startup"}
        await self._ending.wait()
        return {"type": "lifespan.shutdown"}

    async def _send(self, event: Event) -> None:
        if event["type"] == "lifespan.startup.failed":
            self._failure = event.get("message") or "it does not say why"
        elif event["type"] == "lifespan.shutdown.failed":
            logger.error("a mounted app could not end: %s", event.get("message", ""))
        self._answered.set()

    async def began(self, path: str) -> None:
        await self._answered.wait()
        if self._failure:
            raise RuntimeError(f"the app at {path} could not start: {self._failure}")

    async def end(self) -> None:
        self._ending.set()
        await self._over.wait()


class _Socket:
    """WebSocket of an app. Implements :class:`rwt_transports.endpoint.Endpoint`."""

    def __init__(self, app: App, scope: Scope, sink: Sink) -> None:
        self._app = app
        self._scope = scope
        self._sink = sink
        self._flow_control: FlowControl | None = None
        self._unread: deque[tuple[Event, int]] = deque([({"type": "websocket.connect"}, 0)])
        self._size = 0
        self._held = False
        self._over = False
        self._awake = anyio.Event()
        self._drained = anyio.Event()

    # -- the connection's side -----------------------------------------------------------------------------

    def set_flow_control(self, flow_control: FlowControl) -> None:
        self._flow_control = flow_control

    def receive(self, data: bytes, binary: bool) -> None:
        event: Event = {"type": "websocket.receive"}
        if binary:
            event["bytes"] = data
        else:
            event["text"] = data.decode("utf-8", "replace")
        size = len(data) + _EVENT_BYTES
        self._unread.append((event, size))
        self._size += size
        if self._size > _UNREAD_BYTES and not self._held and self._flow_control is not None:
            self._held = True
            self._flow_control.pause()
        self._awake.set()

    def closed(self, code: int, reason: str) -> None:
        self._over = True
        self._unread.append(({"type": "websocket.disconnect", "code": code, "reason": reason}, 0))
        self._awake.set()
        self._drained.set()

    # -- the app's side ------------------------------------------------------------------------------------

    async def run(self) -> None:
        try:
            await self._app(self._scope, self._receive, self._send)
        except Exception:
            logger.exception("a mounted app failed at %s", self._scope["path"])
            self._sink.close(INTERNAL_ERROR, "internal error")
        else:
            self._sink.close(NORMAL, "")

    async def _receive(self) -> Event:
        while not self._unread:
            self._awake = anyio.Event()
            await self._awake.wait()
        event, size = self._unread.popleft()
        self._size -= size
        if self._held and self._size <= _UNREAD_BYTES // 2 and self._flow_control is not None:
            self._held = False
            self._flow_control.resume()
        return event

    async def _send(self, event: Event) -> None:
        if event["type"] == "websocket.close":
            self._sink.close(event.get("code", NORMAL), event.get("reason") or "")
        elif event["type"] == "websocket.send":
            text = event.get("text")
            if text is None:
                self._sink.send(Frame(event["bytes"], binary=True))
            else:
                self._sink.send(Frame(text.encode("utf-8", "replace")))
            await self._room()

    async def _room(self) -> None:
        while self._sink.backlog > _UNSENT_BYTES and not self._over and self._flow_control is not None:
            self._drained = anyio.Event()
            self._flow_control.when_empty(self._drained.set)
            await self._drained.wait()
