"""Bitrate ladder: selects one of a few encodings for a viewer by the rate of its link."""

from __future__ import annotations

from collections import deque
from typing import Final

RUNGS: Final = (1.0, 0.4, 0.16)
"""Maximum bit rates of the encodings as parts of the requested one. All viewers with equal requests share
them, so there is at most one encoder per rung; its bit rate follows the slowest of its viewers."""
SCALES: Final = (1.0, 0.75, 0.5)
"""Factors of width and height: 640, 480 and 320 pixels of a common camera."""
DOWN: Final = 0.9
UP: Final = 1.25
"""Ratios to a rung's maximum at which a viewer steps down to it, and up from it."""
UP_SECONDS: Final = 1.0
"""Time for which the rate has to suffice for a step up: each step costs a key frame."""
KEYS: Final = 5
"""Number of requests for key frames within :data:`KEY_SECONDS` that steps down: key frames are large, and go
to all viewers of the encoder."""
KEY_SECONDS: Final = 10.0
KEY_PAUSE_SECONDS: Final = 0.5
"""Receivers repeat a request until the key frame arrives: repeats within this time count once."""
BAN_SECONDS: Final = 30.0
"""Time for which such a receiver stays on a lower rung."""


class BitrateLadder:
    """Bitrate ladder of one viewer.

    Args:
        best: requested bit rate.

    Attributes:
        rung: index of the encoding to send, 0 for the best.
    """

    def __init__(self, best: int) -> None:
        self._best = best
        self.rung = 0
        self._good_since: float | None = None
        self._keys: deque[float] = deque(maxlen=KEYS)
        self._banned: tuple[int, float] = (0, 0.0)

    def bitrate(self, rate: float) -> int:
        """Return the bit rate of the present encoding at a rate of the link."""
        return round(min(rate, self._best * RUNGS[self.rung]))

    def choose(self, rate: float, now: float) -> None:
        """Select the encoding for a rate of the link in bits per second."""
        lowest, until = self._banned
        wanted = self.rung
        while wanted + 1 < len(RUNGS) and rate < DOWN * self._best * RUNGS[wanted + 1]:
            wanted += 1
        if wanted != self.rung:
            self.rung, self._good_since = wanted, None
        elif self._may_rise(rate) and not (now < until and self.rung <= lowest):
            if self._good_since is None:
                self._good_since = now
            elif now - self._good_since >= UP_SECONDS:
                self.rung, self._good_since = self.rung - 1, None
        else:
            self._good_since = None

    def _may_rise(self, rate: float) -> bool:
        return self.rung > 0 and rate > UP * self._best * RUNGS[self.rung]

    def asked_for_key(self, now: float) -> None:
        """Handle a request for a key frame."""
        keys = self._keys
        if keys and now - keys[-1] < KEY_PAUSE_SECONDS:
            return
        if len(keys) == KEYS and now - keys[0] < KEY_SECONDS:
            keys.clear()
            self.rung = min(self.rung + 1, len(RUNGS) - 1)
            self._banned, self._good_since = (self.rung, now + BAN_SECONDS), None
        keys.append(now)
