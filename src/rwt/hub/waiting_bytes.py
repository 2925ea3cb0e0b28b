"""Limit of the bytes that a hub has received from one side and the other side has not taken yet."""

from __future__ import annotations

from collections import Counter
from typing import Final, Protocol

from rwt_transports.http.addresses import network_of
from rwt_transports.http.routes import is_local
from rwt_transports.limits import MIB

ADDRESS_BYTES: Final = 64 * MIB
"""Default limit of waiting bytes for the clients of one address."""

TOTAL_FACTOR: Final = 4
"""Limit for all addresses together, as a multiple of the limit of one."""


class Holder(Protocol):
    """Side of a connection through a hub whose messages wait for the other side."""

    address: str

    def cut(self, reason: str) -> None:
        """Close the connection, and drop the waiting messages."""


class WaitingBytes:
    """Counter of waiting bytes; above the limit, it closes the connection with the most.

    A connection is held back once 256 KiB of it wait. What counts is therefore large messages to a side that
    does not read.

    Args:
        most: maximum number of waiting bytes for the clients of one address, in both directions. Local
            addresses have no limit of their own; all addresses together may use four times as much.

    Attributes:
        total: waiting bytes of all connections.
    """

    def __init__(self, most: int = ADDRESS_BYTES) -> None:
        self._most = most
        self.total = 0
        self._held: dict[Holder, int] = {}
        self._of_address: Counter[str] = Counter()

    def take(self, holder: Holder, size: int) -> None:
        """Add `size` waiting bytes of a holder."""
        network = network_of(holder.address)
        self._held[holder] = self._held.get(holder, 0) + size
        self._of_address[network] += size
        self.total += size
        if not is_local(network) and self._of_address[network] > self._most:
            self._cut_largest(network)
        elif self.total > TOTAL_FACTOR * self._most:
            ((largest, _),) = self._of_address.most_common(1)
            self._cut_largest(largest)

    def give_back(self, holder: Holder) -> None:
        """Clear the waiting bytes of a holder; idempotent."""
        size = self._held.pop(holder, 0)
        if size:
            self.total -= size
            network = network_of(holder.address)
            self._of_address[network] -= size
            if not self._of_address[network]:
                del self._of_address[network]

    def _cut_largest(self, network: str) -> None:
        its = [holder for holder in self._held if network_of(holder.address) == network]
        largest = max(its, key=self._held.__getitem__)
        self.give_back(largest)
        largest.cut(f"more than {self._most} bytes of clients of this address wait (--waiting-bytes)")
