"""Opening a listener: a URL, an accept function, and plain HTTP routes beside it."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from ssl import SSLContext

from rwt_transports.api import OWNER_ONLY, Driver
from rwt_transports.connection import ListenerState
from rwt_transports.endpoint import Accept, Admit, Identify, anonymous
from rwt_transports.errors import BadUrl
from rwt_transports.http.addresses import AddressCount
from rwt_transports.http.connection import HttpConnection
from rwt_transports.http.proxies import NO_PROXIES, Proxies
from rwt_transports.http.routes import Hosts, Routes, is_local
from rwt_transports.limits import Limits
from rwt_transports.schemes import parse_listen_url
from rwt_transports.wires.receive_buffer import ReceiveBufferPool


class Listener:
    """Open listener; `url` has the actual port."""

    def __init__(self, url: str, state: ListenerState) -> None:
        self.url = url
        self._state = state

    @property
    def connections(self) -> int:
        return len(self._state.connections)

    async def ended(self) -> None:
        """Wait for the end of service: the end of standard input for ``stdio:``, otherwise the end of the
        block.
        """
        await self._state.ended.wait()


@asynccontextmanager
async def listen(
    url: str,
    accept: Accept,
    *,
    routes: Routes | None = None,
    hosts: Iterable[str] = (),
    proxies: Proxies = NO_PROXIES,
    access_log: bool = False,
    subprotocols: Iterable[str] = (),
    admit: Admit | None = None,
    addresses: AddressCount | None = None,
    identify: Identify = anonymous,
    limits: Limits | None = None,
    buffers: ReceiveBufferPool | None = None,
    driver: Driver | None = None,
    tls: SSLContext | None = None,
    bson: bool = False,
    shared: bool = False,
    socket_mode: int = OWNER_ONLY,
) -> AsyncIterator[Listener]:
    """Accept peers on `url` within the block, for example ``ws://127.0.0.1:9090``; port 0 picks a free one.

    Leaving the block closes every peer with 1001 and waits up to ``limits.close_seconds`` for them.

    Args:
        url: URL to listen on; :data:`rwt_transports.schemes.SCHEMES` lists the schemes.
        accept: factory of the endpoint of each new peer; may raise :exc:`~rwt_transports.errors.Refused`.
        routes: routes of plain HTTP requests on the same port.
        hosts: accepted host names; see :class:`~rwt_transports.http.routes.Hosts`.
        proxies: trusted proxies.
        access_log: True if each HTTP request is logged, to ``rwt_transports.access``.
        subprotocols: what WebSockets may speak besides rosbridge; a client that offers one gets it, and
            `accept` is told (:class:`~rwt_transports.endpoint.PeerInfo`).
        admit: decides about WebSockets in place of `accept`, and may wait.
        addresses: counts the connections of each address; one of its own by default.
        identify: returns the credential of a connection or request; by default none are needed.
        limits: limits per listener and per connection.
        buffers: what large messages are received in, shared with others that keep ``limits.incoming_bytes``
            together; of its own by default.
        tls: certificate and key for the schemes that encrypt (``wss``, ``tcps``).
        bson: True if every message is a BSON document; on a stream it says itself where it ends (BSN-03).
        shared: True if other processes listen on the same TCP port, see
            :func:`rwt_transports.shared_port.hold_port`.
        socket_mode: permissions of the file of a Unix socket; clients need the right to write.
        driver: driver of the connections; by default the fastest for the scheme and the event loop.

    Raises:
        BadUrl: the URL is invalid for listening.
        ListenError: the address is not available.
    """
    target = parse_listen_url(url, tls)
    chosen = Limits() if limits is None else limits
    scheme = target.scheme
    make_wire = scheme.bson_wire if bson else scheme.wire
    if make_wire is None:
        raise BadUrl(f"cannot listen on {url!r}: BSON is not spoken over {target.name}; use ws:// or tcp://")
    addresses = addresses or AddressCount(chosen.connections_per_address)
    state = ListenerState(
        accept,
        make_wire,
        chosen,
        partial(HttpConnection, routes or Routes()) if scheme.http else None,
        target.name,
        single=scheme.single,
        idle_seconds=chosen.idle_peer_seconds if scheme.expires else 0.0,
        max_message_size=scheme.max_message_size,
        addresses=addresses,
        buffers=buffers or chosen.receive_pool(),
        proxies=proxies,
        access_log=access_log,
        subprotocols=frozenset(subprotocols),
        admit=admit,
        identify=identify,
        hosts=Hosts(hosts, loopback=is_local(target.address.host)),
    )
    bound = replace(
        target.address,
        shared=shared,
        mode=socket_mode,
        addresses=addresses,
        handshake_seconds=chosen.handshake_seconds,
        is_held_back=state.buffers.has_much_unread,
    )
    async with (driver or scheme.driver()).serve(bound, state.attach) as port, state.serving():
        yield Listener(target.with_port(port), state)
