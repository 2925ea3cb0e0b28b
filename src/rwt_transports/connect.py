"""Opening a connection: the counterpart of :func:`rwt_transports.listener.listen`, over the same schemes."""

from __future__ import annotations

import errno
import os
import socket
import ssl
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field, replace
from typing import Final

import anyio
from websockets.uri import WebSocketURI

from rwt_protocol.frames import Buffer
from rwt_transports.api import Connector, FindsPath, Link, UnbufferedCallbacks
from rwt_transports.background import background_tasks
from rwt_transports.connection import Connection, ListenerState
from rwt_transports.endpoint import Accept
from rwt_transports.errors import ConnectCause, ConnectError, TransportError
from rwt_transports.limits import Limits
from rwt_transports.scheduler import REQUESTS, Scheduler
from rwt_transports.schemes import ConnectUrl, parse_connect_url
from rwt_transports.websocket.client_handshake import ClientHandshake
from rwt_transports.wires.receive_buffer import ReceiveBufferPool


@dataclass(slots=True, eq=False)
class OutgoingConnection:
    """Outgoing connection. `opened` is set once messages can be sent, or once it has failed."""

    target: ConnectUrl
    state: ListenerState
    headers: Mapping[str, str]
    opened: anyio.Event = field(default_factory=anyio.Event)
    error: TransportError | None = None
    connection: Connection | None = None
    connector: Connector | None = None
    _draining: anyio.Event | None = None

    @property
    def path(self) -> str:
        """Description of the path that was found to the server; empty if the address determines it."""
        return self.connector.path if isinstance(self.connector, FindsPath) else ""

    def attach(self, link: Link, address: str, port: int) -> None:
        """Begin the handshake or the connection. Called by a driver once bytes can flow."""
        if self.target.scheme.http:
            link.set_callbacks(_Handshaking(self, link, address, port))
        else:
            self.begin(link, address, port)

    def begin(self, link: Link, address: str, port: int) -> Connection:
        self.connection = Connection(self.state, link, address, port)
        self.state.add(self.connection, link)
        self.opened.set()
        return self.connection

    def fail(self, error: TransportError) -> None:
        if not self.opened.is_set():
            self.error = error
            self.opened.set()

    def close(self, code: int, reason: str) -> None:
        self.state.close(code, reason)

    def abort(self) -> None:
        """Cut the connection: the other side is not told."""
        if self.connection is not None:
            self.connection.abort()

    async def ended(self) -> None:
        await self.state.ended.wait()

    async def drained(self) -> None:
        """Wait until everything sent so far was handed to the network.

        The wait has no end if the connection is lost meanwhile: watch for the endpoint's `closed`, too.
        """
        # A lost connection never calls back, so there would be nothing to wait for.
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


class _Handshaking(UnbufferedCallbacks):
    """Callbacks of a link until the server has accepted the handshake; then the connection takes over."""

    def __init__(self, outgoing: OutgoingConnection, link: Link, address: str, port: int) -> None:
        self._outgoing = outgoing
        self._link = link
        self._address = address
        self._port = port
        target = outgoing.target
        path, _, query = target.path.partition("?")
        uri = WebSocketURI(target.scheme.tls, target.address.host, target.address.port, path, query)
        self._handshake = ClientHandshake(uri, outgoing.headers)
        self._request: Sequence[Buffer] = (self._handshake.request,)
        # Only asks for a later take(): the link has these callbacks once the constructor has returned.
        link.wake()

    def receive(self, data: bytes) -> None:
        try:
            rest = self._handshake.feed(data)
        except TransportError as error:
            self._outgoing.fail(error)
            self._link.abort()
            return
        if rest is not None:
            connection = self._outgoing.begin(self._link, self._address, self._port)
            if rest:
                connection.receive(rest)

    def take(self, limit: int = 0, /) -> tuple[Sequence[Buffer], bool]:
        request, self._request = self._request, ()
        return request, False

    def put_back(self, pieces: Sequence[Buffer]) -> None:
        self._request = pieces

    def eof(self) -> None:
        try:
            self._handshake.eof()
        except TransportError as error:
            self._outgoing.fail(error)
        self._link.abort()

    def lost(self) -> None:
        address = self._outgoing.target.address
        self._outgoing.fail(ConnectError(f"{address} hung up before the connection was open", "hung_up"))


