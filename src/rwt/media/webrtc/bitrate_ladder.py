"""Which of a few bit rates a viewer gets, by what its receiver says of the line."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

RUNGS: Final = (1.0, 0.35, 0.12)
"""The bit rates of a topic's videos, as parts of the one that was asked for. All viewers of a topic, a size
and a rate share them: there are no more encoders than these."""
WINDOW_SECONDS: Final = 1.0
QUIET: Final = 30_000
"""Bits a second below which nothing is concluded: an image that stands still needs no more."""
MARGIN: Final = 1.3
"""The estimate must be above what is sent by so much, for all of the patience, before more is tried."""
PATIENCE_SECONDS: Final = 5.0
MOST_PATIENCE_SECONDS: Final = 60.0
LOSS: Final = 0.1
"""Part of the packets lost from which on less is sent (draft-ietf-rmcat-gcc section 6)."""
KEYS: Final = 5
"""Key frames that a viewer may ask for in :data:`KEY_SECONDS` before less is sent to it: they are large,
and go to everybody who shares its encoder."""
KEY_SECONDS: Final = 10.0
KEY_PAUSE_SECONDS: Final = 0.5
"""Receivers ask again and again until the one key frame has come."""
SETTLE_SECONDS: Final = 1.5
"""After a change nothing is concluded for so long: reports are of what was sent before."""


class BitrateLadder:
    """Follows the feedback of one viewer.

    A receiver's estimate (REMB) rises no higher than somewhat above what it gets, and falls below that when
    the line is full. So it is compared with what is sent, and not with what was meant to be.

    Args:
        rates: bits a second of each rung, the most first.

    Attributes:
        rung: which one to send, 0 the best.
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
        """So many bytes have been sent."""
        self._sent.append((now, size))
        self._forget(now)

    def rate(self, now: float) -> float:
        """Bits a second that are sent now."""
        self._forget(now)
        return 8 * sum(size for _, size in self._sent) / WINDOW_SECONDS

    def _forget(self, now: float) -> None:
        while self._sent and self._sent[0][0] < now - WINDOW_SECONDS:
            self._sent.popleft()

    def estimated(self, bits: int, now: float) -> None:
        """The receiver's estimate of what the line carries, bits a second."""
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
        """The part of the last packets that has not arrived, 0 to 1."""
        if fraction > LOSS and now - self._changed_at >= SETTLE_SECONDS:
            self._lower(self.rung + 1, now)

    def asked_for_key(self, now: float) -> None:
        """The receiver has lost so much that it can show nothing before the next key frame."""
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
            # What was tried and did not hold is tried again later, and later each time.
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
