"""XML-RPC over HTTP: calls of other programs, and the server of their calls."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from contextlib import AbstractAsyncContextManager
from functools import partial
from itertools import chain, count
from typing import TYPE_CHECKING, Final, Never, TypeVar
from urllib.parse import urlsplit

import anyio
import h11

from rwt.extensions.ros1.wire import xmlrpc
from rwt.extensions.ros1.wire.network import Unreachable, listening
from rwt_graph.errors import Ros1Error, WireError
from rwt_transports.connection import ListenerState
from rwt_transports.errors import Refused
from rwt_transports.http.connection import HttpConnection
from rwt_transports.http.routes import HttpRequest, HttpResponse, Routes
from rwt_transports.limits import Limits
from rwt_transports.scheduler import REQUESTS, Scheduler
from rwt_transports.websocket.wire import WebSocketWire

if TYPE_CHECKING:
    from rwt.extensions.ros1.wire.network import Network
    from rwt_interfaces.steps import Steps
    from rwt_transports.api import Link

T = TypeVar("T")

#: Timeout of a call in seconds: nodes that were stopped still accept connections.
CALL_SECONDS: Final = 5.0

#: Seconds after which a connection without requests is closed.
IDLE_SECONDS: Final = 60.0

#: Maximum open connections of one node, and bytes of large calls that are answered at once by all nodes.
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
        match (await _in_turns(_decoded(body))).response():
            case [1, str(), value]:
                return value
            case [int(), str(text), *_]:
                raise Ros1Error(f"{uri} refuses {method}: {text[:500]}")
    except WireError as error:
        raise Ros1Error(f"{uri} does not answer {method}: {error}") from error
    raise Ros1Error(f"{uri} does not answer {method} as ROS 1 programs do")


def _decoded(body: bytes) -> Steps[xmlrpc.Decoder]:
    """Return a decoder that has read a call or response, in steps; raises WireError."""
    decoder = xmlrpc.Decoder()
    for at in range(0, len(body), xmlrpc.PART_BYTES):
        if at:
            yield
        decoder.feed(body[at : at + xmlrpc.PART_BYTES])
    return decoder


async def fetch(uri: str, method: str, *params: xmlrpc.Value) -> bytes:
    """Call a method and return the body of the response; raises Ros1Error."""
    try:
        host, port = address_of(uri)
        with anyio.fail_after(CALL_SECONDS):
            content = await _in_turns(_joined(_in_parts(xmlrpc.encode_call(method, params))))
            async with await anyio.connect_tcp(host, port) as stream:
                return await _exchange(stream, f"{host}:{port}", content)
    except TimeoutError as error:
        raise Ros1Error(f"{uri} does not answer {method} within {CALL_SECONDS:g} s") from error
    except ConnectionRefusedError as error:
        raise Unreachable(f"{uri} cannot be reached: {error}") from error
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


def _joined(parts: Iterator[str]) -> Steps[bytes]:
    """Return the bytes of parts, in steps; raises WireError for too many."""
    found: list[bytes] = []
    size = 0
    for part in parts:
        if found:
            yield
        found.append(part.encode())
        size += len(found[-1])
        if size > _MOST_SENT:
            raise WireError(f"XML-RPC of more than {_MOST_SENT} bytes is not sent")
    return b"".join(found)


async def _in_turns(steps: Steps[T]) -> T:
    """Take steps in turns of the event loop, as HTTP requests are read."""
    return await Scheduler.of_loop(REQUESTS).finish(steps)


async def _exchange(stream: anyio.abc.SocketStream, host: str, content: bytes) -> bytes:
    """Send a request and return the body of its response: the transports have no client for HTTP."""
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


class _RpcServer:
    """Calls of one node or master, over the HTTP of the transports, on every path.

    Small calls are answered at once. Larger ones are decoded in steps, as long responses are made.
    """

    def __init__(self, network: Network, dispatch: Dispatch) -> None:
        self._network = network
        self._dispatch = dispatch
        self._responses = anyio.CapacityLimiter(_MOST_RESPONSES)
        self._numbers = count()
        # Connections in the order of their last calls. A number stands for each in its routes, which would
        # be a reference cycle otherwise.
        self._connections: dict[int, HttpConnection] = {}
        limits = Limits(
            handshake_seconds=IDLE_SECONDS, idle_http_seconds=IDLE_SECONDS, http_body_bytes=xmlrpc.BODY_BYTES
        )
        self.state = ListenerState(_refuse, WebSocketWire, limits, None, "http", buffers=network.calls)

    def attach(self, link: Link, address: str, port: int) -> None:
        """Serve a new caller."""
        is_open = self.state.connections
        self._connections = {key: each for key, each in self._connections.items() if each in is_open}
        if len(self._connections) >= _MOST_CONNECTIONS:
            # Whoever keeps connections open without calls cannot keep others out.
            self._connections.pop(next(iter(self._connections))).abort()
        key = next(self._numbers)
        routes = Routes()
        routes.add("/*", partial(self._answer, key), "POST")
        connection = self._connections[key] = HttpConnection(routes, self.state, link, address, port)
        self.state.add(connection, link)

    def _answer(self, key: int, request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        if key in self._connections:
            self._connections[key] = self._connections.pop(key)
        if len(request.body) > xmlrpc.PART_BYTES:
            return self._answer_large(request.body)
        try:
            decoder = xmlrpc.Decoder()
            decoder.feed(request.body)
            parts = self._response(decoder)
            first, second = next(parts), next(parts, None)
        except WireError as error:
            return _fault(error)
        if second is None:
            return _xml(first.encode())
        return self._answer_long(chain((first, second), parts))

    async def _answer_large(self, body: bytes) -> HttpResponse:
        """Answer a call that takes some turns to decode."""
        network = self._network
        network.calling += len(body)
        try:
            if network.calling > _MOST_RECEIVED:
                raise WireError("too many large calls are being received")
            return await self._answer_long(self._response(await _in_turns(_decoded(body))))
        except WireError as error:
            return _fault(error)
        finally:
            network.calling -= len(body)

    async def _answer_long(self, parts: Iterator[str]) -> HttpResponse:
        """Answer when all parts of the response are known."""
        try:
            async with self._responses:
                return _xml(await _in_turns(_joined(parts)))
        except WireError as error:
            return _fault(error)

    def _response(self, decoder: xmlrpc.Decoder) -> Iterator[str]:
        """Carry out a call, and yield the parts of its response; raises WireError."""
        method, params = decoder.call()
        if method != "system.multicall":
            return _in_parts(xmlrpc.encode_response(self._dispatch(method, params)))
        return chain.from_iterable(map(_in_parts, xmlrpc.encode_results(self._results(params))))

    def _results(self, params: tuple[xmlrpc.Value, ...]) -> Iterator[xmlrpc.Value | WireError]:
        """Carry out the calls of a `system.multicall`, one at a time."""
        match params:
            case [list(calls)]:
                for call in calls:
                    match call:
                        case {"methodName": str(method), "params": list(given)}:
                            try:
                                yield self._dispatch(method, tuple(given))
                            except WireError as error:
                                yield error
                        case _:
                            yield WireError("malformed call")
            case _:
                raise WireError("the parameter of system.multicall is a list of calls")


def _refuse(*_: object) -> Never:
    raise Refused(404, "a node of ROS 1 has no WebSocket")


def _xml(content: bytes) -> HttpResponse:
    return HttpResponse(content, content_type="text/xml")


def _fault(error: WireError) -> HttpResponse:
    return _xml(xmlrpc.encode_fault(str(error)))


def serve(network: Network, host: str, dispatch: Dispatch, port: int = 0) -> AbstractAsyncContextManager[int]:
    """Answer the calls of other programs within the block, which gets the port.

    Args:
        host: address to bind; empty for all of this host.
        dispatch: answers the calls.
    """
    server = _RpcServer(network, dispatch)
    return listening(server.state, server.attach, host, port)