@asynccontextmanager
async def connect(
    url: str,
    accept: Accept,
    *,
    limits: Limits | None = None,
    buffers: ReceiveBufferPool | None = None,
    tls: ssl.SSLContext | None = None,
    headers: Mapping[str, str] | None = None,
    timeout: float = 10.0,  # noqa: ASYNC109 - a timeout raises an error of this package
    ice_servers: Sequence[Mapping[str, str]] | None = None,
) -> AsyncIterator[OutgoingConnection]:
    """Connect to `url` for the length of the block; the endpoint that `accept` makes gets what arrives.

    The block goes on when the connection is lost, which calls the endpoint's `closed`. Leaving the block
    closes with 1000 and waits up to ``limits.close_seconds`` for the other side.

    Args:
        url: where; :data:`rwt_transports.schemes.SCHEMES` lists the schemes. ``stdio:COMMAND`` runs a program
            and speaks through its standard input and output.
        accept: factory of the endpoint.
        limits: bounds of the connection.
        buffers: what large messages are received in, shared with other connections; of its own by default.
        tls: verification of the server's certificate; by default by the system's authorities.
        headers: request headers, for the schemes that have them.
        timeout: seconds for all of it, from looking up the name to the end of the handshake.
        ice_servers: STUN and TURN servers for WebRTC, each like ``{"urls": "turn:turn.example.org",
            "username": "…", "credential": "…"}``; None asks those that the robot names.

    Raises:
        BadUrl: the URL is not one to connect to.
        ConnectError: the connection could not be opened; the text gives the reason.
    """
    target = parse_connect_url(url)
    context = (tls or ssl.create_default_context()) if target.scheme.tls else None
    chosen = limits or Limits()
    pool = buffers or chosen.receive_pool()
    state = ListenerState(
        accept,
        target.client_wire,
        chosen,
        None,
        target.name,
        single=True,
        requests=Scheduler.of_loop(REQUESTS),
        buffers=pool,
    )
    outgoing = OutgoingConnection(target, state, headers or {})
    async with background_tasks() as tasks:
        try:
            with anyio.move_on_after(timeout) as patience:
                address = replace(
                    target.address,
                    tls=context,
                    target=target.path,
                    headers=outgoing.headers,
                    limits=chosen,
                    is_held_back=pool.has_much_unread,
                    seconds=timeout,
                    ice_servers=ice_servers,
                )
                outgoing.connector = target.scheme.connector()
                with explained(target):
                    await outgoing.connector.connect(address, outgoing.attach, tasks)
                await outgoing.opened.wait()
            if patience.cancelled_caught:
                raise ConnectError(f"cannot connect to {url}: no answer within {timeout:g} s")
            if outgoing.error is not None:
                raise outgoing.error
            # Not before: the timeout of this function covers the handshake, and the ticks what follows it.
            tasks.start_soon(state.watch)
            yield outgoing
        finally:
            await state.end(1000, "")


@contextmanager
def explained(target: ConnectUrl) -> Iterator[None]:
    """Convert an OSError of the block into a ConnectError with the reason in one line."""
    try:
        yield
    except OSError as error:
        raise _explained(target, error) from error


_NO_TLS: Final = "it does not speak TLS there; is it ws:// or tcp://, without an s?"
_TLS_REASONS: Final = {
    "WRONG_VERSION_NUMBER": _NO_TLS,
    "RECORD_LAYER_FAILURE": _NO_TLS,
    "HTTP_REQUEST": _NO_TLS,
}
"""OpenSSL's reasons of errors when the peer does not use TLS."""


def _explained(target: ConnectUrl, error: OSError) -> ConnectError:
    if isinstance(error, ssl.SSLError):
        reason = getattr(error, "verify_message", "") or _TLS_REASONS.get(error.reason or "", error.reason)
        text = f"cannot connect to {target.address} in TLS: {reason or 'the handshake failed'}"
        is_expired = "expired" in reason or "not yet valid" in reason if reason else False
        return ConnectError(text, "no_tls" if reason == _NO_TLS else "expired" if is_expired else "tls")
    original = error.__cause__
    number = error.errno or (original.errno if isinstance(original, OSError) else None)
    cause: ConnectCause = "other"
    if number == errno.ENOENT:
        reason, cause = "there is no such file", "refused"
    elif isinstance(error, socket.gaierror):
        reason, cause = "the host is not known", "unknown_host"
    elif number == errno.ECONNREFUSED or not number or number < 0:
        reason, cause = "the connection was refused; is the server running?", "refused"
    else:
        reason, cause = os.strerror(number), "permission" if number == errno.EACCES else "other"
    return ConnectError(f"cannot connect to {target.address}: {reason}", cause)
