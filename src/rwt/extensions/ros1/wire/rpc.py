"""XML-RPC over HTTP: calls of other programs, and connections of callers."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from itertools import chain
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

import anyio
import anyio.lowlevel
import h11

from rwt.extensions.ros1.wire import xmlrpc
from rwt.extensions.ros1.wire.sockets import Frame, Stream
from rwt_graph.errors import Ros1Error, WireError

if TYPE_CHECKING:
    from rwt.extensions.ros1.wire.sockets import Sockets

#: Timeout of a call in seconds: nodes that were stopped still accept connections.
CALL_SECONDS: Final = 5.0

#: Seconds after which a connection without requests is closed.
IDLE_SECONDS: Final = 60.0

#: Maximum open connections of one node, and bytes of calls that are being received by all nodes.
_MOST_CONNECTIONS: Final = 64
_MOST_RECEIVED: Final = 2 * xmlrpc.BODY_BYTES

#: Maximum bytes of a call or response that is sent, and long responses of one node that are made at once.
_MOST_SENT: Final = 4 * xmlrpc.BODY_BYTES
_MOST_RESPONSES: Final = 4

_READ_BYTES: Final = 65536

#: Work of encoding a call or response at once: characters, and how many each text costs besides its own.
_PART_COST: Final = 256 * 1024
_TEXT_COST: Final = 100

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
    return await value_of(uri, method, await fetch(uri, method, *params))


async def value_of(uri: str, method: str, body: bytes) -> xmlrpc.Value:
    """Return the value of a response; raises Ros1Error."""
    try:
        decoder = xmlrpc.Decoder()
        for part in xmlrpc.parts_of(body):
            decoder.feed(part)
            if len(body) > len(part):
                await anyio.lowlevel.checkpoint()
        match decoder.response():
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
        with anyio.fail_after(CALL_SECONDS):
            content = await _joined(_in_parts(xmlrpc.encode_call(method, params)))
            async with await anyio.connect_tcp(host, port) as stream:
                return await _exchange(stream, f"{host}:{port}", content)
    except TimeoutError as error:
        raise Ros1Error(f"{uri} does not answer {method} within {CALL_SECONDS:g} s") from error
    except (OSError, anyio.BrokenResourceError, h11.RemoteProtocolError, WireError) as error:
        raise Ros1Error(f"{uri} cannot be reached: {error}") from error


def _in_parts(texts: Iterator[str]) -> Iterator[str]:
    """Join texts to some that take a few milliseconds each."""
    part: list[str] = []
    size = 0
    for text in texts:
        part.append(text)
        size += len(text) + _TEXT_COST
        if size > _PART_COST:
            yield "".join(part)
            part, size = [], 0
    yield "".join(part)


async def _joined(parts: Iterator[str]) -> bytes:
    """Return the bytes of parts, between which the event loop goes on; raises WireError for too many."""
    found: list[bytes] = []
    size = 0
    for part in parts:
        if found:
            await anyio.lowlevel.checkpoint()
        found.append(part.encode())
        size += len(found[-1])
        if size > _MOST_SENT:
            raise WireError(f"XML-RPC of more than {_MOST_SENT} bytes is not sent")
    return b"".join(found)


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
        self.dispatch = dispatch
        self.responses = anyio.CapacityLimiter(_MOST_RESPONSES)
        # In the order of their last calls.
        self._connections: dict[_RpcConnection, None] = {}
        self._listener = sockets.listen(host, self._accept, port)
        self.port = self._listener.port

    def _accept(self, accepted: socket.socket, _peer: str) -> None:
        if len(self._connections) >= _MOST_CONNECTIONS:
            # Whoever keeps connections open without calls cannot keep others out.
            next(iter(self._connections)).close("crowded out")
        self._connections[_RpcConnection(self, self._sockets, accepted)] = None

    def answered(self, connection: _RpcConnection) -> None:
        """Note that a connection is in use."""
        if connection in self._connections:
            self._connections[connection] = self._connections.pop(connection)

    def left(self, connection: _RpcConnection) -> None:
        """Remove a closed connection."""
        self._connections.pop(connection, None)

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
    """Connection of one caller. A call is decoded as it arrives."""

    def __init__(self, server: RpcServer, sockets: Sockets, accepted: socket.socket) -> None:
        self._server = server
        self._sockets = sockets
        self._http = h11.Connection(h11.SERVER)
        self._decoder: xmlrpc.Decoder | None = None
        self._error = ""
        # Set when a request is complete, so that a slow drip ends, too.
        self.last_used = time.monotonic()
        self._stream = Stream(sockets, accepted, self._on_data, self.close)

    def _on_data(self, data: bytes) -> None:
        self._http.receive_data(data)
        while True:
            try:
                event = self._http.next_event()
            except h11.RemoteProtocolError as error:
                raise WireError(str(error)) from error
            if event is h11.NEED_DATA or event is h11.PAUSED:
                return
            if isinstance(event, h11.Request):
                if any(name == b"transfer-encoding" for name, _ in event.headers):
                    raise WireError("calls in chunks are not supported")
            elif isinstance(event, h11.Data):
                self._decode(bytes(event.data))
            elif isinstance(event, h11.EndOfMessage):
                self._answer()
            elif isinstance(event, h11.ConnectionClosed):
                self.close("closed")
                return

    def _decode(self, data: bytes) -> None:
        decoder = self._decoder = self._decoder or xmlrpc.Decoder()
        self._sockets.calling += len(data)
        if self._error:
            decoder.size += len(data)
            if decoder.size > xmlrpc.BODY_BYTES:
                raise WireError(self._error)
            return
        try:
            if self._sockets.calling > _MOST_RECEIVED:
                raise WireError("too many large calls are being received")
            decoder.feed(data)
        except WireError as error:
            self._error = str(error)

    def _answer(self) -> None:
        decoder, error = self._decoder or xmlrpc.Decoder(), self._error
        self._forget()
        try:
            if error:
                raise WireError(error)
            method, params = decoder.call()
            if method == "system.multicall":
                results = xmlrpc.encode_results(self._results(params))
                self._respond_later(chain.from_iterable(map(_in_parts, results)), decoder.size)
                return
            parts = _in_parts(xmlrpc.encode_response(self._server.dispatch(method, params)))
            first, second = next(parts), next(parts, None)
        except WireError as failure:
            self._respond(xmlrpc.encode_fault(str(failure)))
            return
        if second is None:
            self._respond(first.encode())
        else:
            self._respond_later(chain((first, second), parts), 0)

    def _results(self, params: tuple[xmlrpc.Value, ...]) -> Iterator[xmlrpc.Value | WireError]:
        """Carry out the calls of a `system.multicall`, one at a time."""
        match params:
            case [list(calls)]:
                for call in calls:
                    match call:
                        case {"methodName": str(method), "params": list(given)}:
                            try:
                                yield self._server.dispatch(method, tuple(given))
                            except WireError as error:
                                yield error
                        case _:
                            yield WireError("malformed call")
            case _:
                raise WireError("the parameter of system.multicall is a list of calls")

    def _respond_later(self, parts: Iterator[str], size: int) -> None:
        """Respond when all parts are known; the call, of some bytes, counts as being received until then."""

        async def respond() -> None:
            try:
                async with self._server.responses:
                    content = await _joined(parts)
            except WireError as error:
                content = xmlrpc.encode_fault(str(error))
            finally:
                self._sockets.calling -= size
            if not self._stream.closed:
                self._respond(content, ("Connection", "close"))

        self._sockets.calling += size
        self._sockets.spawn(respond, "a long response on ROS 1")

    def _respond(self, content: bytes, *more: tuple[str, str]) -> None:
        self.last_used = time.monotonic()
        self._server.answered(self)
        headers = [("Content-Type", "text/xml"), ("Content-Length", str(len(content))), *more]
        head = self._http.send(h11.Response(status_code=200, headers=headers)) or b""
        self._http.send(h11.Data(content))
        self._http.send(h11.EndOfMessage())
        self._stream.send(Frame((head, content)))
        if self._http.our_state is h11.MUST_CLOSE:
            self._server.left(self)
            self._stream.finish()
        else:
            self._http.start_next_cycle()

    def _forget(self) -> None:
        if self._decoder is not None:
            self._sockets.calling -= self._decoder.size
        self._decoder, self._error = None, ""

    def close(self, _reason: str) -> None:
        self._forget()
        self._server.left(self)
        self._stream.close()
