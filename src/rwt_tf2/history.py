"""History of a frame's transforms to its parent."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass

from rwt_tf2.transform import Transform

#: Number of expired entries that are removed at once.
_COMPACT_AT = 64


@dataclass(frozen=True, slots=True)
class Edge:
    """Transform of a frame to its parent at some time."""

    parent: str
    transform: Transform


class MovingTrack:
    """Transforms of a moving frame, sorted by time; those older than `keep_ns` are dropped."""

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
        """Time of the first transform."""
        return self._stamps[self._first]

    @property
    def latest_ns(self) -> int:
        """Time of the last transform."""
        return self._stamps[-1]

    @property
    def latest(self) -> Edge:
        """Last transform."""
        return self._edges[-1]

    def add(self, stamp_ns: int, edge: Edge) -> bool:
        """Add a transform, replacing one of the same time. Returns False if it is too old."""
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
        """True if the time needs no extrapolation."""
        return self.earliest_ns <= time_ns <= self.latest_ns

    def parent_at(self, time_ns: int) -> str:
        """Return the parent at a covered time."""
        return self._edges[bisect_right(self._stamps, time_ns, self._first) - 1].parent

    def at(self, time_ns: int) -> Transform:
        """Return the interpolated transform at a covered time. Between two parents, hold the earlier one."""
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
        """Yield the times and transforms needed to interpolate between two covered times."""
        first = bisect_right(self._stamps, first_ns, self._first) - 1
        last = bisect_left(self._stamps, last_ns, self._first)
        for place in range(first, last + 1):
            yield self._stamps[place], self._edges[place]

    def rate(self) -> float:
        """Return the transforms per second; 0 if there are fewer than two."""
        span = self.latest_ns - self.earliest_ns
        return (len(self) - 1) * 1e9 / span if span else 0.0


class StaticTrack:
    """Static transform, valid at all times."""

    is_static = True
    latest_ns = 0
    earliest_ns = 0

    def __init__(self, edge: Edge) -> None:
        self.latest = edge

    def covers(self, time_ns: int) -> bool:
        """True for every time."""
        return True

    def parent_at(self, time_ns: int) -> str:
        """Return the parent."""
        return self.latest.parent

    def at(self, time_ns: int) -> Transform:
        """Return the transform."""
        return self.latest.transform

    def rate(self) -> float:
        """Return 0: a static transform is not repeated."""
        return 0.0
