"""Delay of packets: overuse detection by its gradient, and the standing queue.

The gradient is that of draft-ietf-rmcat-gcc-02 section 5, with the trendline filter of libwebrtc in place of
the Kalman filter.
"""

from __future__ import annotations

from collections import deque
from enum import Enum
from typing import Final

GROUP_SECONDS: Final = 0.005
"""Packets sent within this time count as one group."""
WINDOW: Final = 20
"""Groups of which the trend is computed."""
SMOOTHING: Final = 0.9
GAIN: Final = 4.0
MOST_DELTAS: Final = 60
OVERUSE_SECONDS: Final = 0.01
THRESHOLD_MS: Final = 12.5
LEAST_THRESHOLD_MS: Final = 6.0
MOST_THRESHOLD_MS: Final = 600.0
THRESHOLD_RISE: Final = 0.0087
THRESHOLD_FALL: Final = 0.039
OUTLIER_MS: Final = 15.0
BASE_SECONDS: Final = 10.0
"""Time for which the shortest delay is remembered: routes and clocks change."""
STANDING_SECONDS: Final = 0.2


class Usage(Enum):
    """State of the link."""

    NORMAL = "normal"
    OVERUSED = "overused"
    UNDERUSED = "underused"


class OveruseDetector:
    """Detector of growing delay."""

    def __init__(self) -> None:
        self.usage = Usage.NORMAL
        self._group: tuple[float, float, float] | None = None  # first and last departure, last arrival
        self._before: tuple[float, float] | None = None  # departure and arrival of the group before
        self._points: deque[tuple[float, float]] = deque(maxlen=WINDOW)
        self._count = 0
        self._sum_ms = 0.0
        self._smoothed_ms = 0.0
        self._threshold_ms = THRESHOLD_MS
        self._over_s = 0.0
        self._over_count = 0
        self._trend = 0.0

    def add(self, sent: float, arrived: float) -> None:
        """Add a packet, in order of departure; times in seconds of any two clocks."""
        if self._group is None:
            self._group = (sent, sent, arrived)
        elif sent - self._group[0] <= GROUP_SECONDS:
            self._group = (self._group[0], sent, max(arrived, self._group[2]))
        else:
            _, departure, arrival = self._group
            if self._before is not None:
                self._add_group(departure - self._before[0], arrival - self._before[1], arrival)
            self._before = (departure, arrival)
            self._group = (sent, sent, arrived)

    def _add_group(self, sent_delta: float, delta: float, arrival: float) -> None:
        self._count = min(self._count + 1, MOST_DELTAS)
        self._sum_ms += 1000 * (delta - sent_delta)
        self._smoothed_ms = SMOOTHING * self._smoothed_ms + (1 - SMOOTHING) * self._sum_ms
        self._points.append((1000 * arrival, self._smoothed_ms))
        if len(self._points) == WINDOW:
            self._detect(self._count * GAIN * _slope(self._points), max(sent_delta, 0.0))

    def _detect(self, trend: float, delta: float) -> None:
        if trend > self._threshold_ms:
            self._over_s += delta if self._over_count else delta / 2
            self._over_count += 1
            if self._over_s > OVERUSE_SECONDS and self._over_count > 1 and trend >= self._trend:
                self.usage = Usage.OVERUSED
                self._over_s, self._over_count = 0.0, 0
        else:
            self._over_s, self._over_count = 0.0, 0
            self.usage = Usage.UNDERUSED if trend < -self._threshold_ms else Usage.NORMAL
        self._trend = trend
        distance = abs(trend) - self._threshold_ms
        if distance <= OUTLIER_MS:
            rate = THRESHOLD_RISE if distance > 0 else THRESHOLD_FALL
            threshold = self._threshold_ms + rate * distance * min(1000 * delta, 100.0)
            self._threshold_ms = min(max(threshold, LEAST_THRESHOLD_MS), MOST_THRESHOLD_MS)


def _slope(points: deque[tuple[float, float]]) -> float:
    """Return the slope of the line of least squares."""
    mean_x = sum(x for x, _ in points) / len(points)
    mean_y = sum(y for _, y in points) / len(points)
    spread = sum((x - mean_x) ** 2 for x, _ in points)
    return sum((x - mean_x) * (y - mean_y) for x, y in points) / spread if spread else 0.0


class QueueDelay:
    """Delay of the standing queue: the least of the last packets above the least of some seconds.

    Jitter delays some packets, a queue all of them.
    """

    def __init__(self) -> None:
        self._base: deque[tuple[float, float]] = deque()
        self._recent: deque[tuple[float, float]] = deque()

    def add(self, sent: float, arrived: float) -> None:
        delay = arrived - sent
        for window, seconds in ((self._base, BASE_SECONDS), (self._recent, STANDING_SECONDS)):
            # Minimum of a sliding window: what is not less than a newer value never becomes the least.
            while window and window[-1][1] >= delay:
                window.pop()
            window.append((arrived, delay))
            while window[0][0] < arrived - seconds:
                window.popleft()

    @property
    def seconds(self) -> float:
        return self._recent[0][1] - self._base[0][1] if self._recent else 0.0
