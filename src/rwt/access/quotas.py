"""Quotas of one client: what it may hold, how much work it may cause, and how fast it may act."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal, get_args

from rwt.access.errors import QuotaExceeded
from rwt_transports.http.routes import WorkAccount

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.settings import ClientLimits


class Quota:
    """Quota of a client for one kind of thing: used and maximum amount.

    Resources that outlive the client, such as a lingering publisher, stay charged to its address. Clients of
    one address may leave behind a few times the maximum of one client.

    Attributes:
        held: amount in use.

    Args:
        setting: key below `limits` that sets the maximum.
        most: maximum amount.
        outlived: amount that earlier clients of the same address left behind.
        times: maximum for the address, this client's amount included, as a multiple of `most`.
        noun: noun for error texts; the setting's own name by default.
        together: True if the amounts of all connected clients count for the address, too.
    """

    __slots__ = (
        "_has_left", "_most", "_most_of_address", "_noun", "_outlived", "_setting", "_together", "held",
    )  # fmt: skip

    def __init__(
        self,
        setting: str,
        most: int,
        outlived: Quota | None = None,
        times: int = 1,
        noun: str = "",
        *,
        together: bool = False,
    ) -> None:
        self._together = together and outlived is not None
        self._setting = setting
        self._most = most
        self._noun = noun or setting
        self._outlived = outlived
        self._most_of_address = times * most
        self._has_left = False
        self.held = 0

    def take(self, amount: int = 1) -> Charge:
        """Count an amount until the charge ends. Raises QuotaExceeded."""
        self.add(amount)
        return Charge(self, amount)

    def exchange(self, old: object, amount: int) -> Charge:
        """Count an amount in place of an older charge, which stays if it raises QuotaExceeded."""
        if not isinstance(old, Charge) or old.quota is not self:
            return self.take(amount)
        self.add(amount - old.amount)
        old.quota = None
        return Charge(self, amount)

    def add(self, amount: int) -> None:
        """Count an amount until :meth:`give_back`. Raises QuotaExceeded if it is more than is left."""
        if self.held + amount > self._most:
            raise QuotaExceeded(
                f"this client has {self.held} {self._noun}, "
                f"and {self._most} is the limit (limits.{self._setting})"
            )
        outlived = self._outlived
        if outlived is not None:
            own = 0 if self._together else self.held
            if own + outlived.held + amount > self._most_of_address:
                have = f"{outlived.held} {self._noun}"
                have = f"have {have}" if self._together else f"have left {have} behind"
                raise QuotaExceeded(
                    f"clients of this address {have}, which count until they end; "
                    f"{self._most} is the limit of each (limits.{self._setting})"
                )
            if self._together:
                outlived.held += amount
        self.held += amount

    def give_back(self, amount: int) -> None:
        """Return an amount to the quota."""
        self.held -= amount
        if self._outlived is not None and (self._has_left or self._together):
            self._outlived.held -= amount

    def leave(self) -> None:
        """Charge the remaining amount to the client's address: the client has left."""
        if self._outlived is not None and not self._has_left and not self._together:
            self._has_left = True
            self._outlived.held += self.held


@dataclass(slots=True, eq=False)
class Charge:
    """Amount that counts towards a quota until it ends."""

    quota: Quota | None  # None after its end.
    amount: int

    def end(self) -> None:
        """Return the amount to its quota; no-op after the first call."""
        quota, self.quota = self.quota, None
        if quota is not None:
            quota.give_back(self.amount)


WorkKind = Literal["messages", "pages", "pictures"]
"""Kind of work: messages with everything they cause, pages over HTTP, and images encoded in threads."""

WORK_KINDS: Final[tuple[WorkKind, ...]] = get_args(WorkKind)


@dataclass(slots=True, eq=False)
class WorkTotals:
    """Work of all clients of a server.

    Attributes:
        seconds: by what it was for.
        waits: times that work beyond its rate waited for a turn of its own.
        refused: requests for pages that were refused, beyond the rate.
    """

    seconds: dict[WorkKind, float] = field(default_factory=lambda: dict.fromkeys(WORK_KINDS, 0.0))
    waits: int = 0
    refused: int = 0


