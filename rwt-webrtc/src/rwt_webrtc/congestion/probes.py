"""Probes: bursts of packets above the present rate, which find out whether the link carries more."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

PROBE_SECONDS: Final = 0.05
PROBE_PACKETS: Final = 6
PROBE_FACTOR: Final = 2.0
PROBE_LIMIT: Final = 1.25
"""Maximum rate of a probe, as a multiple of the maximum rate."""
PROBE_WAIT_SECONDS: Final = 4.0
MOST_PROBE_WAIT_SECONDS: Final = 8.0
PROBE_TIMEOUT_SECONDS: Final = 2.0
PROBE_LOSS: Final = 0.2
SATURATED: Final = 0.9
"""Ratio of the received to the sent rate of a probe below which it has filled the link."""
RAISED: Final = 1.1
"""Ratio of the found to the present rate below which a probe has found nothing."""
SETTLE_SECONDS: Final = 0.5
"""Time after a decrease or a probe before the next probe that follows a successful one."""


@dataclass(slots=True)
class Probe:
    """Burst of packets above the present rate.

    Attributes:
        rate: bits per second at which it is sent.
        size: bytes to send.
        began: time of its beginning.
        sent: departure and size of its packets, by number.
        arrived: departure, arrival and size of those that have arrived.
        is_complete: True if all of it was sent.
    """

    rate: float
    size: int
    began: float
    sent: dict[int, tuple[float, int]] = field(default_factory=dict)
    arrived: list[tuple[float, float, int]] = field(default_factory=list)
    is_complete: bool = False

    @property
    def count(self) -> int:
        return len(self.sent) + len(self.arrived)


class Prober:
    """Times of the probes of one sender, and what they find. Times in seconds of a steady clock.

    Attributes:
        probe: probe that is being sent or reported; None if there is none.
        began_at: time of the beginning of the last probe.
    """

    def __init__(self, now: float) -> None:
        self.probe: Probe | None = None
        self.began_at = now - SETTLE_SECONDS
        self._next_at = now
        self._wait_seconds = PROBE_WAIT_SECONDS

    def is_due(self, now: float) -> bool:
        """Return True if the next probe may begin. A probe without result counts as failed after a while."""
        if self.probe is not None:
            if now - self.probe.began < PROBE_TIMEOUT_SECONDS:
                return False
            self._fail(now)
        return now >= self._next_at

    def begin(self, target: float, most: float, now: float) -> Probe:
        rate = min(PROBE_FACTOR * target, PROBE_LIMIT * most)
        self.began_at = now
        self.probe = Probe(rate, round(rate * PROBE_SECONDS / 8), now)
        return self.probe

    def delay(self, now: float) -> None:
        """Wait before the next probe, since the rate was lowered."""
        self._next_at = max(self._next_at, now + self._wait_seconds)

    def schedule(self, at: float) -> None:
        """Allow the next probe at a time."""
        self._next_at = at

    def arrived(self, number: int, sent: float, arrived: float, size: int) -> None:
        """Note a packet that has arrived, if it is of the probe."""
        if self.probe is not None and self.probe.sent.pop(number, None) is not None:
            self.probe.arrived.append((sent, arrived, size))

    def found(self, target: float, now: float) -> float | None:
        """Return the rate that the probe has found, once most of its packets have arrived; None before, or if
        it is not above the target. Ends the probe.
        """
        probe = self.probe
        if probe is None or not probe.is_complete:
            return None
        if len(probe.arrived) < max(PROBE_PACKETS - 1, (1 - PROBE_LOSS) * probe.count):
            return None
        probe.arrived.sort()
        sent = probe.arrived[-1][0] - probe.arrived[0][0]
        times = [arrived for _, arrived, _ in probe.arrived]
        received = max(times) - min(times)
        if sent <= 0 or received <= 0:
            self._fail(now)
            return None
        # Of the burst as sent, the last packet is not in the measured time; of what was received, the first.
        bits = 8 * sum(size for _, _, size in probe.arrived)
        first, last = (8 * probe.arrived[each][2] for each in (0, -1))
        send_rate, receive_rate = (bits - last) / sent, (bits - first) / received
        is_saturated = receive_rate < SATURATED * send_rate
        rate = SATURATED * receive_rate if is_saturated else min(send_rate, receive_rate)
        if rate <= RAISED * target:
            self._fail(now)
            return None
        self.probe = None
        self._wait_seconds = PROBE_WAIT_SECONDS
        self._next_at = now + (PROBE_WAIT_SECONDS if is_saturated else SETTLE_SECONDS)
        return rate

    def _fail(self, now: float) -> None:
        self.probe = None
        self._next_at = now + self._wait_seconds
        self._wait_seconds = min(1.5 * self._wait_seconds, MOST_PROBE_WAIT_SECONDS)
