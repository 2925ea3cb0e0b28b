"""Packets that a sender has sent, and what its receiver has reported about them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from itertools import islice, takewhile
from typing import Final

from rwt_webrtc.congestion.feedback import REFERENCE_SECONDS, REFERENCES, Feedback

HISTORY: Final = 4096
"""Packets without report that are kept."""
LATE_SECONDS: Final = 0.3
"""Time after which a packet that was reported missing counts as lost: packets overtake each other."""
RECEIVED_SECONDS: Final = 0.5
DELIVERIES: Final = 8
"""Number of the last arrivals whose rate is that at which the link delivers."""
LOSS_SECONDS: Final = 1.0
LOSS_PACKETS: Final = 20
LOSS_WINDOWS: Final = 5
MOST_LOSS: Final = 0.3
"""Loss of the link itself that does not lower the rate, at most."""


class SentPackets:
    """Packets that were sent and are not reported yet. Times in seconds of a steady clock."""

    def __init__(self) -> None:
        self._number = 0
        self._waiting: dict[int, tuple[float, int]] = {}
        self._missing: dict[int, float] = {}
        self._reference: int | None = None

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, size: int, now: float) -> int:
        """Add a packet; returns its transport-wide number."""
        number = self._number
        self._number = (number + 1) % 65536
        self._waiting[number] = (now, size)
        if len(self._waiting) > HISTORY:
            self._waiting.pop(next(iter(self._waiting)))
        return number

    def arrivals(self, feedback: Feedback, now: float) -> Iterator[tuple[int, float, float, int]]:
        """Remove the packets that have arrived: number, departure, arrival and size of each."""
        origin = self._origin(feedback.reference)
        for offset, since in enumerate(feedback.arrivals):
            number = (feedback.base + offset) % 65536
            if number not in self._waiting:
                continue
            if since is None:
                self._missing.setdefault(number, now)
                continue
            sent, size = self._waiting.pop(number)
            self._missing.pop(number, None)
            yield number, sent, origin + since, size

    def _origin(self, reference: int) -> float:
        """Return the seconds of a reference time, which is cyclic."""
        before = reference if self._reference is None else self._reference
        step = (reference - before + REFERENCES // 2) % REFERENCES - REFERENCES // 2
        self._reference = before + step
        return self._reference * REFERENCE_SECONDS

    def remove_lost(self, now: float) -> int:
        """Remove the packets that were reported missing for a while; returns their number."""
        late = [number for number, since in self._missing.items() if now - since > LATE_SECONDS]
        for number in late:
            del self._missing[number]
        return sum(self._waiting.pop(number, None) is not None for number in late)

    def bytes_after(self, sent: float) -> int:
        """Return the bytes of the packets that were sent after a time and are not reported."""
        later = takewhile(lambda packet: packet[0] > sent, reversed(self._waiting.values()))
        return sum(size for _, size in later)


class ReceivedRate:
    """Rate at which packets have lately arrived, by the receiver's clock."""

    def __init__(self) -> None:
        self._arrivals: deque[tuple[float, int]] = deque()
        self._bytes = 0

    def add(self, arrived: float, size: int) -> None:
        arrivals = self._arrivals
        arrivals.append((arrived, size))
        self._bytes += size
        while arrivals[0][0] < arrived - RECEIVED_SECONDS:
            self._bytes -= arrivals.popleft()[1]

    @property
    def bits(self) -> float:
        """Bits per second over :data:`RECEIVED_SECONDS`."""
        return 8 * self._bytes / RECEIVED_SECONDS

    @property
    def delivery_bits(self) -> float:
        """Bits per second of the last arrivals; infinite if there are too few."""
        last = list(islice(reversed(self._arrivals), DELIVERIES))
        times = [arrived for arrived, _ in last]
        seconds = max(times) - min(times)
        if len(last) < DELIVERIES or not seconds:
            return math.inf
        return 8 * sum(size for _, size in last) / seconds


class LossWindow:
    """Part of the packets that is lost, by windows of about a second."""

    def __init__(self, now: float) -> None:
        self._lost = self._delivered = 0
        self._began_at = now
        self._fractions: deque[float] = deque([0.0] * LOSS_WINDOWS, maxlen=LOSS_WINDOWS)

    def add(self, delivered: int, lost: int) -> None:
        self._delivered += delivered
        self._lost += lost

    def close(self, now: float) -> tuple[float, float] | None:
        """Begin the next window if this one is over: its loss, and the loss at every rate; None if it is not.

        What is lost at every rate is not congestion.
        """
        count = self._lost + self._delivered
        if now - self._began_at < LOSS_SECONDS or count < LOSS_PACKETS:
            return None
        fraction, inherent = self._lost / count, min(*self._fractions, MOST_LOSS)
        self._fractions.append(fraction)
        self._lost = self._delivered = 0
        self._began_at = now
        return fraction, inherent
