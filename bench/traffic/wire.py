"""The client half of WebSocket, as cheap as Python can make it: the load must never be the bottleneck.

Frames are masked before the clock starts wherever their text is known by then; incoming small frames of one
length are counted by comparing every header at once, large ones by arithmetic, and no payload is looked at.
"""

from __future__ import annotations

import base64
import contextlib
import os
import selectors
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Iterable

FIN = 0x80
TEXT, BINARY, CLOSE, PING, PONG = 0x1, 0x2, 0x8, 0x9, 0xA
CHUNK = 1 << 20
CONNECT_SECONDS = 10.0
CLOSE_SECONDS = 1.0


class ConnectionLost(Exception):
    """The server closed a connection, refused it, or sent something that is not WebSocket."""


def masked(payload: bytes, opcode: int = TEXT) -> bytes:
    """One frame from a client, RFC 6455 section 5.2, masked with a fresh key."""
    size = len(payload)
    if size < 126:
        head = bytes((FIN | opcode, 0x80 | size))
    elif size < 1 << 16:
        head = bytes((FIN | opcode, 0xFE)) + size.to_bytes(2, "big")
    else:
        head = bytes((FIN | opcode, 0xFF)) + size.to_bytes(8, "big")
    key = os.urandom(4)
    keys = (key * (size // 4 + 1))[:size]
    body = int.from_bytes(payload, "little") ^ int.from_bytes(keys, "little")
    return head + key + body.to_bytes(size, "little")


class FrameCounter:
    """Counts the data frames of a byte stream; keeps their payloads only if asked to."""

    def __init__(self, on_control: Callable[[int, bytes], None]) -> None:
        self.count = 0
        self.keep: list[bytes] | None = None
        self._on_control = on_control
        self._rest = b""
        self._skip = 0
        self._pattern = b""
        self._stride = 0

    def feed(self, data: bytearray, end: int) -> None:
        """Take `data[:end]`."""
        if self._skip:  # Of a message that began before any were kept.
            if end < self._skip:
                self._skip -= end
                return
            self.count += 1
            position, self._skip = self._skip, 0
        elif self._rest:
            data = bytearray(self._rest) + data[:end]
            position, end, self._rest = 0, len(data), b""
        else:
            position = 0
        if self.keep is None and self._stride:
            position = self._count_alike(data, position, end)
        self._walk(data, position, end)

    def _count_alike(self, data: bytearray, position: int, end: int) -> int:
        """Count as many frames with the last frame's header as follow one another; return where they end."""
        stride = self._stride
        many = (end - position) // stride
        stop = position + many * stride
        for offset, byte in enumerate(self._pattern):
            if data[position + offset : stop : stride].count(byte) != many:
                return position
        self.count += many
        return stop

    def _walk(self, data: bytearray, position: int, end: int) -> None:
        while position + 2 <= end:
            size = data[position + 1]
            body = position + 2
            if size == 126:
                body = position + 4
                size = int.from_bytes(data[position + 2 : body], "big")
            elif size == 127:
                body = position + 10
                size = int.from_bytes(data[position + 2 : body], "big")
            if body > end:
                break
            after = body + size
            opcode = data[position] & 0x0F
            if not data[position] & FIN:
                raise ConnectionLost("the server sent a message in pieces, which the load cannot count")
            if opcode >= CLOSE or self.keep is not None:
                if after > end:
                    break
                self._deliver(opcode, bytes(data[body:after]))
            elif after > end:
                self._skip = after - end
                return
            else:
                self.count += 1
                self._pattern = bytes(data[position:body])
                self._stride = after - position
            position = after
        self._rest = bytes(data[position:end])

    def _deliver(self, opcode: int, payload: bytes) -> None:
        if opcode >= CLOSE:
            self._on_control(opcode, payload)
            return
        self.count += 1
        if self.keep is not None:
            self.keep.append(payload)


class Connection:
    """One WebSocket connection of the load. Nothing here blocks after the handshake."""

    def __init__(
        self,
        loop: Loop,
        host: str,
        port: int,
        receive_buffer: int = 0,
        subprotocol: str = "",
        extension: str = "",
    ) -> None:
        self._loop = loop
        self._socket = _connected(host, port, receive_buffer)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._counter = FrameCounter(self._on_control)
        self._unsent: deque[memoryview] = deque()
        self.on_data: Callable[[], None] | None = None
        self._handshake(host, port, subprotocol, extension)
        self._socket.setblocking(False)
        loop.add(self._socket, self)

    def _handshake(self, host: str, port: int, subprotocol: str, extension: str) -> None:
        key = base64.b64encode(os.urandom(16)).decode()
        wanted = f"Sec-WebSocket-Protocol: {subprotocol}\r\n" if subprotocol else ""
        wanted += f"Sec-WebSocket-Extensions: {extension}\r\n" if extension else ""
        self._socket.sendall(
            f"GET / HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n{wanted}\r\n".encode()
        )
        answer = b""
        while b"\r\n\r\n" not in answer:
            if not (data := self._socket.recv(4096)):
                raise ConnectionLost("the server closed the connection during the handshake")
            answer += data
        head, _, rest = answer.partition(b"\r\n\r\n")
        if not head.startswith(b"HTTP/1.1 101"):
            raise ConnectionLost(f"the server refused the handshake: {head.splitlines()[0].decode()}")
        self._counter.feed(bytearray(rest), len(rest))

    @property
    def received(self) -> int:
        """Messages received so far."""
        return self._counter.count

    def has(self, count: int) -> bool:
        """True if that many messages have arrived."""
        return self._counter.count >= count

    @property
    def writable(self) -> bool:
        """True if everything sent so far is in the kernel."""
        return not self._unsent

    def keep_messages(self) -> list[bytes]:
        """From now on put each message into the list returned. Call it between messages only."""
        kept: list[bytes] = []
        self._counter.keep = kept
        return kept

    def forget_messages(self) -> None:
        """Count messages without looking at them. Call it between messages only."""
        self._counter.keep = None

    def send(self, data: bytes) -> None:
        """Send frames made by `masked`; what the kernel does not take now goes out when it can."""
        if self._unsent:
            self._unsent.append(memoryview(data))
            return
        sent = self._try_send(data)
        if sent < len(data):
            self._unsent.append(memoryview(data)[sent:])
            self._loop.watch_writes(self._socket, self, True)

    def _try_send(self, data: bytes | memoryview) -> int:
        try:
            return self._socket.send(data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise ConnectionLost(f"sending failed: {error.strerror}") from error

    def write_ready(self) -> None:
        while self._unsent:
            data = self._unsent.popleft()
            sent = self._try_send(data)
            if sent < len(data):
                self._unsent.appendleft(data[sent:])
                return
        self._loop.watch_writes(self._socket, self, False)

    def read_ready(self, buffer: bytearray) -> None:
        try:
            size = self._socket.recv_into(buffer)
        except OSError as error:
            raise ConnectionLost(f"receiving failed: {error.strerror}") from error
        if not size:
            raise ConnectionLost("the server closed a connection")
        self._counter.feed(buffer, size)
        if self.on_data is not None:
            self.on_data()

    def read_pending(self, buffer: bytearray) -> None:
        """Read what there is, if there is something."""
        try:
            self._counter.feed(buffer, self._socket.recv_into(buffer))
        except BlockingIOError:
            return

    def _on_control(self, opcode: int, payload: bytes) -> None:
        if opcode == CLOSE:
            code, reason = int.from_bytes(payload[:2], "big"), payload[2:].decode()
            raise ConnectionLost(f"the server closed a connection with code {code}: {reason}")
        if opcode == PING:
            self.send(masked(payload, PONG))

    def stop_reading(self) -> None:
        """From now on be a client that has stopped dead: connected, and nothing more."""
        self._loop.remove(self._socket)

    def read_again(self) -> None:
        """Be alive again after `stop_reading`."""
        self._loop.add(self._socket, self)

    def drop(self, *, reset: bool) -> None:
        """Be gone at once: as a program that ended, or with a reset, as one whose unread data was lost."""
        self._loop.remove(self._socket)
        if reset:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._socket.close()

    def close(self) -> None:
        """Say goodbye and wait a little for the server to do the same."""
        self._loop.remove(self._socket)
        with self._socket, contextlib.suppress(OSError):
            self._socket.settimeout(CLOSE_SECONDS)
            if self.writable:
                self._socket.sendall(masked((1000).to_bytes(2, "big"), CLOSE))
                while self._socket.recv(CHUNK):
                    pass


def _connected(host: str, port: int, receive_buffer: int) -> socket.socket:
    """A connected socket; `receive_buffer` bounds what the kernel takes for a client that does not read, and
    must be set before it connects. 0 leaves it to the kernel."""
    family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    made = socket.socket(family, kind, protocol)
    try:
        if receive_buffer:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        made.settimeout(CONNECT_SECONDS)
        made.connect(address)
    except OSError:
        made.close()
        raise
    return made


class Loop:
    """Reads and writes whichever connections are ready, until somebody is satisfied.

    Attributes:
        nap: seconds to sleep before each look at the connections.
    """

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._buffer = bytearray(CHUNK)
        self.nap = 0.0

    def add(self, sock: socket.socket, connection: Connection) -> None:
        self._selector.register(sock, selectors.EVENT_READ, connection)

    def watch_writes(self, sock: socket.socket, connection: Connection, wanted: bool) -> None:
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if wanted else 0)
        self._selector.modify(sock, events, connection)

    def remove(self, sock: socket.socket) -> None:
        self._selector.unregister(sock)

    def turn(self, timeout: float) -> bool:
        """Wait up to `timeout` seconds, serve what is ready; False if nothing was."""
        if self.nap:
            time.sleep(self.nap)
        ready = self._selector.select(timeout)
        for key, events in ready:
            if events & selectors.EVENT_READ:
                key.data.read_ready(self._buffer)
            if events & selectors.EVENT_WRITE:
                key.data.write_ready()
        return bool(ready)

    def sweep(self, connections: Iterable[Connection]) -> None:
        """Read what has come for connections that `stop_reading`, one after the other and without polling."""
        for connection in connections:
            connection.read_pending(self._buffer)

    def until(self, satisfied: Callable[[], bool], seconds: float) -> bool:
        """Turn until `satisfied()` or for that long; whether it was satisfied."""
        deadline = time.monotonic() + seconds
        while not satisfied():
            left = deadline - time.monotonic()
            if left <= 0:
                return False
            self.turn(left)
        return True

    def settle(self, quiet: float = 0.05) -> None:
        """Turn until nothing has arrived for `quiet` seconds."""
        while self.turn(quiet):
            pass

    def close(self) -> None:
        self._selector.close()
