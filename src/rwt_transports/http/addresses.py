"""Addresses of clients: what counts as one, and how many connections each has."""

from __future__ import annotations

import ipaddress
from collections import Counter

from rwt_transports.errors import Refused
from rwt_transports.http.routes import NO_PROXIES, Proxies, is_local


class AddressCount:
    """How many connections are open from each address, over all listeners that share it.

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
        """Whether the address has twice what it may have, so that it does not even get an answer."""
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
