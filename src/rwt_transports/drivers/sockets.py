"""Listening sockets, accepting connections, and error texts of addresses that are not available."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import select
import socket
import stat
import struct
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from typing import Final, TypeVar

import anyio
import anyio.lowlevel

from rwt_transports.api import OWNER_ONLY, BindAddress, Delivery, HangUp
from rwt_transports.errors import ListenError
from rwt_transports.http.addresses import holder_of
from rwt_transports.shared_pool import PoolRow, SharedPool

if sys.platform != "win32":
    import fcntl
    import termios

logger = logging.getLogger("rwt_transports")

Accepted = TypeVar("Accepted")

UNSENT_BYTES = 512 * 1024
"""Unsent bytes of one connection in the kernel, not counting those in flight. The default is megabytes, all
of which delay the newest sample to a slow peer."""
KEEPALIVE_SECONDS = 20
"""Silence after which the system probes the peer's machine, and interval of the probes."""
UNACKNOWLEDGED_SECONDS = 60
"""Time after which the system ends a connection whose peer acknowledges neither bytes nor probes, or takes no
bytes. As long as a WebSocket peer may leave a ping unanswered; TCP peers have no ping."""

ACCEPT_PAUSE_SECONDS = 0.5
"""Pause after a connection could not be accepted, for example because no descriptors are left."""
LOG_SECONDS = 60.0
"""Minimum interval between log lines about this, in seconds."""
MAX_DESCRIPTORS = 1 << 20
"""Limit to request at most: programs that close all descriptors one by one before a fork would take long."""

MAX_HANDSHAKES = 256
"""Maximum number of pending TLS handshakes of one listener. Each takes some hundred kilobytes."""

HANDSHAKES: Final = PoolRow("TLS handshakes", "", "TLS handshakes")


_TCP_INFO: Final = struct.Struct("=68xI72xII")
"""Of the kernel's `tcp_info`: rtt, notsent_bytes and min_rtt, times in microseconds."""


def delivery_of(connected: socket.socket) -> Delivery:
    """Return the progress of sent bytes of a TCP connection; zeros if the system does not report it."""
    if sys.platform != "linux" or connected.fileno() < 0:
        return Delivery()
    try:
        info = connected.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO.size)
        left = fcntl.ioctl(connected.fileno(), termios.TIOCOUTQ, bytes(4))
        rtt, unsent, least = _TCP_INFO.unpack(info)
    except (OSError, struct.error):  # A Unix socket, a connection that has ended, or an old kernel.
        return Delivery()
    return Delivery(int.from_bytes(left, sys.byteorder), unsent, max(0, rtt - least) / 1e6)


def hang_up_of(file: int) -> HangUp:
    """Return whether the peer of a connected socket has hung up, even if bytes are left to read; NO if the
    system cannot tell."""
    if not hasattr(select, "POLLRDHUP"):
        return HangUp.NO
    poll = select.poll()
    poll.register(file, select.POLLRDHUP)
    for _, events in poll.poll(0):
        if events & (select.POLLERR | select.POLLHUP | select.POLLNVAL):
            return HangUp.GONE
        return HangUp.SENDS_NO_MORE
    return HangUp.NO


def detect_lost_peers(connected: socket.socket) -> None:
    """Have the system end a TCP connection whose peer is unreachable.

    Connections inherit the options of the socket that accepted them. Systems without an option keep their
    own times.
    """
    with contextlib.suppress(OSError):  # The connection may have ended.
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in (
            ("TCP_KEEPIDLE", KEEPALIVE_SECONDS),
            ("TCP_KEEPINTVL", KEEPALIVE_SECONDS),
            ("TCP_USER_TIMEOUT", UNACKNOWLEDGED_SECONDS * 1000),
        ):
            if hasattr(socket, name):
                connected.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


class Handshakes:
    """TLS handshakes of one listener: beyond the maximum, the oldest of the address with most is cancelled.

    An active handshake takes milliseconds, so the oldest is most likely abandoned.
    """

    def __init__(self) -> None:
        self._pool = SharedPool(HANDSHAKES, MAX_HANDSHAKES)

    @contextlib.contextmanager
    def one(self, address: str) -> Iterator[anyio.CancelScope]:
        """Count a handshake of an address inside the block, which is cancelled if there are too many."""
        with anyio.CancelScope() as scope:
            share = self._pool.take(holder_of(address), lambda reason: scope.cancel(), 0)
            self._pool.resize(share, 1)
            try:
                yield scope
            finally:
                self._pool.release(share)


async def accept_peers(
    accept: Callable[[], Awaitable[Accepted]], begin: Callable[[Accepted], object]
) -> None:
    """Call `begin` with each result of `accept`, until cancelled or the listener is closed.

    Accepts one connection per turn of the event loop, because each causes work. If a connection cannot be
    accepted, pauses until descriptors are free; peers wait in the kernel's queue.
    """
    complained = -LOG_SECONDS
    while True:
        try:
            accepted = await accept()
        except anyio.ClosedResourceError:
            return
        except (OSError, anyio.BrokenResourceError) as error:
            if (now := time.monotonic()) - complained >= LOG_SECONDS:
                complained = now
                reason = error if isinstance(error, OSError) else error.__cause__
                logger.warning("no connection can be accepted for now: %s", reason)
            await anyio.sleep(ACCEPT_PAUSE_SECONDS)
        else:
            begin(accepted)
            await (
                anyio.lowlevel.checkpoint()
            )  # asyncio's `sock_accept` only yields if no connection is pending.


