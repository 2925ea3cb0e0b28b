"""Sockets on the graph's event loop, asyncio's or trio's: listeners, and streams with a bounded queue.

Data is read by a callback of the event loop: a task per message would cost more than the message.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import socket
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Final, Protocol

import anyio
import anyio.lowlevel

from rwt.extensions.ros1.wire.tcpros import ReceiveBuffers
from rwt_graph.errors import WireError

if TYPE_CHECKING:
    from rwt_graph.backend import DistributedGraph

logger = logging.getLogger(__name__)

#: False on Windows.
_HAS_SENDMSG: Final = hasattr(socket.socket, "sendmsg")

#: Bytes that are read at once, except of frames that are larger: what they hold is handled at once.
READ_BYTES: Final = 8 * 1024

#: Maximum reads of one socket in one turn of the event loop.
_READ_BATCH: Final = 4

#: Reason of a connection that the peer has closed.
PEER_CLOSED: Final = "the other program has closed the connection"

#: Maximum connections that are accepted in one turn of the event loop.
_ACCEPT_BATCH: Final = 16

#: Maximum bytes that wait for a slow reader, and for all of them, before the oldest frames are dropped.
QUEUE_BYTES: Final = 16 * 1024 * 1024
_ALL_QUEUES_BYTES: Final = 128 * 1024 * 1024

#: Seconds of one turn of the event loop for reading sockets and writing large frames; the last one comes on
#: top.
_TURN_SECONDS: Final = 0.01
_LARGE_WRITE_BYTES: Final = 64 * 1024

#: Options by which peers that disappear without a word are noticed within a minute: the last one while bytes
#: are unacknowledged, the others while the connection is idle. Windows and macOS lack some of them.
LOST_PEER_OPTIONS: Final = {
    "TCP_KEEPIDLE": 30,
    "TCP_KEEPINTVL": 10,
    "TCP_KEEPCNT": 3,
    "TCP_USER_TIMEOUT": 60_000,
}


class Sockets:
    """Callbacks of readable sockets.

    Attributes:
        spawn: starts a task on the graph's event loop.
        receiving: bytes of incomplete frames of all connections.
        calling: bytes of incomplete calls of all connections.
        is_full: True if the time of this turn of the event loop is used up.
        queued: bytes that wait for slow readers; `slow` is their number.
        buffers: receive buffers of all connections.
    """

    def __init__(self, graph: DistributedGraph) -> None:
        self.spawn = graph.spawn
        self._graph = graph
        self.receiving = self.calling = self.queued = self.slow = 0
        self.is_full = False
        self._used = 0.0
        self.buffers = ReceiveBuffers()
        self._calls: dict[socket.socket, Callable[[], None]] = {}
        try:
            self._loop: asyncio.AbstractEventLoop | None = asyncio.get_running_loop()
        except RuntimeError:
            self._loop = None  # On trio.

    def watch(self, sock: socket.socket, call: Callable[[], None]) -> None:
        """Call a function whenever a socket is readable."""
        self._calls[sock] = call
        if self._loop is not None:
            try:
                self._loop.add_reader(sock.fileno(), self._read, call)
                return
            except NotImplementedError:
                self._loop = None  # On Windows.
        self.spawn(partial(self._watch, sock, call), "a socket of ROS 1")

    def _read(self, call: Callable[[], None]) -> None:
        if self.is_full:
            return  # The socket is still readable in the next turn.
        began = time.monotonic()
        self._graph.in_batch(call)
        self._note(time.monotonic() - began)

    def _note(self, seconds: float) -> None:
        self._used += seconds
        if self._used > _TURN_SECONDS and not self.is_full and self._loop is not None:
            self.is_full = True
            self._loop.call_soon(self._begin_turn)

    def _begin_turn(self) -> None:
        self.is_full = False
        self._used = 0.0

    def write(self, sock: socket.socket, parts: tuple[bytes | memoryview, ...], size: int) -> int:
        """Write what a socket takes at once, and return the number of bytes; raises OSError."""
        if size < _LARGE_WRITE_BYTES:
            return _write(sock, parts)
        if self.is_full:
            return 0
        began = time.monotonic()
        try:
            return _write(sock, parts)
        finally:
            self._note(time.monotonic() - began)

    async def _watch(self, sock: socket.socket, call: Callable[[], None]) -> None:
        while sock in self._calls:
            try:
                await anyio.wait_readable(sock)
            except (anyio.ClosedResourceError, OSError):
                return
            if sock in self._calls:
                call()

    def close(self, sock: socket.socket) -> None:
        """Close a socket, watched or not."""
        if self._calls.pop(sock, None) is not None:
            if self._loop is not None:
                self._loop.remove_reader(sock.fileno())
            anyio.notify_closing(sock)
        sock.close()

    def listen(self, host: str, on_socket: Callable[[socket.socket, str], None], port: int = 0) -> Listener:
        """Accept connections.

        Args:
            on_socket: called with each connection and the address of its peer.

        Raises:
            OSError: the address cannot be used.
        """
        return Listener(self, host, port, on_socket)


class Listener:
    """Listening socket; `port` is the one it has got."""

    def __init__(
        self, sockets: Sockets, host: str, port: int, on_socket: Callable[[socket.socket, str], None]
    ) -> None:
        self._sockets = sockets
        self._on_socket = on_socket
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            if os.name == "posix":  # On Windows, the option lets two programs have one port.
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.bind((host, port))
            self._socket.listen(128)
        except BaseException:
            self._socket.close()
            raise
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        sockets.watch(self._socket, self._accept)

    def _accept(self) -> None:
        for _ in range(_ACCEPT_BATCH):
            try:
                accepted, address = self._socket.accept()
            except OSError:  # None is left, or its peer has gone, or too many files are open.
                return
            accepted.setblocking(False)
            self._on_socket(accepted, address[0])

    def close(self) -> None:
        """Accept no more connections."""
        self._sockets.close(self._socket)


async def connect(host: str, port: int) -> socket.socket:
    """Connect to a host.

    Raises:
        OSError: no address of the host accepts connections.
    """
    failure: OSError | None = None
    for family, kind, protocol, _, address in await anyio.getaddrinfo(host, port, type=socket.SOCK_STREAM):
        sock = socket.socket(family, kind, protocol)
        sock.setblocking(False)
        try:
            code = sock.connect_ex(address)
            if code in (errno.EINPROGRESS, errno.EWOULDBLOCK):
                await anyio.wait_writable(sock)
                code = sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if code:
                raise OSError(code, os.strerror(code))
        except OSError as error:
            sock.close()
            failure = error
            continue
        except BaseException:
            sock.close()
            raise
        return sock
    raise failure or OSError(f"{host} has no address")


class LargeFrame(Protocol):
    """Receiver of a large frame, into memory that it provides."""

    def space(self) -> memoryview:
        """Return memory for the next bytes; it is released after the read."""

    def filled(self, count: int) -> None:
        """Called after bytes were received into :meth:`space`."""


class Frame:
    """Bytes to send to several readers. Memory that may be used again is copied once if one is slow."""

    __slots__ = ("parts", "size")

    def __init__(self, parts: tuple[bytes | memoryview, ...]) -> None:
        self.parts = parts
        self.size = sum(map(len, parts))

    def keep(self) -> None:
        """Copy memory that may be used again once the sender has returned."""
        self.parts = tuple(map(bytes, self.parts))


class Stream:
    """TCP connection whose data is passed to a function.

    Frames wait in a queue while the peer does not read; beyond a limit, the oldest is dropped.

    Args:
        on_data: called with what was read; an exception closes the connection.
        on_close: called once with the reason, unless this side closes the connection.

    Attributes:
        dropped: number of dropped frames.
        large: receiver of what follows, within a large frame.
    """

    def __init__(
        self,
        sockets: Sockets,
        sock: socket.socket,
        on_data: Callable[[bytes], None],
        on_close: Callable[[str], None],
    ) -> None:
        self._sockets = sockets
        self._socket = sock
        self._on_data = on_data
        self._on_close = on_close
        self._queue: deque[Frame] = deque()
        self._queued = 0
        self._sent = 0  # bytes of the first frame
        self._finishing = False
        self.closed = False
        self.dropped = 0
        self.large: LargeFrame | None = None
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for option, value in LOST_PEER_OPTIONS.items():
            if hasattr(socket, option):
                sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        sockets.watch(sock, self._read)

    def _read(self) -> None:
        try:
            if self.large is None:
                data = self._socket.recv(READ_BYTES)
                if data:
                    self._on_data(data)
                else:
                    self._lost(PEER_CLOSED)
            for _ in range(_READ_BATCH):
                if self.large is None or self.closed or not self._read_large(self.large):
                    return
        except BlockingIOError:
            return
        except OSError as error:
            self._lost(str(error))
        except WireError as error:
            self._lost(str(error))
        except Exception as error:
            # Subscribers run in the callback: a fault of one ends this connection only.
            logger.exception("a connection of ROS 1 is closed")
            self._lost(str(error))

    def _read_large(self, large: LargeFrame) -> bool:
        """Read the rest of a large frame; returns True if more may be readable."""
        with large.space() as space:
            count, most = self._socket.recv_into(space), len(space)
        if not count:
            self._lost(PEER_CLOSED)
        else:
            large.filled(count)
        return count == most

    def send(self, frame: Frame) -> None:
        """Send a frame, at once if possible."""
        if self.closed:
            return
        sockets = self._sockets
        if not self._queue:
            self._sent = self._send_now(frame.parts, frame.size)
            if self._sent == frame.size or self.closed:
                return
            sockets.slow += 1
            sockets.spawn(self._flush, "a slow reader on ROS 1")
        frame.keep()
        self._queue.append(frame)
        self._count(frame.size)
        # The first frame may have been sent in part, and the last is the newest.
        most = min(QUEUE_BYTES, _ALL_QUEUES_BYTES // sockets.slow)
        while self._queued > most and len(self._queue) > 2:
            self._count(-self._queue[1].size)
            del self._queue[1]
            self.dropped += 1
        if self._queued > most and sockets.queued > _ALL_QUEUES_BYTES:
            self._lost("too many programs read too slowly")

    def _count(self, size: int) -> None:
        self._queued += size
        self._sockets.queued += size

    def _send_now(self, parts: tuple[bytes | memoryview, ...], size: int) -> int:
        try:
            return self._sockets.write(self._socket, parts, size)
        except BlockingIOError:
            return 0
        except OSError as error:
            self._lost(str(error))
            return 0

    async def _flush(self) -> None:
        while self._queue and not self.closed:
            try:
                await anyio.wait_writable(self._socket)
            except (anyio.ClosedResourceError, OSError):
                return
            while self._queue and not self.closed:
                if self._sockets.is_full:
                    await anyio.lowlevel.checkpoint()
                    continue
                frame = self._queue[0]
                left = frame.size - self._sent
                self._sent += self._send_now(_without(frame.parts, self._sent), left)
                if self._sent < frame.size:
                    break
                self._sent = 0
                self._count(-frame.size)
                self._queue.popleft()
        if not self.closed:
            self._sockets.slow -= 1
        if self._finishing:
            self.close()

    def finish(self) -> None:
        """Close the connection after what is queued."""
        if self._queue:
            self._finishing = True
        else:
            self.close()

    def _lost(self, reason: str) -> None:
        if not self.closed:
            self.close()
            self._on_close(reason)

    def close(self) -> None:
        """Close the connection; no-op if it is closed."""
        if not self.closed:
            self.closed = True
            if self._queue:
                self._sockets.slow -= 1
                self._count(-self._queued)
                self._queue.clear()
            self._sockets.close(self._socket)


def _write(sock: socket.socket, parts: tuple[bytes | memoryview, ...]) -> int:
    return sock.sendmsg(parts) if _HAS_SENDMSG else sock.send(b"".join(parts))


def _without(parts: tuple[bytes | memoryview, ...], count: int) -> tuple[memoryview, ...]:
    """Return parts without their first bytes."""
    left: list[memoryview] = []
    for part in parts:
        if count < len(part):
            left.append(memoryview(part)[count:])
        count = max(0, count - len(part))
    return tuple(left)
