"""Pacing of packets: no bursts, and no more on average than the rate."""

from __future__ import annotations

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
    """Time at which packets and frames may be sent, in seconds of a steady clock.

    What is owed is kept as a time: a lower rate does not lengthen it, since a queue that was filled before
    lowers the rate itself while it drains.
    """

    def __init__(self) -> None:
        self._packet_at = 0.0
        self._paid_at = 0.0

    def sent(self, size: int, rate: float, now: float, burst_rate: float | None = None) -> None:
        """Count a packet.

        Args:
            size: bytes.
            rate: bits per second on average.
            burst_rate: bits per second now; None for :data:`FACTOR` times the average.
        """
        bits = 8 * size
        self._packet_at = max(self._packet_at, now - BURST_SECONDS) + bits / (burst_rate or FACTOR * rate)
        self._paid_at = min(max(self._paid_at, now) + bits / rate, now + MOST_DEBT_SECONDS)

    def packet_delay(self, now: float) -> float:
        """Return the seconds until the next packet."""
        return max(0.0, self._packet_at - now)

    def frame_delay(self, now: float) -> float:
        """Return the seconds until the next frame."""
        return max(0.0, self._paid_at - now - AHEAD_SECONDS)
