"""Pools that clients share: a full pool takes from the client with most when one with less asks.

There is no fixed share: a client alone may use a whole pool. With several, each gets what it asks for up to
an equal part (max-min fairness), whatever the order in which they come.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Final, NamedTuple

from rwt_transports.errors import Refused

RETRY_SECONDS: Final = 5
"""Seconds after which a refused client may ask again."""


class Holder(NamedTuple):
    """Client of a pool: clients of one network with the same credential count as one.

    Attributes:
        network: address of the client, or its network (:func:`rwt_transports.http.addresses.network_of`).
        credential: name of the credential; empty without.
    """

    network: str = ""
    credential: str = ""


@dataclass(frozen=True, slots=True)
class PoolRow:
    """Row of the table of shared pools.

    Attributes:
        name: name of the pool, for the table.
        setting: key of the setting of its capacity; empty for a constant.
        unit: what it has, as a plural noun, for error texts.
    """

    name: str
    setting: str
    unit: str

    def __str__(self) -> str:
        return f"{self.unit} ({self.setting})" if self.setting else self.unit


def lasting_room(capacity: int, used: int, held: int) -> int:
    """Return how much a holder may take of what cannot be taken back, such as files on a disk.

    Such a pool is shared by dynamic thresholds: each holder may have as much as it leaves free. So a part
    is left for the next one, however many there were.

    Args:
        used: amounts of all holders.
        held: amount of this holder.
    """
    return max(0, capacity - used - held) // 2


class PoolFull(Refused):
    """A pool has no room, and nothing to take from a client with more (status 503)."""

    def __init__(self, reason: str) -> None:
        super().__init__(503, reason, {"Retry-After": str(RETRY_SECONDS)})


def _released(reason: str) -> None:
    """End of a share that was released or taken."""


class Share:
    """Part of a pool, until it is released or taken.

    Attributes:
        holder: client to which it counts.
        amount: how much of the pool it is.
        end: called once with the reason if the pool takes it; not called after a release.
    """

    __slots__ = ("amount", "end", "holder")

    def __init__(self, holder: Hashable, end: Callable[[str], None]) -> None:
        self.holder = holder
        self.amount = 0
        self.end = end


class SharedPool:
    """Capacity that clients share.

    A pool that is full takes the oldest shares of the holder with most, if the one who asks has less, even
    with what it asks for. Otherwise, the one who asks is refused. A share that grows beyond the capacity is
    treated in the same way, except that its holder then loses its own oldest share.

    Attributes:
        row: row of the table of pools.
        capacity: maximum sum of all amounts.
        used: sum of all amounts.
    """

    def __init__(self, row: PoolRow, capacity: int) -> None:
        self.row = row
        self.capacity = capacity
        self.used = 0
        self._shares: dict[Share, None] = {}  # Oldest first.
        self._held: dict[Hashable, int] = {}

    def __len__(self) -> int:
        return len(self._shares)

    def held(self, holder: Hashable) -> int:
        """Return the sum of the amounts of a holder."""
        return self._held.get(holder, 0)

    def take(self, holder: Hashable, end: Callable[[str], None], amount: int = 1) -> Share:
        """Return a new share, for which those of others may be taken.

        Args:
            end: called with the reason if the pool takes it.
            amount: how much; 0 for a share that grows later, which is never refused.

        Raises:
            PoolFull: there is no room, and `holder` would have as much as any other.
        """
        for victim in self._victims(holder, amount):
            self._end(victim)
        share = Share(holder, end)
        self._shares[share] = None
        self._add(share, amount)
        return share

    def check(self, holder: Hashable, amount: int = 1) -> None:
        """Raise PoolFull if :meth:`take` would; takes nothing."""
        self._victims(holder, amount)

    @property
    def is_full(self) -> bool:
        """True if a further share of 1 needs one of another."""
        return self.used >= self.capacity

    def resize(self, share: Share, amount: int) -> None:
        """Set the amount of a share; no-op if it was released or taken.

        Beyond the capacity, the oldest shares of the holder with most are taken, which may include this one.
        A share that is alone may exceed the capacity.
        """
        if share not in self._shares:
            return
        self._add(share, amount - share.amount)
        while self.used > self.capacity and len(self._shares) > 1:
            # Among equals it is the one who asks for more.
            self.end_oldest(max(self._held, key=lambda holder: (self._held[holder], holder == share.holder)))

    def end_oldest(self, holder: Hashable) -> None:
        """Take the oldest share of a holder, which has one."""
        self._end(next(each for each in self._shares if each.holder == holder and each.amount))

    def grow(self, share: Share, amount: int) -> None:
        """Set the amount of a share like :meth:`take`: the share is refused rather than its holder's oldest
        one taken.

        Raises:
            PoolFull: there is no room; the amount is as before.
        """
        former = share.amount
        self._add(share, -former)
        try:
            victims = self._victims(share.holder, amount)
        except PoolFull:
            self._add(share, former)
            raise
        for victim in victims:
            self._end(victim)
        if share in self._shares:
            self._add(share, amount)

    def move(self, share: Share, holder: Hashable) -> None:
        """Count a share to another holder; no-op if it was released or taken."""
        if share in self._shares and share.holder != holder:
            amount = share.amount
            self._add(share, -amount)
            share.holder = holder
            self._add(share, amount)

    def release(self, share: Share) -> None:
        """Return a share to the pool; idempotent."""
        if share in self._shares:
            del self._shares[share]
            self._add(share, -share.amount)
            share.end = _released  # Break the cycle: the function refers to what has the share.

    def _add(self, share: Share, amount: int) -> None:
        share.amount += amount
        self.used += amount
        held = self._held.get(share.holder, 0) + amount
        if held:
            self._held[share.holder] = held
        else:
            self._held.pop(share.holder, None)

    def _victims(self, holder: Hashable, amount: int) -> list[Share]:
        """Return the shares to take for a new amount, without taking them. Raises PoolFull."""
        excess = self.used + amount - self.capacity
        if not amount or excess <= 0:
            return []
        wanted = self.held(holder) + amount
        left = dict(self._held)
        victims: dict[Share, None] = {}
        while excess > 0:
            largest = max(left, key=left.__getitem__, default=None)
            if largest is None or wanted >= left[largest]:
                raise PoolFull(self._refusal(holder, amount))
            oldest = next(
                each
                for each in self._shares
                if each.holder == largest and each.amount and each not in victims
            )
            victims[oldest] = None
            left[largest] -= oldest.amount
            excess -= oldest.amount
        return list(victims)

    def _end(self, share: Share) -> None:
        held, end = self.held(share.holder), share.end
        self.release(share)
        end(f"{held} of {self.capacity} were this client's, the most of all: {self.row}")

    def _refusal(self, holder: Hashable, amount: int) -> str:
        wanted = f" {amount} are needed, and" if amount > 1 else ""
        return (
            f"{wanted} {self.used} of {self.capacity} are in use, {self.held(holder)} by this client:"
            f" {self.row}"
        ).strip()
