"""Connections to a server: WebSocket, TCP and Unix sockets."""

from __future__ import annotations

import asyncio
import codecs
import os
import socket
import ssl
from collections.abc import Awaitable, Callable
from typing import Literal, Protocol, TypeAlias
from urllib.parse import urlsplit

from websockets.asyncio.client import connect
from websockets.asyncio.connection import Connection
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus, InvalidURI

MESSAGE_BYTES = 16 * 1024 * 1024
"""Maximum size of a received message."""

_READ_SIZE = 65536
_OPEN_SECONDS = 10.0

_CLOSE_SECONDS = 1.0
"""Timeout of the closing handshake in seconds; the connection is closed in any case."""


class WireError(Exception):
    """A connection cannot be opened; the text gives address and reason."""


def _why(error: Exception) -> str:
    """Return the reason of a failed connection, in the suite's words."""
    match error:
        case ConnectionRefusedError():
            return "the connection was refused"
        case TimeoutError():
            return f"no answer within {_OPEN_SECONDS:g} s"
        case InvalidStatus():
            return f"it answers with HTTP status {error.response.status_code} instead of a WebSocket"
        case InvalidHandshake() | InvalidURI():
            return "it does not speak WebSocket"
        case socket.gaierror():
            return "the host is not known"
        case ssl.SSLCertVerificationError():
            return f"its certificate is not trusted: {error.verify_message}"
        case ssl.SSLError():
            return "it does not speak TLS"
        case OSError(errno=int(number)):
            return os.strerror(number)
    # Several addresses: asyncio joins their errors, without an errno.
    return "the connection was refused"


class WireClosed(Exception):
    """The other side closed the connection.

    Attributes:
        code: code of the WebSocket close frame, 1006 without one; 0 on other wires.
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"closed with code {code}" if code else "closed")
        self.code = code


class Wire(Protocol):
    """Open connection."""

    async def send(self, data: str | bytes) -> None:
        """Send one message: text, or bytes as a binary frame. Raises WireClosed."""

    async def receive(self) -> str | bytes:
        """Return the next message. Raises WireClosed at the end."""

    async def close(self, *, abruptly: bool = False) -> None:
        """Close the connection, or cut it."""


Dial: TypeAlias = Callable[[str], Awaitable[Wire]]
"""Opens a connection to the server under test, for the tag of a case: a server that is a
program is started for each case, and further connections of the case reach the same one."""

Framing: TypeAlias = Literal["messages", "lines", "stream"]


def framing_of(url: str) -> Framing:
    """Return how a wire delimits messages: by frames, by line breaks, or not at all."""
    scheme = urlsplit(url).scheme
    if scheme in ("ws", "wss", "webrtc+http", "webrtc+https"):
        return "messages"
    return "lines" if scheme == "stdio" else "stream"


class WebSocketWire:
    """WebSocket connection of either side."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    @classmethod
    async def open(cls, url: str) -> Wire:
        """Connect to a server. Raises WireError."""
        try:
            connection = await connect(
                url,
                max_size=MESSAGE_BYTES,
                ping_interval=None,
                compression=None,
                proxy=None,
                open_timeout=_OPEN_SECONDS,
                close_timeout=_CLOSE_SECONDS,
            )
        except (OSError, InvalidHandshake, InvalidURI, TimeoutError) as error:
            raise WireError(f"{url}: cannot connect: {_why(error)}") from error
        return cls(connection)

    async def send(self, data: str | bytes) -> None:
        """Send one message: text, or bytes as a binary frame. Raises WireClosed."""
        try:
            await self._connection.send(data)
        except ConnectionClosed as error:
            raise WireClosed(error.rcvd.code if error.rcvd else 1006) from error

    async def receive(self) -> str | bytes:
        """Return the next message. Raises WireClosed at the end."""
        try:
            return await self._connection.recv()
        except ConnectionClosed as error:
            raise WireClosed(error.rcvd.code if error.rcvd else 1006) from error

    async def close(self, *, abruptly: bool = False) -> None:
        """Close the connection, or cut it."""
        if abruptly:
            self._connection.transport.abort()
        await self._connection.close()


class JsonCutter:
    """Splitter of a stream of characters into JSON objects, by braces outside strings (TCP-01)."""

    def __init__(self) -> None:
        self._text = ""
        self._at = 0
        self._depth = 0
        self._start = 0
        self._quoted = False
        self._escaped = False

    @property
    def pending(self) -> int:
        """Number of characters of an incomplete object."""
        return len(self._text)

    def feed(self, text: str) -> list[str]:
        """Return the objects that end in this piece."""
        self._text += text
        objects: list[str] = []
        while self._at < len(self._text):
            if self._step(self._text[self._at]):
                objects.append(self._text[self._start : self._at + 1])
                self._text = self._text[self._at + 1 :]
                self._at = -1
            self._at += 1
        return objects

    def _step(self, character: str) -> bool:
        if self._escaped:
            self._escaped = False
        elif self._quoted:
            self._escaped = character == "\\"
            self._quoted = character != '"'
        elif character == '"':
            self._quoted = self._depth > 0
        elif character == "{":
            self._start = self._at if self._depth == 0 else self._start
            self._depth += 1
        elif character == "}" and self._depth:
            self._depth -= 1
            return self._depth == 0
        return False


class StreamWire:
    """Connection with JSON objects on a byte stream."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._cutter = JsonCutter()
        self._ready: list[str] = []

    @classmethod
    async def open(
        cls, url: str, how: Callable[[], Awaitable[tuple[asyncio.StreamReader, asyncio.StreamWriter]]]
    ) -> Wire:
        """Connect to a server. Raises WireError."""
        try:
            async with asyncio.timeout(_OPEN_SECONDS):
                return cls(*await how())
        except (OSError, TimeoutError) as error:
            raise WireError(f"{url}: cannot connect: {_why(error)}") from error

    async def send(self, data: str | bytes) -> None:
        """Send one message as its bytes. Raises WireClosed."""
        try:
            self._writer.write(data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data)
            await self._writer.drain()
        except OSError as error:
            raise WireClosed(0) from error

    async def receive(self) -> str | bytes:
        """Return the next object. Raises WireClosed at the end."""
        while not self._ready:
            try:
                data = await self._reader.read(_READ_SIZE)
            except OSError as error:
                raise WireClosed(0) from error
            if not data:
                raise WireClosed(0)
            self._ready += self._cutter.feed(self._decoder.decode(data))
            if self._cutter.pending > MESSAGE_BYTES:
                await self.close(abruptly=True)
                raise WireClosed(0)
        return self._ready.pop(0)

    async def close(self, *, abruptly: bool = False) -> None:
        """Close the connection, or cut it."""
        if abruptly:
            self._writer.transport.abort()
        self._writer.close()
        try:
            await self._writer.wait_closed()
        except OSError:
            return  # The peer closed it first.
