"""Limits of the peers of one listener, and the limit of a rate."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from rwt_transports.wires.receive_buffer import ReceiveBufferPool

KIB = 1024
MIB = 1024 * KIB
READY_BYTES = 128 * KIB
DATAGRAM_BYTES = 65_507
"""The largest UDP payload over IPv4 (65,535 bytes less the headers of RFC 791 and RFC 768)."""


class Deflate(StrEnum):
    """Mode of compression of messages to clients that support it."""

    OFF = "off"
    SHARED = "shared"
    """Compress each message on its own, once for all readers."""
    CONTEXT = "context"
    """Compress each message in the context of earlier ones of the connection."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits per listener or per connection. The defaults are safe on an open network.

    The settings of a server take their defaults from here. Only `message_bytes` and `incoming_bytes` differ
    there: clients and hubs receive samples, which may be large, and a server receives mostly commands.

    Attributes:
        message_bytes: maximum size of an incoming message. A larger one is skipped, and the
            endpoint is informed (:class:`~rwt_transports.api.OversizeAware`); one without this method
            is closed with 1009.
        incoming_bytes: what all connections together that share a
            :class:`~rwt_transports.wires.receive_buffer.ReceiveBufferPool` may hold of messages whose end has
            not come; two of the largest messages at least. Beyond it the client that holds most of it loses
            the message that began first, and its connection is closed with 1008. While a quarter as many came
            to their end and wait to be read, no more of large ones is received or inflated.
        strict_utf8: close with 1007 when a text message is not UTF-8 (RFC 6455 section 8.1). Off by
            default: the endpoint gets the received bytes and answers, so that one bad message does not
            cost the connection.
        connections: open connections of one listener, which clients share
            (:mod:`rwt_transports.shared_pool`). One for which there is no room is refused with HTTP 503 where
            the transport has HTTP, and cut otherwise; beyond as many of these, the next are always cut.
        connections_per_address: the same bound for each address; see :class:`AddressCount`.
        handshake_seconds: from the first byte expected to the end of the request.
        idle_http_seconds: maximum idle time of a kept-alive HTTP connection.
        stalled_http_seconds: time for which the peer may accept no bytes of a response or a stream that wait
            for it; then it is cut.
        http_header_bytes: size of one request line with its headers.
        http_body_bytes: size of one plain HTTP request body.
        unknown_bytes: the same for a request without the credentials that it needs.
        close_seconds: maximum duration of closing a connection, after which it is cut.
        ping_seconds: silence after which the peer is pinged; 0: never.
        pong_seconds: additional silence after which the peer counts as lost.
        idle_peer_seconds: silence after which a peer of a connectionless transport (UDP) counts as lost.
        data_bytes: bytes queued in one connection's data lane. Reached, the oldest frame of the same topic is
            dropped for each new one; every topic keeps its newest frame.
        data_frames: the same bound as a number of frames.
        ready_bytes: bytes that may wait in front of the lanes: what one write joins, and the most that
            dropping cannot reach.
        outgoing_bytes: maximum size of a message of the data lane; larger ones are dropped.
        control_bytes: bytes queued in one connection's control lane. Reached, the connection is closed with
            1008.
        control_frames: the same bound as a number of frames.
        deflate: compression for WebSocket peers that offer it (RFC 7692).
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
    unknown_bytes: int = 4 * KIB
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
        """Return a pool for connections that share these limits."""
        return ReceiveBufferPool(max(self.incoming_bytes, 2 * self.message_bytes))


class RateLimit:
    """Rate limit of events, or of amounts such as bytes: a burst, and `rate` per second in the long run.

    The token bucket is stored as the time at which it is full again, so that an idle limit costs nothing.

    Args:
        rate: events per second in the long run, or amounts.
        burst: maximum number of events at once.
    """

    __slots__ = ("_full", "_interval", "_tolerance")

    def __init__(self, rate: float, burst: float) -> None:
        self._interval = 1 / rate  # seconds
        # Half an event more, since sums of floats round. Amounts need a unit of which half is negligible.
        self._tolerance = (burst + 0.5) / rate
        self._full = float("-inf")

    def take(self, now: float, amount: float = 1) -> bool:
        """Return True if that much more is within the limit; `now` in seconds on a monotonic clock."""
        full = self._full
        full = (full if full > now else now) + self._interval * amount
        if full - now > self._tolerance:
            return False
        self._full = full
        return True

    def give_back(self, amount: float = 1) -> None:
        """Undo the last :meth:`take` of that amount."""
        self._full -= self._interval * amount

    def is_full(self, now: float) -> bool:
        """Return True if the whole burst is available."""
        return self._full <= now
