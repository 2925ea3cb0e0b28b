"""Opening a connection: the counterpart of :func:`rwt_transports.listener.listen`, over the same wires."""

from __future__ import annotations

import asyncio
import errno
import os
import shlex
import socket
import ssl
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Final, TypedDict
from urllib.parse import urlsplit

import anyio
from anyio.abc import ByteStream, Process, TaskGroup
from anyio.streams.stapled import StapledByteStream
from websockets.uri import WebSocketURI

from rwt_protocol.transport import Accept, Buffer
from rwt_transports.api import DriverCallbacks, Link
from rwt_transports.background import background_tasks
from rwt_transports.connection import Connection, ListenerState, MakeWire
from rwt_transports.drivers.anyio_stream import serve_stream
from rwt_transports.drivers.asyncio_protocol import client_link
from rwt_transports.errors import BadUrl, ConnectError, TransportError
from rwt_transports.limits import Limits
from rwt_transports.websocket.client_handshake import ClientHandshake
from rwt_transports.websocket.wire import websocket_client
from rwt_transports.wires.json_stream import json_lines, json_over_tcp

TICK_SECONDS = 0.5


@dataclass(frozen=True, slots=True)
class _Scheme:
    """One row of the table: the wire, its port where none is named, and whether it is encrypted."""

    make_wire: MakeWire
    port: int = 0
    tls: bool = False
    websocket: bool = False


SCHEMES: Mapping[str, _Scheme] = {
    "ws": _Scheme(websocket_client, 9090, websocket=True),
    "wss": _Scheme(websocket_client, 443, tls=True, websocket=True),
    "tcp": _Scheme(json_over_tcp, 9090),
    "tcps": _Scheme(json_over_tcp, 9090, tls=True),
    "unix": _Scheme(json_lines),
    "stdio": _Scheme(json_lines),
}
"""What can be connected to. ``ws`` without a port means rosbridge's, 9090, and ``wss`` means 443."""


def carries_binary(url: str) -> bool:
    """Whether binary messages can be sent to that URL; not on a stream of JSON objects (TCP-05)."""
    scheme = SCHEMES.get(url.partition(":")[0].lower())
    return scheme is not None and scheme.websocket


@dataclass(frozen=True, slots=True)
class ConnectUrl:
    """A URL to connect to, taken apart.

    Attributes:
        name: the scheme.
        host: name or address, without brackets; empty for ``unix`` and ``stdio``.
        port: 0 where there is none.
        path: path and query of the request; of ``unix`` the socket, of ``stdio`` the command.
    """

    name: str
    scheme: _Scheme
    host: str = ""
    port: int = 0
    path: str = ""

    def __str__(self) -> str:
        return f"{self.host}:{self.port}" if self.host else self.path

    @property
    def websocket(self) -> WebSocketURI:
        """The same for the handshake."""
        path, _, query = self.path.partition("?")
        return WebSocketURI(self.scheme.tls, self.host, self.port, path, query)


def parse_connect_url(url: str) -> ConnectUrl:
    """Take a URL apart.

    Raises:
        BadUrl: naming what is wrong, with an example.
    """
    name, separator, rest = url.partition(":")
    name = name.lower()
    scheme = SCHEMES.get(name)
    if scheme is None or not separator:
        known = ", ".join(f"{each}:" for each in SCHEMES)
        raise BadUrl(f"cannot connect to {url!r}: use one of {known} for example ws://127.0.0.1:9090")
    if name == "stdio":
        if not rest.strip():
            raise BadUrl(
                f"cannot connect to {url!r}: it names no command; for example stdio:my_robot --serve"
            )
        return ConnectUrl(name, scheme, path=rest.strip())
    if name == "unix":
        path = rest.removeprefix("//")
        if not path.startswith("/"):
            raise BadUrl(
                f"cannot connect to {url!r}: it names no absolute path; for example unix:///run/r.sock"
            )
        return ConnectUrl(name, scheme, path=path)
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or parts.fragment or parts.username is not None:
        raise BadUrl(
            f"cannot connect to {url!r}: expected {name}://HOST:PORT, for example {name}://robot:9090"
        )
    path = f"{parts.path or '/'}?{parts.query}" if parts.query else parts.path or "/"
    return ConnectUrl(name, scheme, host, scheme.port if port is None else port, path)


