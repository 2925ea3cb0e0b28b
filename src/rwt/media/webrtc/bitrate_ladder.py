"""Bit rate ladder: selects one of a few bit rates for a viewer by the feedback of its receiver."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

RUNGS: Final = (1.0, 0.35, 0.12)
"""Bit rates as parts of the requested one. All viewers with equal requests share them, so there is at most
one encoder per rung."""
WINDOW_SECONDS: Final = 1.0
QUIET: Final = 30_000
"""Bits per second below which feedback is ignored: a still image needs no more."""
MARGIN: Final = 1.3
"""Required ratio of the estimate to the sent rate, during the whole patience, for a step up."""
PATIENCE_SECONDS: Final = 5.0
MOST_PATIENCE_SECONDS: Final = 60.0
LOSS: Final = 0.1
"""Packet loss above which the rate steps down (draft-ietf-rmcat-gcc section 6)."""
KEYS: Final = 5
"""Number of requests for key frames within :data:`KEY_SECONDS` that steps down: key frames are large, and go
to all viewers of the encoder."""
KEY_SECONDS: Final = 10.0
KEY_PAUSE_SECONDS: Final = 0.5
"""Receivers repeat a request until the key frame arrives: repeats within this time count once."""
SETTLE_SECONDS: Final = 1.5
"""Seconds after a change in which feedback is ignored: it is about the former rate."""


class BitrateLadder:
    """Bit rate ladder of one viewer.

    A receiver's estimate (REMB) stays slightly above the received rate, and falls below it on congestion. So
    it is compared with the rate that is sent, not with the target.

    Args:
        rates: bits per second of each rung, in descending order.

    Attributes:
        rung: index of the rate to send, 0 for the highest.
    """

    def __init__(self, rates: Sequence[int]) -> None:
        self._rates = tuple(rates)
        self.rung = 0
        self._sent: deque[tuple[float, int]] = deque()
        self._changed_at = 0.0
        self._good_since: float | None = None
        self._patience = PATIENCE_SECONDS
        self._keys: deque[float] = deque(maxlen=KEYS)

    def sent(self, size: int, now: float) -> None:
        """Count bytes that were sent."""
        self._sent.append((now, size))
        self._forget(now)

    def rate(self, now: float) -> float:
        """Return the present rate in bits per second."""
        self._forget(now)
        return 8 * sum(size for _, size in self._sent) / WINDOW_SECONDS

    def _forget(self, now: float) -> None:
        while self._sent and self._sent[0][0] < now - WINDOW_SECONDS:
            self._sent.popleft()

    def estimated(self, bits: int, now: float) -> None:
        """Handle the receiver's bandwidth estimate in bits per second."""
        rate = self.rate(now)
        if now - self._changed_at < SETTLE_SECONDS or rate < QUIET:
            return
        if bits < rate:
            fitting = [
                rung
                for rung in range(self.rung + 1, len(self._rates))
                if rate * self._rates[rung] / self._rates[self.rung] <= bits
            ]
            self._lower(fitting[0] if fitting else len(self._rates) - 1, now)
        elif bits >= MARGIN * rate:
            self._good(now)
        else:
            self._good_since = None

    def lost(self, fraction: float, now: float) -> None:
        """Handle a report of packet loss, 0 to 1."""
        if fraction > LOSS and now - self._changed_at >= SETTLE_SECONDS:
            self._lower(self.rung + 1, now)

    def asked_for_key(self, now: float) -> None:
        """Handle a request for a key frame."""
        keys = self._keys
        if keys and now - keys[-1] < KEY_PAUSE_SECONDS:
            return
        if len(keys) == KEYS and now - keys[0] < KEY_SECONDS:
            keys.clear()
            self._lower(self.rung + 1, now)
        keys.append(now)

    def _lower(self, rung: int, now: float) -> None:
        self._good_since = None
        if rung < len(self._rates) and rung != self.rung:
            # Exponential back-off of the next step up.
            self._patience = min(2 * self._patience, MOST_PATIENCE_SECONDS)
            self.rung = rung
            self._changed_at = now

    def _good(self, now: float) -> None:
        if self.rung == 0:
            self._patience = PATIENCE_SECONDS
            return
        if self._good_since is None:
            self._good_since = now
        elif now - self._good_since >= self._patience:
            self.rung -= 1
            self._changed_at = now
            self._good_since = None