def raise_descriptor_limit() -> None:
    """Raise the limit of open files and connections to what the system allows (`ulimit -Hn`)."""
    try:
        import resource
    except ImportError:  # Windows has no such limit.
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, MAX_DESCRIPTORS)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    except (OSError, ValueError) as error:
        logger.debug("%d open files are the limit: %s", soft, error)
    else:
        logger.debug("%d open files are the limit, up from %d", wanted, soft)


async def bind(address: BindAddress) -> tuple[list[socket.socket], int]:
    """Return sockets bound to a TCP address or the path of a Unix socket, and the TCP port or 0.

    Raises:
        ListenError: the address is not available.
    """
    if address.path:
        return [bind_unix(address.path, address.mode)], 0
    sockets = await bind_tcp(address.host, address.port, shared=address.shared)
    return sockets, int(sockets[0].getsockname()[1])


async def bind_tcp(host: str, port: int, *, shared: bool = False) -> list[socket.socket]:
    """Return sockets bound to every address of `host` on one port; port 0 picks a free one.

    Args:
        shared: join other processes that share the port; the system spreads connections over them.

    Raises:
        ListenError: the name is unknown, or the address is not available.
    """
    try:
        found = await anyio.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except OSError:
        raise ListenError(unknown_host(host)) from None
    sockets: list[socket.socket] = []
    try:
        for family, address in dict.fromkeys((entry[0], entry[4][:2]) for entry in found):
            # Port 0: the first address picks a free port, and the others of the host use the same one.
            chosen = sockets[0].getsockname()[1] if sockets else port
            sockets.append(_bind(family, (str(address[0]), int(chosen)), shared=shared))
    except OSError as error:
        for each in sockets:
            each.close()
        raise ListenError(why_not(error, host, port)) from error
    return sockets


def _bind(family: int, address: tuple[str, int], *, shared: bool) -> socket.socket:
    # asyncio sets TCP_NODELAY on accepted sockets only if the socket's protocol is IPPROTO_TCP.
    bound = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        bound.setblocking(False)
        if os.name == "posix":
            # On Windows, this option would let two servers share a port.
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if shared:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        if hasattr(socket, "TCP_NOTSENT_LOWAT"):
            # Every accepted connection inherits it.
            bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)
        detect_lost_peers(bound)
        if family == socket.AF_INET6:
            # A socket for each family: with both in one, IPv4 addresses would appear as mapped ones.
            bound.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        bound.bind(address)
    except OSError:
        bound.close()
        raise
    return bound


def bind_unix(path: str, mode: int = OWNER_ONLY) -> socket.socket:
    """Return a Unix socket bound to `path`; replace one that no process serves any longer.

    Args:
        mode: permissions of the socket; connecting requires the right to write.

    Raises:
        ListenError: the path is not available.
    """
    if not hasattr(socket, "AF_UNIX"):
        raise ListenError(f"cannot listen on {path}: this system has no Unix sockets; use tcp:// or ws://")
    bound = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        bound.setblocking(False)
        if _is_abandoned(path):
            os.unlink(path)
        bound.bind(path)
        os.chmod(path, mode)  # Nobody can connect before `listen`.
    except OSError as error:
        bound.close()
        if error.errno == errno.EADDRINUSE:
            raise ListenError(f"{path} is in use; stop what serves it, or choose another path") from error
        reason = os.strerror(error.errno) if error.errno else str(error)
        raise ListenError(
            f"cannot listen on {path}: {reason}; choose a path in a folder of your own"
        ) from error
    return bound


def cause_of(error: Exception) -> str:
    """Return the text of an error; the name of its class if it has none, as when a peer has hung up."""
    return str(error) or type(error).__name__


def remove_unix(path: str) -> None:
    """Remove the name of a Unix socket that is no longer served."""
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)


def _is_abandoned(path: str) -> bool:
    """Return True if `path` is a socket that refuses connections, left by a killed server."""
    if not os.path.exists(path) or not stat.S_ISSOCK(os.stat(path).st_mode):
        return False
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        return probe.connect_ex(path) == errno.ECONNREFUSED


def unknown_host(host: str) -> str:
    """Return one line about a host name that cannot be resolved."""
    return f"the host {host!r} is not known; use an address such as 127.0.0.1 or 0.0.0.0"


def why_not(error: OSError, host: str, port: int) -> str:
    """Return one line with the reason why an address could not be opened, and the remedy."""
    if error.errno == errno.EADDRINUSE:
        return f"port {port} on {host} is in use; stop what holds it, or choose another port (0 picks one)"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"port {port} on {host} is not permitted to this user; choose a port from 1024 up"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{host} is not an address of this machine; use 127.0.0.1, 0.0.0.0 or one of its own"
    return f"cannot listen on {host} port {port}: {os.strerror(error.errno) if error.errno else error}"