class WorkLimit(WorkAccount):
    """Work for a client, or for all clients of an address, in seconds of processor time.

    Work is counted after it is done. Beyond the rate, a client's next work waits until it does not delay
    others; only pages over HTTP are rejected, because they cannot wait.

    The rate is a token bucket, stored as the time at which all work so far is within the rate.

    Attributes:
        seconds: work so far.

    Args:
        rate: seconds of work per second in the long run; 0 for no limit.
        burst: seconds of work at once.
        totals: counters of the work of all clients.
        monotonic: returns the seconds of a steady clock.
        of_address: limit of all clients of the same address; None for an address itself.
    """

    __slots__ = ("_burst", "_monotonic", "_of_address", "_paid_at", "_rate", "_totals", "seconds")

    def __init__(
        self,
        rate: float,
        burst: float,
        totals: WorkTotals,
        monotonic: Callable[[], float],
        of_address: WorkLimit | None = None,
    ) -> None:
        self._rate = rate
        self._burst = burst / rate if rate else 0.0
        self._totals = totals
        self._monotonic = monotonic
        self._of_address = of_address
        self._paid_at = float("-inf")
        self.seconds = 0.0

    def add(self, seconds: float, kind: WorkKind) -> None:
        """Count work that has been done."""
        self._totals.seconds[kind] += seconds
        now = self._monotonic()
        self._charge(seconds, now)
        if self._of_address is not None:
            self._of_address._charge(seconds, now)

    def _charge(self, seconds: float, now: float) -> None:
        self.seconds += seconds
        if self._rate:
            paid_at = self._paid_at
            self._paid_at = (paid_at if paid_at > now else now) + seconds / self._rate

    @property
    def excess(self) -> float:
        """Seconds until the client and its address are within their rate again; 0.0 where they are."""
        excess = max(0.0, self._paid_at - self._monotonic() - self._burst)
        return excess if self._of_address is None else max(excess, self._of_address.excess)

    @property
    def is_forgotten(self) -> bool:
        """True if the account is as if no work had been done."""
        return self._paid_at <= self._monotonic()

    def note_wait(self) -> None:
        """Count that work waited for a turn of its own."""
        self._totals.waits += 1

    def refusal(self) -> tuple[str, float] | None:
        """Return why a page is refused now, and the seconds until it is not; None if it is served."""
        excess = self.excess
        if not excess:
            return None
        self._totals.refused += 1
        rate = f"{self._rate:g} seconds of work a second"
        return f"clients of this address cause more than {rate} (limits.work_per_second)", excess


class AddressQuotas:
    """Quotas of one address: leftovers of earlier clients, and the work of all.

    Both count towards the quotas of the next clients.
    """

    def __init__(self, work: WorkLimit) -> None:
        self.advertisements = Quota("advertisements", 0)
        self.kept = Quota("kept_bytes", 0)
        self.parameters = Quota("parameter_bytes", 0)
        self.work = work
        self.clients = 0

    @property
    def is_empty(self) -> bool:
        """True if no client is connected and nothing is left behind."""
        held = self.clients or self.advertisements.held or self.kept.held or self.parameters.held
        return not held and self.work.is_forgotten


class ClientQuotas:
    """Quotas of one client.

    Attributes:
        subscriptions: by topic and id.
        advertisements: topics, services and actions that it offers, and publishers that linger.
        calls: calls and goals under way.
        kept: bytes that the server keeps for it: requests under way, and samples of its latched topics.
        parameters: bytes of the parameters that it has set.
        work: that the server does for it.
    """

    __slots__ = ("_address", "advertisements", "calls", "kept", "parameters", "subscriptions", "work")

    def __init__(self, limits: ClientLimits, address: AddressQuotas, work: WorkLimit) -> None:
        self.subscriptions = Quota("subscriptions", limits.subscriptions)
        self.advertisements = Quota("advertisements", limits.advertisements, address.advertisements, 10)
        self.calls = Quota("calls", limits.calls)
        self.kept = Quota("kept_bytes", limits.kept_bytes, address.kept, 4, "bytes kept", together=True)
        self.parameters = Quota(
            "parameter_bytes",
            limits.parameter_bytes,
            address.parameters,
            2,
            "bytes of parameters",
            together=True,
        )
        self.work = work
        self._address = address
        address.clients += 1

    def leave(self) -> None:
        """Charge the remaining amounts to the client's address: the client has left."""
        self._address.clients -= 1
        self.advertisements.leave()
        self.kept.leave()
        self.parameters.leave()
