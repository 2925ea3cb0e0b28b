"""What a hub holds of messages that it has taken from one side and the other side has not taken yet."""

from __future__ import annotations

from collections import Counter
from typing import Final, Protocol

from rwt_transports.http.addresses import network_of
from rwt_transports.http.routes import is_local
from rwt_transports.limits import MIB

OF_ADDRESS: Final = 64 * MIB
"""Bytes that wait on account of clients of one address, by default."""

TIMES: Final = 4
"""As many addresses together may have as much."""


class Holder(Protocol):
    """One side of a connection through a hub, whose messages wait for the other."""

    address: str

    def cut(self, reason: str) -> None:
        """End the connection, and drop what waits."""


class WaitingBytes:
    """Counts what waits, and ends the connection with the most where it is too much.

    A connection is held back once 256 KiB of it wait, so that what counts is large messages, to a side that
    does not read.

    Args:
        most: bytes that may wait for the clients of one address, either way; a machine's own addresses have
            no bound of their own, and all addresses together four times as many.
    """

    def __init__(self, most: int = OF_ADDRESS) -> None:
        self._most = most
        self._total = 0
        self._held: dict[Holder, int] = {}
        self._of_address: Counter[str] = Counter()

    @property
    def total(self) -> int:
        """Bytes that wait, of all."""
        return self._total

    def take(self, holder: Holder, size: int) -> None:
        """Count that so many bytes more of a holder wait."""
        network = network_of(holder.address)
        self._held[holder] = self._held.get(holder, 0) + size
        self._of_address[network] += size
        self._total += size
        if not is_local(network) and self._of_address[network] > self._most:
            self._cut_largest(network)
        elif self._total > TIMES * self._most:
            ((largest, _),) = self._of_address.most_common(1)
            self._cut_largest(largest)

    def give_back(self, holder: Holder) -> None:
        """Count that nothing of a holder waits any more; a second call does nothing."""
        size = self._held.pop(holder, 0)
        if size:
            self._total -= size
            network = network_of(holder.address)
            self._of_address[network] -= size
            if not self._of_address[network]:
                del self._of_address[network]

    def _cut_largest(self, network: str) -> None:
        its = [holder for holder in self._held if network_of(holder.address) == network]
        largest = max(its, key=self._held.__getitem__)
        self.give_back(largest)
        largest.cut(f"more than {self._most} bytes of clients of this address wait (--waiting-bytes)")
