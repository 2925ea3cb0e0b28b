"""Alignment of recorded topics to the frames of a dataset."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from rwt_interfaces.times import NANOSECONDS

_LEAST_GAP_NS: Final = NANOSECONDS // 2
_GAP_FRAMES: Final = 3

Span = tuple[int, int]
"""First and last time, nanoseconds."""


def longest_gap_ns(fps: int) -> int:
    """Return the time without a message that ends an episode: half a second, and at least three frames."""
    return max(_LEAST_GAP_NS, _GAP_FRAMES * NANOSECONDS // fps)


class Spans:
    """Times in which a topic had messages, without longer gaps.

    Attributes:
        found: spans so far, in order.
    """

    def __init__(self, gap_ns: int) -> None:
        self._gap_ns = gap_ns
        self.found: list[Span] = []

    def add(self, at: int) -> None:
        """Add the time of a message; times are given in order."""
        if self.found and at - self.found[-1][1] <= self._gap_ns:
            self.found[-1] = self.found[-1][0], at
        else:
            self.found.append((at, at))


def overlaps(one: Sequence[Span], other: Sequence[Span]) -> list[Span]:
    """Return the spans that are in both."""
    found = ((max(a, c), min(b, d)) for a, b in one for c, d in other)
    return sorted(span for span in found if span[0] <= span[1])


def frame_times(span: Span, fps: int) -> Iterator[int]:
    """Yield the time of each frame; the first is at the beginning of the span."""
    for index in range((span[1] - span[0]) * fps // NANOSECONDS + 2):
        at = span[0] + index * NANOSECONDS // fps
        if at <= span[1]:
            yield at
