"""One frame's transforms to its parent, over time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass

from rwt_tf2.transform import Transform

#: Dead entries at the front that are taken out together.
_COMPACT_AT = 64


@dataclass(frozen=True, slots=True)
class Edge:
    """A frame's transform to its parent at some time."""

    parent: str
    transform: Transform


class History:
    """The transforms of one frame that moves, sorted by time; what is older than `keep_ns` goes."""

    is_static = False

    def __init__(self, keep_ns: int) -> None:
        self._keep_ns = keep_ns
        self._stamps: list[int] = []
        self._edges: list[Edge] = []
        self._first = 0

    def __len__(self) -> int:
        return len(self._stamps) - self._first

    @property
    def earliest_ns(self) -> int:
        """The time of the first transform."""
        return self._stamps[self._first]

    @property
    def latest_ns(self) -> int:
        """The time of the last transform."""
        return self._stamps[-1]

    @property
    def latest(self) -> Edge:
        """The last transform."""
        return self._edges[-1]

    def add(self, stamp_ns: int, edge: Edge) -> bool:
        """Keep a transform, one of the same time gives way; False when it is too old."""
        stamps = self._stamps
        if not stamps or stamp_ns > stamps[-1]:
            stamps.append(stamp_ns)
            self._edges.append(edge)
            self._prune()
            return True
        if stamp_ns < stamps[-1] - self._keep_ns:
            return False
        place = bisect_left(stamps, stamp_ns, self._first)
        if stamps[place] == stamp_ns:
            self._edges[place] = edge
        else:
            stamps.insert(place, stamp_ns)
            self._edges.insert(place, edge)
        return True

    def _prune(self) -> None:
        stamps, oldest = self._stamps, self._stamps[-1] - self._keep_ns
        first = self._first
        while stamps[first] < oldest:
            first += 1
        self._first = first
        if first > _COMPACT_AT and first * 2 > len(stamps):
            del stamps[:first], self._edges[:first]
            self._first = 0

    def covers(self, time_ns: int) -> bool:
        """Whether nothing has to be extrapolated."""
        return self.earliest_ns <= time_ns <= self.latest_ns

    def parent_at(self, time_ns: int) -> str:
        """Whose child it was; the time is covered."""
        return self._edges[bisect_right(self._stamps, time_ns, self._first) - 1].parent

    def at(self, time_ns: int) -> Transform:
        """Interpolated; the time is covered. Between two parents the earlier one's holds on."""
        after = bisect_left(self._stamps, time_ns, self._first)
        later = self._edges[after]
        later_ns = self._stamps[after]
        if later_ns == time_ns:
            return later.transform
        earlier, earlier_ns = self._edges[after - 1], self._stamps[after - 1]
        if earlier.parent != later.parent:
            return earlier.transform
        fraction = (time_ns - earlier_ns) / (later_ns - earlier_ns)
        return earlier.transform.interpolated(later.transform, fraction)

    def between(self, first_ns: int, last_ns: int) -> Iterator[tuple[int, Edge]]:
        """What interpolation between two covered times needs: times and transforms."""
        first = bisect_right(self._stamps, first_ns, self._first) - 1
        last = bisect_left(self._stamps, last_ns, self._first)
        for place in range(first, last + 1):
            yield self._stamps[place], self._edges[place]

    def rate(self) -> float:
        """Transforms a second; 0 where there are fewer than two."""
        span = self.latest_ns - self.earliest_ns
        return (len(self) - 1) * 1e9 / span if span else 0.0


class Fixed:
    """The transform of a frame that does not move: one, for all times."""

    is_static = True
    latest_ns = 0
    earliest_ns = 0

    def __init__(self, edge: Edge) -> None:
        self.latest = edge

    def covers(self, time_ns: int) -> bool:
        """It does."""
        return True

    def parent_at(self, time_ns: int) -> str:
        """Whose child it is."""
        return self.latest.parent

    def at(self, time_ns: int) -> Transform:
        """The transform."""
        return self.latest.transform

    def rate(self) -> float:
        """It is not repeated."""
        return 0.0
