"""Times at which packets and frames may be sent, without I/O."""

from __future__ import annotations

import math
from typing import Final

FACTOR: Final = 2.5
"""Maximum rate of the packets of a frame, as a multiple of the average rate."""
BURST_SECONDS: Final = 0.005
"""Time that a late packet may be caught up with."""
AHEAD_SECONDS: Final = 0.1
"""Time by which frames may exceed the average rate: key frames are large."""
MOST_DEBT_SECONDS: Final = 1.0
"""Maximum time for which frames wait, whatever was sent."""


class Pacer:
    """Time at which packets and frames may be sent, in seconds of a steady clock."""

    def __init__(self) -> None:
        self._packet_at = 0.0
        self._debt_bits = 0.0
        self._rate = 1.0
        self._at = 0.0

    def sent(self, size: int, rate: float, now: float, burst_rate: float | None = None) -> None:
        """Count a packet.

        Args:
            burst_rate: bits per second now; None for :data:`FACTOR` times the average.
        """
        bits = 8 * size
        self._packet_at = max(self._packet_at, now - BURST_SECONDS) + bits / (burst_rate or FACTOR * rate)
        self._pay(rate, now)
        self._debt_bits = min(self._debt_bits + bits, MOST_DEBT_SECONDS * rate)

    def _pay(self, rate: float, now: float) -> None:
        # What is owed at a higher rate is in the queue of the link, which lowers the rate while it drains.
        owed = self._debt_bits * min(1.0, rate / self._rate)
        self._debt_bits = max(0.0, owed - rate * (now - self._at))
        self._rate, self._at = rate, now

    def packet_delay(self, now: float) -> float:
        """Return the seconds until the next packet."""
        return max(0.0, self._packet_at - now)

    def frame_delay(self, rate: float, now: float) -> float:
        """Return the seconds until the next frame at an average rate."""
        self._pay(rate, now)
        return max(0.0, self._debt_bits / rate - AHEAD_SECONDS)


class RateMeter:
    """Rate over about the last second; times in seconds of a steady clock."""

    def __init__(self) -> None:
        self._bits = 0.0
        self._at = 0.0

    def add(self, bits: float, now: float) -> None:
        self._bits, self._at = self.rate(now) + bits, now

    def rate(self, now: float) -> float:
        """Return the bits per second."""
        return self._bits * math.exp(self._at - now)
