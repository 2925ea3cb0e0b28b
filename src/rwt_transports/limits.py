"""Bounds that one listener puts on its peers."""

from __future__ import annotations

import ipaddress
from collections import Counter
from dataclasses import dataclass

from rwt_transports.errors import Refused
from rwt_transports.http.routes import NO_PROXIES, Proxies, is_local
from rwt_transports.websocket.extensions import Deflate
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

KIB = 1024
MIB = 1024 * KIB
READY_BYTES = 128 * KIB


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds per listener or per connection. The defaults are safe on an open network.

    Attributes:
        message_bytes: largest incoming message. A larger one is skipped without being kept, and the
            endpoint is informed (:class:`~rwt_transports.api.OversizeAware`); one that takes no such report
            is closed with 1009.
        incoming_bytes: what all connections together that share a
            :class:`~rwt_transports.wires.receive_buffer.ReceiveBufferPool` may hold of messages whose end has
            not come; two of the largest messages at least. Beyond it the connection whose message began first
            is closed with 1008. While a quarter as many came to their end and wait to be read, no more of
            large ones is received or inflated.
        strict_utf8: close with 1007 when a text message is not UTF-8 (RFC 6455 section 8.1). Off by
            default: the endpoint gets the bytes as they came and answers, so that one bad message does not
            cost the connection.
        connections: open connections of one listener. More are answered with HTTP 503 where the transport
            has HTTP, and cut otherwise; twice as many are always cut.
        connections_per_address: the same bound for each address; see :class:`AddressCount`.
        handshake_seconds: from the first byte expected to the end of the request.
        idle_http_seconds: how long a kept-alive HTTP connection may wait between two requests.
        stalled_http_seconds: how long the peer may take none of the bytes of an answer or a stream that wait
            for it; then it is cut.
        http_header_bytes: size of one request line with its headers.
        http_body_bytes: size of one plain HTTP request body.
        close_seconds: how long a closing connection may take before it is cut.
        ping_seconds: silence after which the peer is pinged; 0 never pings.
        pong_seconds: further silence after which the peer counts as gone.
        idle_peer_seconds: silence after which a peer counts as gone where connections have no end (UDP).
        data_bytes: bytes queued in one connection's data lane. Reached, the oldest frame of the same topic is
            dropped for each new one; every topic keeps its newest frame.
        data_frames: the same bound as a number of frames.
        ready_bytes: bytes that may wait in front of the lanes: what one write joins, and the most that
            dropping cannot reach.
        outgoing_bytes: largest message of the data lane; a larger one is dropped.
        control_bytes: bytes queued in one connection's control lane. Reached, the connection is closed with
            1008.
        control_frames: the same bound as a number of frames.
        deflate: whether WebSocket peers that ask for it get compressed messages (RFC 7692).
    """

    message_bytes: int = 64 * MIB
    incoming_bytes: int = 64 * MIB
    strict_utf8: bool = False
    connections: int = 1024
    connections_per_address: int = 128
    handshake_seconds: float = 10.0
    idle_http_seconds: float = 60.0
    stalled_http_seconds: float = 20.0
    http_header_bytes: int = 16 * KIB
    http_body_bytes: int = MIB
    close_seconds: float = 2.0
    ping_seconds: float = 20.0
    pong_seconds: float = 40.0
    idle_peer_seconds: float = 60.0
    data_bytes: int = 8 * MIB
    data_frames: int = 10_000
    ready_bytes: int = READY_BYTES
    outgoing_bytes: int = 256 * MIB
    control_bytes: int = 64 * MIB
    control_frames: int = 100_000
    deflate: Deflate = Deflate.OFF

    def receive_pool(self) -> ReceiveBufferPool:
        """Return a pool for connections that share these bounds."""
        return ReceiveBufferPool(max(self.incoming_bytes, 2 * self.message_bytes))


class AddressCount:
    """Number of open connections of each address, over all listeners that share it.

    From the first byte on: handshakes in TLS, plain HTTP and streams count like every other. This machine's
    own addresses are not counted; what counts as one is :func:`network_of` it.

    Args:
        most: connections of one address; 0 for any number.
        proxies: whose own connections are not counted; those of their clients are.
    """

    def __init__(self, most: int = 0, proxies: Proxies = NO_PROXIES) -> None:
        self._most = most
        self._proxies = proxies
        self._open: Counter[str] = Counter()

    def enter(self, address: str) -> None:
        """Count one more."""
        if key := self._key(address):
            self._open[key] += 1

    def leave(self, address: str) -> None:
        """Count one less."""
        if key := self._key(address):
            self._open[key] -= 1
            if not self._open[key]:
                del self._open[key]

    def check(self, address: str) -> None:
        """Look at a connection that is counted already.

        Raises:
            Refused: the address has more than it may have, with status 429; the text names the setting.
        """
        if self._open[self._key(address)] > self._most:
            text = f"{self._most} connections from {address} are open (limits.connections_per_address)"
            raise Refused(429, text, {"Connection": "close"})

    def is_flooding(self, address: str) -> bool:
        """Return True if the address has twice its limit, so that it does not even get an answer."""
        return self._open[self._key(address)] > 2 * self._most

    def _key(self, address: str) -> str:
        if not self._most or not address or is_local(address) or address in self._proxies:
            return ""
        return network_of(address)


def network_of(address: str) -> str:
    """What counts as one address: a network of 64 bits for IPv6, since whoever has one of its addresses has
    all of them."""
    if ":" not in address:
        return address
    try:
        return str(ipaddress.ip_network((address.partition("%")[0], 64), strict=False))
    except ValueError:
        return address