@dataclass(slots=True)
class OutgoingConnection:
    """One connection that this side opens.

    Attributes:
        opened: set once messages can be sent, or once it has failed.
        error: why it could not be opened.
    """

    target: ConnectUrl
    state: ListenerState
    headers: Mapping[str, str]
    opened: anyio.Event = field(default_factory=anyio.Event)
    error: TransportError | None = None
    connection: Connection | None = None
    _draining: anyio.Event | None = None

    def attach(self, link: Link, address: str, port: int) -> DriverCallbacks:
        """The bytes can flow; called by a driver."""
        if self.target.scheme.websocket:
            return _Handshaking(self, link, address, port)
        return self.begin(link, address, port)

    def begin(self, link: Link, address: str, port: int) -> Connection:
        """Messages can flow."""
        self.connection = self.state.attach(link, address, port)
        self.opened.set()
        return self.connection

    def fail(self, error: TransportError) -> None:
        """It could not be opened."""
        if not self.opened.is_set():
            self.error = error
            self.opened.set()

    async def drained(self) -> None:
        """Wait until everything sent so far was handed to the network.

        Whoever waits while the connection is lost waits for ever: watch for the endpoint's `closed`, too.
        """
        if self.connection is None or self.connection not in self.state.connections:
            return
        if self._draining is None:
            self._draining = anyio.Event()
            self.connection.outbox.when_empty(self._emptied)
        await self._draining.wait()

    def _emptied(self) -> None:
        if self._draining is not None:
            self._draining.set()
            self._draining = None


class _Handshaking:
    """What a driver drives from its first byte: the handshake, then the connection."""

    __slots__ = ("_address", "_connection", "_handshake", "_link", "_outgoing", "_port", "_request")

    def __init__(self, outgoing: OutgoingConnection, link: Link, address: str, port: int) -> None:
        self._outgoing = outgoing
        self._link = link
        self._address = address
        self._port = port
        self._connection: Connection | None = None
        self._handshake = ClientHandshake(outgoing.target.websocket, outgoing.headers)
        self._request: bytes | None = self._handshake.request
        link.wake()

    def receive(self, data: bytes) -> None:
        """Bytes arrived."""
        if self._connection is not None:
            self._connection.receive(data)
            return
        try:
            rest = self._handshake.feed(data)
        except TransportError as error:
            self._outgoing.fail(error)
            self._link.abort()
            return
        if rest is not None:
            self._connection = self._outgoing.begin(self._link, self._address, self._port)
            if rest:
                self._connection.receive(rest)

    def get_buffer(self) -> memoryview | None:
        """Where the next bytes may be received directly."""
        return None if self._connection is None else self._connection.get_buffer()

    def buffer_updated(self, count: int) -> None:
        """`count` bytes were received there."""
        if self._connection is not None:
            self._connection.buffer_updated(count)

    def take(self) -> Buffer | None:
        """The next bytes to write."""
        if self._connection is not None:
            return self._connection.take()
        request, self._request = self._request, None
        return request

    def progress(self) -> None:
        """The network took bytes again."""
        if self._connection is not None:
            self._connection.progress()

    def eof(self) -> None:
        """The server will send nothing more."""
        if self._connection is not None:
            self._connection.eof()
            return
        try:
            self._handshake.eof()
        except TransportError as error:
            self._outgoing.fail(error)
        self._link.abort()

    def lost(self) -> None:
        """The link is gone."""
        if self._connection is not None:
            self._connection.lost()
        self._outgoing.fail(ConnectError(f"{self._outgoing.target} hung up before the connection was open"))


class ConnectOptions(TypedDict, total=False):
    """The keyword arguments of :func:`connect`."""

    limits: Limits | None
    tls: ssl.SSLContext | None
    headers: Mapping[str, str] | None
    timeout: float


