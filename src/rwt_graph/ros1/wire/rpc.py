"""XML-RPC over HTTP: calls of other programs, and connections of callers."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

import anyio
import h11

from rwt_graph.errors import Ros1Error, WireError
from rwt_graph.ros1.wire import xmlrpc
from rwt_graph.ros1.wire.sockets import Stream

if TYPE_CHECKING:
    from rwt_graph.ros1.wire.sockets import Sockets

#: Timeout of a call in seconds: nodes that were stopped still accept connections.
CALL_SECONDS: Final = 5.0

#: Seconds after which a connection without requests is closed.
IDLE_SECONDS: Final = 60.0

#: Maximum open connections of one node, and maximum bytes of requests that are being received.
_MOST_CONNECTIONS: Final = 64
_MOST_RECEIVED: Final = 32 * 1024 * 1024

_READ_BYTES: Final = 65536

Dispatch = Callable[[str, tuple[xmlrpc.Value, ...]], xmlrpc.Value]
"""Answers a call; raises WireError if it does not fit."""


def address_of(uri: str, scheme: str = "http") -> tuple[str, int]:
    """Return host and port of a URI.

    Raises:
        WireError: it is not such a URI.
    """
    try:
        parts = urlsplit(uri)
        if parts.scheme == scheme and parts.hostname and parts.port:
            return parts.hostname, parts.port
    except ValueError:
        pass
    raise WireError(f"{uri[:200]!r} is not a URI like {scheme}://host:port")


async def call(uri: str, method: str, *params: xmlrpc.Value) -> xmlrpc.Value:
    """Call a method of a ROS 1 program and return its value, without the status.

    Raises:
        Ros1Error: it cannot be reached, does not answer in time, or refuses the call.
    """
    return value_of(uri, method, await fetch(uri, method, *params))


def value_of(uri: str, method: str, body: bytes) -> xmlrpc.Value:
    """Return the value of a response; raises Ros1Error."""
    try:
        match xmlrpc.decode_response(body):
            case [1, str(), value]:
                return value
            case [int(), str(text), *_]:
                raise Ros1Error(f"{uri} refuses {method}: {text[:500]}")
    except WireError as error:
        raise Ros1Error(f"{uri} does not answer {method}: {error}") from error
    raise Ros1Error(f"{uri} does not answer {method} as ROS 1 programs do")


async def fetch(uri: str, method: str, *params: xmlrpc.Value) -> bytes:
    """Call a method and return the body of the response; raises Ros1Error."""
    try:
        host, port = address_of(uri)
        content = xmlrpc.encode_call(method, params)
        with anyio.fail_after(CALL_SECONDS):
            async with await anyio.connect_tcp(host, port) as stream:
                return await _exchange(stream, f"{host}:{port}", content)
    except TimeoutError as error:
        raise Ros1Error(f"{uri} does not answer {method} within {CALL_SECONDS:g} s") from error
    except (OSError, anyio.BrokenResourceError, h11.RemoteProtocolError, WireError) as error:
        raise Ros1Error(f"{uri} cannot be reached: {error}") from error


async def _exchange(stream: anyio.abc.SocketStream, host: str, content: bytes) -> bytes:
    http = h11.Connection(h11.CLIENT)
    headers = [
        ("Host", host),
        ("Content-Type", "text/xml"),
        ("Content-Length", str(len(content))),
        ("Connection", "close"),
    ]
    head = http.send(h11.Request(method="POST", target="/RPC2", headers=headers)) or b""
    await stream.send(head + (http.send(h11.Data(content)) or b""))
    http.send(h11.EndOfMessage())
    body = bytearray()
    while True:
        match http.next_event():
            case h11.NEED_DATA:
                try:
                    received = await stream.receive(_READ_BYTES)
                except anyio.EndOfStream:
                    received = b""
                http.receive_data(received)
            case h11.Response(status_code=status) if status != 200:
                raise WireError(f"HTTP status {status}")
            case h11.Data(data=data):
                body += data
                if len(body) > xmlrpc.BODY_BYTES:
                    raise WireError(f"the response is larger than {xmlrpc.BODY_BYTES} bytes")
            case h11.EndOfMessage():
                return bytes(body)
            case h11.ConnectionClosed():
                raise WireError("the connection was closed")


class RpcServer:
    """Listening socket for calls.

    Args:
        host: address to bind.
        dispatch: answers the calls.
    """

    def __init__(self, sockets: Sockets, host: str, dispatch: Dispatch, port: int = 0) -> None:
        self._sockets = sockets
        self._dispatch = dispatch
        self._connections: set[_RpcConnection] = set()
        self._listener = sockets.listen(host, self._accept, port)
        self.port = self._listener.port

    def _accept(self, accepted: socket.socket, _peer: str) -> None:
        if len(self._connections) >= _MOST_CONNECTIONS:
            self.sweep()
        if len(self._connections) >= _MOST_CONNECTIONS:
            accepted.close()
            return
        self._connections.add(_RpcConnection(self, self._sockets, accepted))

    def answer(self, body: bytes) -> bytes:
        """Return the response to a call."""
        try:
            method, params = xmlrpc.decode_call(body)
            return xmlrpc.encode_response(self._dispatch(method, params))
        except WireError as error:
            return xmlrpc.encode_fault(str(error))

    def left(self, connection: _RpcConnection) -> None:
        """Remove a closed connection."""
        self._connections.discard(connection)

    def has_room(self) -> bool:
        """Return False if too much is being received."""
        return sum(len(each.body) for each in self._connections) < _MOST_RECEIVED

    def sweep(self) -> None:
        """Close idle connections."""
        before = time.monotonic() - IDLE_SECONDS
        for each in tuple(self._connections):
            if each.last_used < before:
                each.close("idle")

    def close(self) -> None:
        """Accept no more calls."""
        self._listener.close()
        for each in tuple(self._connections):
            each.close("closing")


class _RpcConnection:
    """Connection of one caller."""

    def __init__(self, server: RpcServer, sockets: Sockets, accepted: socket.socket) -> None:
        self._server = server
        self._http = h11.Connection(h11.SERVER)
        self.body = bytearray()
        # Set when a request is complete, so that a slow drip ends, too.
        self.last_used = time.monotonic()
        self._stream = Stream(sockets, accepted, self._on_data, self.close)

    def _on_data(self, data: bytes) -> None:
        self._http.receive_data(data)
        while True:
            event = self._http.next_event()
            if event is h11.NEED_DATA or event is h11.PAUSED:
                return
            if isinstance(event, h11.Data):
                self.body += event.data
                if len(self.body) > xmlrpc.BODY_BYTES or not self._server.has_room():
                    raise WireError("the request is too large")
            elif isinstance(event, h11.EndOfMessage):
                self._respond()
            elif isinstance(event, h11.ConnectionClosed):
                self.close("closed")
                return

    def _respond(self) -> None:
        content = self._server.answer(bytes(self.body))
        self.body.clear()
        self.last_used = time.monotonic()
        headers = [("Content-Type", "text/xml"), ("Content-Length", str(len(content)))]
        head = self._http.send(h11.Response(status_code=200, headers=headers)) or b""
        self._http.send(h11.Data(content))
        self._http.send(h11.EndOfMessage())
        self._stream.send((head, content))
        if self._http.our_state is h11.MUST_CLOSE:
            self._server.left(self)
            self._stream.finish()
        else:
            self._http.start_next_cycle()

    def close(self, _reason: str) -> None:
        self._server.left(self)
        self._stream.close()
