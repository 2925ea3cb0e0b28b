"""TCP port of several processes: reserved by one, listened on by the others (SO_REUSEPORT)."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from ssl import SSLContext

from rwt_transports.drivers.sockets import bind_tcp
from rwt_transports.schemes import parse_listen_url, stream_driver


def can_share(url: str, tls: SSLContext | None = None) -> bool:
    """Return True if several processes can listen on a URL: only on TCP.

    Raises:
        BadUrl: the URL is invalid for listening.
    """
    target = parse_listen_url(url, tls)
    return bool(target.address.host) and target.scheme.driver is stream_driver


@dataclass(frozen=True, slots=True)
class HeldPort:
    """Port reserved for this program, even while no process listens on it.

    Attributes:
        url: URL with the actual port, on which processes of this user listen with ``shared=True``.
    """

    url: str
    _sockets: tuple[socket.socket, ...]

    def close(self) -> None:
        """Release the port."""
        for each in self._sockets:
            each.close()


async def hold_port(url: str, tls: SSLContext | None = None) -> HeldPort:
    """Reserve the port of a URL without listening; port 0 picks a free one.

    Raises:
        BadUrl: the URL is invalid for listening.
        ListenError: the address is not available.
    """
    target = parse_listen_url(url, tls)
    # Bound without listening: the system gives such a socket no connections.
    sockets = await bind_tcp(target.address.host, target.address.port)
    for each in sockets:
        # Set after binding, so that a port shared by other programs counts as in use.
        each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    return HeldPort(target.with_port(int(sockets[0].getsockname()[1])), tuple(sockets))
