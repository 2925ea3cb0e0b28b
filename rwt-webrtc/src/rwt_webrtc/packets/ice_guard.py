"""Limits of an ICE agent: which datagrams it reads, and to which addresses it sends checks.

An offer names the addresses to which this side sends, and anybody can send to the ports of this side. So
checks to addresses that have not answered are limited (RFC 8445 sections 6.1.2.5 and 14), in number and to
three times the bytes that caused them, and datagrams count only from addresses that know the credentials.
"""

from __future__ import annotations

import ipaddress
from collections import Counter
from collections.abc import Callable
from enum import IntEnum
from time import monotonic
from typing import Final

from rwt_transports.http.routes import is_local
from rwt_transports.limits import RateLimit
from rwt_webrtc.packets.rtp import RTP_HEADER_BYTES

Address = tuple[str, int]

CONSENT_EXPIRES_SECONDS: Final = 3.6
"""Time without an answer after which a peer with data channels is gone: its commands and offers end."""
MEDIA_CONSENT_EXPIRES_SECONDS: Final = 30.0
"""Time without an answer after which a peer with media only is gone, the limit of RFC 7675: it does not move
the robot, and browsers keep its connection over shorter outages."""
CHECKS: Final = 100
"""Checks that a peer may cause to addresses that have not answered."""
CHECKS_PER_SECOND: Final = 20
"""Checks per second of all peers of a network, after a burst of :data:`CHECKS`: Ta of RFC 8445 is 50 ms."""
REQUESTS_PER_SECOND: Final = 50
"""Requests with valid credentials that a peer may send."""
SOURCES: Final = 128
"""Addresses of a peer that know the credentials."""
MEDIA_SOURCES: Final = 32
"""Synchronization sources of a peer, each of which has statistics in libsrtp and aiortc."""
RETRANSMISSIONS_PER_SECOND: Final = 512
"""Media packets that a peer may have sent again."""
SENT_PER_RECEIVED: Final = 3
"""Bytes sent to addresses that have not answered, per byte that caused it: RFC 9000 section 8.1."""
CREDIT_BYTES: Final = 2048
"""Maximum that requests of such an address allow to send to it."""
DATAGRAM_BYTES: Final = 2048
"""Maximum size of a datagram; those of WebRTC fit an Ethernet frame."""
EARLY_DATAGRAMS: Final = 64
"""Maximum queue until a path is found, in datagrams."""
WAITING_DATAGRAMS: Final = 1024


class Reach(IntEnum):
    """Addresses that two peers may exchange; each value includes those after it."""

    LOOPBACK = 0
    PRIVATE = 1
    PUBLIC = 2


def reach_of(address: str) -> Reach:
    """Return where an address is; a name, or no address, counts as public unless it is this machine."""
    if not address or is_local(address):
        return Reach.LOOPBACK
    found = _parsed(address)
    return Reach.PUBLIC if found is None or found.is_global else Reach.PRIVATE


def is_unicast(host: str, port: int) -> bool:
    """Return True if a candidate's address can be one of a peer."""
    found = _parsed(host)
    if found is None or not 0 < port < 65536:
        return False
    if found.is_multicast or found.is_unspecified:
        return False
    # 240.0.0.0/4 has the limited broadcast address; the rest of it is unused.
    return not (isinstance(found, ipaddress.IPv4Address) and found.is_reserved)


def _parsed(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        found = ipaddress.ip_address(host)
    except ValueError:
        return None
    return (found.ipv4_mapped or found) if isinstance(found, ipaddress.IPv6Address) else found


class CheckRates:
    """Rate limit of checks by network of the peers that cause them."""

    def __init__(self) -> None:
        self._buckets: dict[str, RateLimit] = {}

    def take(self, network: str) -> bool:
        """Count a check for a network. Returns False if it exceeds the rate."""
        now = monotonic()
        bucket = self._buckets.get(network)
        if bucket is None:
            self._buckets = {name: each for name, each in self._buckets.items() if not each.is_full(now)}
            bucket = self._buckets[network] = RateLimit(CHECKS_PER_SECOND, CHECKS)
        return bucket.take(now)


class IceGuard:
    """Addresses of a peer, and the checks that it may still cause.

    Args:
        reach: addresses to which checks are sent, and that are announced to the other side.
        take_check: counts a check to be sent for the peer's network; returns False over its rate limit.

    Attributes:
        consent_seconds: time without an answer after which the peer counts as gone.
    """

    def __init__(self, reach: Reach, take_check: Callable[[], bool]) -> None:
        self.reach = reach
        self.consent_seconds = CONSENT_EXPIRES_SECONDS
        self._take_check = take_check
        self._checks_left = CHECKS
        self._bytes_left = 0
        self._requests = RateLimit(REQUESTS_PER_SECOND, 2 * REQUESTS_PER_SECOND)
        self._credits: Counter[Address] = Counter()
        self._sources: set[Address] = set()
        self._answered: set[Address] = set()
        self._media_sources: set[bytes] = set()

    def is_source(self, address: Address) -> bool:
        return address in self._sources

    def described(self, size: int) -> None:
        """Count the bytes of a description or of candidates."""
        self._bytes_left += SENT_PER_RECEIVED * size

    def admit_request(self, address: Address, size: int) -> bool:
        """Count a request with valid credentials. Returns False if it is not to be answered."""
        if not self._requests.take(monotonic()) or not self._add(address):
            return False
        self._credits[address] = min(self._credits[address] + SENT_PER_RECEIVED * size, CREDIT_BYTES)
        return True

    def answered(self, address: Address) -> None:
        """Note a valid response, which proves that an address receives what is sent to it."""
        if self._add(address):
            self._answered.add(address)

    def admit_response(self, address: Address, size: int) -> bool:
        """Count a response to be sent. Returns False if it is not to be sent."""
        if address in self._answered:
            return True
        if self._credits[address] < size:
            return False
        self._credits[address] -= size
        return True

    def admit_check(self, address: Address, size: int) -> bool:
        """Count a check to be sent. Returns False if it is not to be sent."""
        if address in self._answered:
            return True
        host, port = address
        if not is_unicast(host, port) or reach_of(host) < self.reach:
            return False
        if self.admit_response(address, size):
            return True
        if self._checks_left <= 0 or self._bytes_left < size or not self._take_check():
            return False
        self._checks_left -= 1
        self._bytes_left -= size
        return True

    def admit_media(self, data: bytes) -> bool:
        """Note the synchronization source of an encrypted packet. Returns False if there are too many."""
        if len(data) < RTP_HEADER_BYTES:
            return False
        source, known = data[4:8] if 192 <= data[1] <= 223 else data[8:12], self._media_sources
        if source not in known:
            if len(known) >= MEDIA_SOURCES:
                return False
            known.add(source)
        return True

    def _add(self, address: Address) -> bool:
        if address not in self._sources and len(self._sources) >= SOURCES:
            return False
        self._sources.add(address)
        return True
