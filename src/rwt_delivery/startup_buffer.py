"""The samples of a publisher's first second, kept for readers that subscribe late (ADV-08)."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt_graph.api import Sample

SECONDS: Final = 1.0
"""How long after its creation a publisher's samples are kept for readers that come late."""

_MOST_SAMPLES: Final = 100
_MOST_BYTES: Final = 64 * 1024


class StartupBuffer:
    """The samples of one publisher's first second, the newest of them where they are many or large.

    A program that advertises and publishes at once cannot know whether its readers have subscribed yet.
    """

    __slots__ = ("_samples", "_size")

    def __init__(self) -> None:
        self._samples: deque[tuple[Sample, int]] = deque()
        self._size = 0

    def add(self, sample: Sample, size: int) -> None:
        """Keep a sample of `size` bytes, and forget older ones for it; all of them for one that is too large.

        To keep one is to copy it out of its receive buffer, which large streams must not pay for.
        """
        if size > _MOST_BYTES:
            self._samples.clear()
            self._size = 0
            return
        self._samples.append((sample.detach(), size))
        self._size += size
        while len(self._samples) > _MOST_SAMPLES or self._size > _MOST_BYTES:
            self._size -= self._samples.popleft()[1]

    def samples(self) -> tuple[Sample, ...]:
        """What is kept, oldest first."""
        return tuple(sample for sample, _ in self._samples)