@asynccontextmanager
async def connect(
    url: str,
    accept: Accept,
    *,
    limits: Limits | None = None,
    tls: ssl.SSLContext | None = None,
    headers: Mapping[str, str] | None = None,
    timeout: float = 10.0,  # noqa: ASYNC109 - raises our own error
) -> AsyncIterator[OutgoingConnection]:
    """Connect to `url` for the length of the block; the endpoint that `accept` makes gets what arrives.

    The block goes on when the connection is lost: the endpoint's `closed` tells. Leaving the block closes
    with 1000 and waits up to ``limits.close_seconds`` for the other side.

    Args:
        url: ``ws://``, ``wss://``, ``tcp://``, ``tcps://`` with host and port, ``unix:///path``, or
            ``stdio:COMMAND`` to run a program and speak through its standard input and output.
        accept: makes the endpoint.
        limits: bounds of the connection.
        tls: how to check the server's certificate; by default against the system's authorities.
        headers: request headers, for the schemes that have them.
        timeout: seconds for all of it, from looking up the name to the end of the handshake.

    Raises:
        BadUrl: the URL is not one to connect to.
        ConnectError: there is no connection; says why.
    """
    target = parse_connect_url(url)
    context = (tls or ssl.create_default_context()) if target.scheme.tls else None
    chosen = Limits() if limits is None else limits
    outgoing = OutgoingConnection(
        target, ListenerState(accept, target.scheme.make_wire, chosen, None, target.name), headers or {}
    )
    async with background_tasks() as tasks:
        try:
            with anyio.move_on_after(timeout) as patience:
                await _open(outgoing, context, tasks)
                await outgoing.opened.wait()
            if patience.cancelled_caught:
                raise ConnectError(f"cannot connect to {url}: no answer within {timeout:g} s")
            if outgoing.error is not None:
                raise outgoing.error
            tasks.start_soon(_tick, outgoing.state)
            yield outgoing
        finally:
            with anyio.CancelScope(shield=True):
                await _close(outgoing.state, chosen.close_seconds)


async def _close(state: ListenerState, patience: float) -> None:
    state.close(1000, "")
    with anyio.move_on_after(patience):
        await state.emptied()
    state.abort()
    await state.emptied()


async def _tick(state: ListenerState) -> None:
    while True:
        state.tick(time.monotonic())
        await anyio.sleep(TICK_SECONDS)


_NO_TLS: Final = "it does not speak TLS there; is it ws:// or tcp://, without an s?"
_TLS_REASONS: Final = {
    "WRONG_VERSION_NUMBER": _NO_TLS,
    "RECORD_LAYER_FAILURE": _NO_TLS,
    "HTTP_REQUEST": _NO_TLS,
}
"""OpenSSL's names of what happens where something else than TLS answers."""


async def _open(outgoing: OutgoingConnection, tls: ssl.SSLContext | None, tasks: TaskGroup) -> None:
    """Reach the other side and set its bytes moving.

    Raises:
        ConnectError: nobody answers there.
    """
    target = outgoing.target
    try:
        if target.name == "stdio":
            tasks.start_soon(_serve_process, outgoing, await _start(target.path))
        elif target.host and _on_asyncio():
            loop = asyncio.get_running_loop()
            make_link = partial(client_link, outgoing.attach, loop)
            await loop.create_connection(make_link, target.host, target.port, ssl=tls)
        else:
            tasks.start_soon(serve_stream, outgoing.attach, await _stream(target, tls))
    except ssl.SSLError as error:
        reason = getattr(error, "verify_message", "") or _TLS_REASONS.get(error.reason or "", error.reason)
        reason = reason or "the handshake failed"
        raise ConnectError(f"cannot connect to {target} in TLS: {reason}") from error
    except OSError as error:
        raise ConnectError(f"cannot connect to {target}: {_why(error)}") from error


def _on_asyncio() -> bool:
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


async def _stream(target: ConnectUrl, tls: ssl.SSLContext | None) -> ByteStream:
    if target.name == "unix":
        return await anyio.connect_unix(target.path)
    if tls is None:
        return await anyio.connect_tcp(target.host, target.port)
    return await anyio.connect_tcp(
        target.host, target.port, ssl_context=tls, tls_standard_compatible=False, tls_hostname=target.host
    )


async def _start(command: str) -> Process:
    """The program, running; what it writes to standard error goes where ours goes."""
    return await anyio.open_process(shlex.split(command), stderr=None)


async def _serve_process(outgoing: OutgoingConnection, process: Process) -> None:
    """Speak with a program until the connection ends, and end the program with it."""
    async with process:
        if process.stdin is None or process.stdout is None:
            outgoing.fail(ConnectError(f"{outgoing.target} has no standard input and output"))
            return
        await serve_stream(outgoing.attach, StapledByteStream(process.stdin, process.stdout))


def _why(error: OSError) -> str:
    cause = error.__cause__
    number = error.errno or (cause.errno if isinstance(cause, OSError) else None)
    if number == errno.ECONNREFUSED:
        return "nobody listens there; is the server running?"
    if number == errno.ENOENT:
        return "there is no such file"
    if isinstance(error, socket.gaierror):
        return "the host is not known"
    return os.strerror(number) if number and number > 0 else "nobody listens there; is the server running?"
