"""How much one client may hold, and how fast it may act."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_access.errors import QuotaExceeded

if TYPE_CHECKING:
    from rwt_access.settings import ClientLimits


class Quota:
    """How much of one kind a client holds, and may hold.

    What outlives the client, as a publisher that lingers, stays charged to its address: clients from there
    may leave behind a few times as much as one may hold.

    Attributes:
        held: how much it holds now.

    Args:
        setting: the key below `limits` that says how much it may hold.
        most: how much it may hold.
        outlived: what earlier clients of the same address have left behind.
        times: how much that may be, with this client's, as a multiple of `most`.
        noun: what is counted; the setting's own name by default.
    """

    __slots__ = ("_has_left", "_most", "_most_of_address", "_noun", "_outlived", "_setting", "held")

    def __init__(
        self, setting: str, most: int, outlived: Quota | None = None, times: int = 1, noun: str = ""
    ) -> None:
        self._setting = setting
        self._most = most
        self._noun = noun or setting
        self._outlived = outlived
        self._most_of_address = times * most
        self._has_left = False
        self.held = 0

    def take(self, amount: int = 1) -> Charge:
        """Count some more, until the charge ends.

        Raises:
            QuotaExceeded: the client holds as much as it may.
        """
        self.add(amount)
        return Charge(self, amount)

    def exchange(self, old: object, amount: int) -> Charge:
        """Count something in the place of what an older charge counts, if that is one of this quota.

        Raises:
            QuotaExceeded: the client holds as much as it may; the older charge stays.
        """
        if not isinstance(old, Charge) or old.quota is not self:
            return self.take(amount)
        self.add(amount - old.amount)
        old.quota = None
        return Charge(self, amount)

    def add(self, amount: int) -> None:
        """Count some more, until :meth:`give_back`.

        Raises:
            QuotaExceeded: the client holds as much as it may.
        """
        if self.held + amount > self._most:
            raise QuotaExceeded(
                f"this client has {self.held} {self._noun}, "
                f"and {self._most} is the limit (limits.{self._setting})"
            )
        outlived = self._outlived
        if outlived is not None and self.held + outlived.held + amount > self._most_of_address:
            raise QuotaExceeded(
                f"clients of this address have left {outlived.held} {self._noun} behind, which count for "
                f"some seconds more; {self._most} is the limit of each (limits.{self._setting})"
            )
        self.held += amount

    def give_back(self, amount: int) -> None:
        """Count some less."""
        self.held -= amount
        if self._has_left and self._outlived is not None:
            self._outlived.held -= amount

    def leave(self) -> None:
        """Charge to the client's address from now on what goes on without it."""
        if self._outlived is not None and not self._has_left:
            self._has_left = True
            self._outlived.held += self.held


class Charge:
    """Something that counts towards a quota until it ends.

    Attributes:
        quota: None after its end.
        amount: that it counts.
    """

    __slots__ = ("amount", "quota")

    def __init__(self, quota: Quota, amount: int) -> None:
        self.quota: Quota | None = quota
        self.amount = amount

    def end(self) -> None:
        """Count no more."""
        quota, self.quota = self.quota, None
        if quota is not None:
            quota.give_back(self.amount)


class AddressQuotas:
    """What clients of one address have left behind, which counts towards the quotas of the next ones."""

    def __init__(self) -> None:
        self.advertisements = Quota("advertisements", 0)
        self.kept = Quota("kept_bytes", 0)

    @property
    def is_empty(self) -> bool:
        """Whether nothing is left behind."""
        return not (self.advertisements.held or self.kept.held)


class ClientQuotas:
    """Everything that one client may hold.

    Attributes:
        subscriptions: by topic and id.
        advertisements: topics, services and actions that it offers, and publishers that linger.
        calls: calls and goals under way.
        kept: bytes that the server keeps for it: requests under way, and samples of its latched topics.
    """

    __slots__ = ("advertisements", "calls", "kept", "subscriptions")

    def __init__(self, limits: ClientLimits, address: AddressQuotas) -> None:
        self.subscriptions = Quota("subscriptions", limits.subscriptions)
        self.advertisements = Quota("advertisements", limits.advertisements, address.advertisements, 10)
        self.calls = Quota("calls", limits.calls)
        self.kept = Quota("kept_bytes", limits.kept_bytes, address.kept, 2, "bytes kept for it")

    def leave(self) -> None:
        """Charge to the client's address from now on what goes on without it."""
        self.advertisements.leave()
        self.kept.leave()


class RateLimit:
    """Counts events: `burst` at once, and `rate` a second in the long run.

    It is a token bucket kept as one time: the moment at which the bucket would be full again.
    """

    __slots__ = ("_full", "_interval", "_tolerance")

    def __init__(self, rate: int, burst: int) -> None:
        self._interval = 1 / rate
        # Half an event more, since sums of floats round.
        self._tolerance = (burst + 0.5) / rate
        self._full = float("-inf")

    def take(self, now: float) -> bool:
        """Whether one more event is within the bounds; `now` in seconds on a clock that never goes back."""
        full = self._full
        full = (full if full > now else now) + self._interval
        if full - now > self._tolerance:
            return False
        self._full = full
        return True
