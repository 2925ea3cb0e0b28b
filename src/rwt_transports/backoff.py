"""Delays between attempts to connect or to restart."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass

_MOST_EXPONENT = 64
"""Limit of the exponent, against overflow of floats; the maximum delay is reached long before."""


@dataclass(frozen=True, slots=True)
class Backoff:
    """Exponential back-off with jitter.

    Attributes:
        first: seconds before the first attempt.
        factor: ratio of each delay to the one before.
        longest: maximum delay between two attempts, in seconds.
        jitter: the part of a wait, 0 to 1, of which a random share is left out, so that many clients of one
            robot do not reconnect at the same moment.
        attempts: number of attempts to make in a row; None never gives up.
    """

    first: float = 0.25
    factor: float = 2.0
    longest: float = 10.0
    jitter: float = 0.2
    attempts: int | None = None

    def delay(self, failures: int) -> float | None:
        """Return the delay after `failures` (1 or more) in a row, in seconds; None if all attempts are used
        up.
        """
        if self.attempts is not None and failures > self.attempts:
            return None
        delay = self.first * self.factor ** min(failures - 1, _MOST_EXPONENT)
        return min(delay, self.longest) * (1 - self.jitter * random.random())

    def delays(self) -> Iterator[float]:
        """Yield the delay before each attempt, in seconds."""
        failures = 1
        while (delay := self.delay(failures)) is not None:
            yield delay
            failures += 1
