"""Addresses of clients: unit of counting, and number of connections of each."""

from __future__ import annotations

import ipaddress
import logging
from collections import Counter

from rwt_transports.errors import Refused
from rwt_transports.http.proxies import NO_PROXIES, Proxies, parsed
from rwt_transports.http.routes import Hosts, is_local
from rwt_transports.shared_pool import Holder

logger = logging.getLogger("rwt_transports.http")


class AddressCount:
    """Number of open connections by address, over all listeners that share it.

    Connections count from the first byte on: TLS handshakes, plain HTTP and streams, too. Local addresses do
    not count; IPv6 counts by :func:`network_of`.

    Args:
        most: connections of one address; 0 for any number.
        proxies: proxies whose connections count only once a request names their client, or does not
            (:func:`~rwt_transports.http.proxies.behind_proxy`).

    Attributes:
        refused: number of refused connections and requests by reason: `connections`, `host`.
    """

    def __init__(self, most: int = 0, proxies: Proxies = NO_PROXIES) -> None:
        self._most = most
        self._proxies = proxies
        self._open: Counter[str] = Counter()
        self.refused: Counter[str] = Counter(connections=0, host=0)

    def enter(self, address: str) -> None:
        if key := self._key(address):
            self._open[key] += 1

    def leave(self, address: str) -> None:
        if key := self._key(address):
            self._open[key] -= 1
            # Entries of absent addresses are removed, or the counter would grow with every address ever seen.
            if not self._open[key]:
                del self._open[key]

    def check(self, address: str, *, notes: bool = True) -> None:
        """Check the limit for a connection that is already counted.

        Args:
            notes: False if the caller counts the refusal once it is sent (:meth:`note_refusal`).

        Raises:
            Refused: the address has too many connections (status 429); the text names the setting.
        """
        if self._open[self._key(address)] > self._most:
            text = f"{self._most} connections from {address} are open (limits.connections_per_address)"
            if notes:
                self.note_refusal("connections", address, text)
            raise Refused(429, text, {"Connection": "close"})

    def check_host(self, hosts: Hosts, host: str, address: str) -> None:
        """Check the header `Host` of a request.

        Raises:
            Refused: the listener does not answer to this name (status 403); the text names the setting.
        """
        if not hosts.include(host):
            text = f"this server does not answer to the name {ascii(host)[1:-1][:200]} (origins.hosts)"
            self.note_refusal("host", address, text)
            raise Refused(403, text, {"Connection": "close"})

    def note_refusal(self, reason: str, address: str, text: str) -> None:
        """Count and log a refusal."""
        self.refused[reason] += 1
        logger.warning("refused %s: %s", address, text)

    def is_flooding(self, address: str) -> bool:
        """True if the address has twice its limit of connections, so that it gets no response."""
        return self._open[self._key(address)] > 2 * self._most

    def _key(self, address: str) -> str:
        if not self._most or not address or is_local(address) or address in self._proxies:
            return ""
        return network_of(address)


def network_of(address: str) -> str:
    """Return the unit of counting: for IPv6 the /64 network, because its holder has all of its addresses."""
    found = parsed(address.partition("%")[0]) if ":" in address else None
    if found is None:
        return address
    return str(found) if found.version == 4 else str(ipaddress.ip_network((str(found), 64), strict=False))


def holder_of(address: str, credential: str = "") -> Holder:
    """Return the holder of shares of a client (:mod:`rwt_transports.shared_pool`)."""
    return Holder(network_of(address), credential)
