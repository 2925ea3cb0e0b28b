"""When to try again."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Backoff:
    """How long to wait before each attempt to connect again.

    Attributes:
        first: seconds before the first attempt.
        factor: by how much each wait is longer than the one before.
        longest: most seconds between two attempts.
        jitter: by what part a wait is made shorter or longer at random, so that many clients of one robot do
            not come back in the same moment.
        attempts: how many attempts to make in a row; None never gives up.
    """

    first: float = 0.25
    factor: float = 2.0
    longest: float = 10.0
    jitter: float = 0.2
    attempts: int | None = None

    def delays(self) -> Iterator[float]:
        """The waits, in seconds."""
        delay = self.first
        count = 0
        while self.attempts is None or count < self.attempts:
            count += 1
            yield delay * random.uniform(1 - self.jitter, 1 + self.jitter)
            delay = min(delay * self.factor, self.longest)
