"""What is counted about the messages of a topic: how often, how big, how late."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise


@dataclass(frozen=True, slots=True)
class Spread:
    """Some numbers in short.

    Attributes:
        mean: their mean.
        least: the smallest.
        most: the largest.
        deviation: their standard deviation (of all, not of a sample).
        number: how many.
    """

    mean: float
    least: float
    most: float
    deviation: float
    number: int


class Window:
    """The newest values of something, with the times at which they came.

    Args:
        longest: how many it holds.
    """

    def __init__(self, longest: int) -> None:
        self._seen: deque[tuple[float, float]] = deque(maxlen=longest)

    def __len__(self) -> int:
        return len(self._seen)

    def add(self, time: float, value: float) -> None:
        """One came at `time`, in seconds."""
        self._seen.append((time, value))

    def spread(self) -> Spread | None:
        """The values in short; None if there are none."""
        return spread([value for _, value in self._seen])

    def intervals(self) -> Spread | None:
        """The times between one and the next, in seconds; None if fewer than two came."""
        times = [time for time, _ in self._seen]
        return spread([later - earlier for earlier, later in pairwise(times)])

    def per_second(self, now: float) -> float:
        """The sum of the values a second, from the first of them until `now`."""
        if not self._seen or now <= self._seen[0][0]:
            return 0.0
        return sum(value for _, value in self._seen) / (now - self._seen[0][0])


def spread(values: list[float]) -> Spread | None:
    """Some numbers in short; None if there are none."""
    if not values:
        return None
    mean = math.fsum(values) / len(values)
    deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / len(values))
    return Spread(mean, min(values), max(values), deviation, len(values))


def in_bytes(number: float) -> str:
    """A number of bytes as people read it, in powers of 1000: ``1.23 MB``."""
    for unit in ("B", "KB", "MB"):
        if number < 1000:
            return f"{number:.0f} {unit}" if unit == "B" else f"{number:.2f} {unit}"
        number /= 1000
    return f"{number:.2f} GB"
