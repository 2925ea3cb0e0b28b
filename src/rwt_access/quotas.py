"""How much one client may hold, and how fast it may act."""

from __future__ import annotations

from rwt_access.errors import QuotaExceeded


class Quota:
    """How many of one kind of thing a client holds, and may hold.

    Attributes:
        held: how many it holds now.

    Args:
        setting: the key below `limits` that says how many it may hold, which is also what they are called.
        most: how many it may hold.
    """

    __slots__ = ("_most", "_setting", "held")

    def __init__(self, setting: str, most: int) -> None:
        self._setting = setting
        self._most = most
        self.held = 0

    def take(self) -> None:
        """Count one more.

        Raises:
            QuotaExceeded: the client holds as many as it may.
        """
        if self.held >= self._most:
            raise QuotaExceeded(
                f"this client has {self.held} {self._setting}, "
                f"and {self._most} is the limit (limits.{self._setting})"
            )
        self.held += 1

    def give_back(self, count: int = 1) -> None:
        """Count some less."""
        self.held -= count


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
