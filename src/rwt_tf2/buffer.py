"""The buffer: a tree of frames over time, and the questions it answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from rwt_tf2 import listing
from rwt_tf2.errors import (
    ConnectivityError,
    ExtrapolationError,
    InvalidTransform,
    LookupFailed,
    LoopRefused,
    StaleTransform,
    UnknownFrame,
)
from rwt_tf2.history import Edge, Fixed, History
from rwt_tf2.times import NANOSECONDS, seconds
from rwt_tf2.transform import IDENTITY, StampedTransform, Transform, bare, checked

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

Track = History | Fixed

CACHE_NS: Final = 10 * NANOSECONDS
"""How long a transform is kept by default, as in tf2."""

MOST_FRAMES: Final = 10_000
"""More are refused: a stream of ever new names must not fill the memory."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a transform can be had; true or false itself.

    Attributes:
        reason: why not; empty if it can.
    """

    reason: str = ""

    def __bool__(self) -> bool:
        return not self.reason


@dataclass(frozen=True, slots=True)
class _Path:
    """The way from a source up to the common ancestor, and from the target up to it."""

    from_source: tuple[Track, ...]
    from_target: tuple[Track, ...]


class Buffer:
    """Transforms of the last seconds, by frame.

    Frames are named without a leading slash; one is removed wherever it stands (TFR-03). Times are integers,
    nanoseconds. As in tf2 a time of 0 asks for the latest that all transforms on the way have; so does None.

    Args:
        cache_ns: how long a transform is kept after a newer one of its frame has come.
    """

    def __init__(self, cache_ns: int = CACHE_NS) -> None:
        self.cache_ns = cache_ns
        self._tracks: dict[str, Track] = {}
        self._names: set[str] = set()

    # Filling

    def set_transform(self, stamped: StampedTransform, *, static: bool = False) -> None:
        """Keep a transform.

        A static one holds for all times, whatever its stamp. The kind of the last one that came wins: a frame
        that was static and now moves, moves.

        Raises:
            InvalidTransform: an empty frame, a frame to itself, a number that is not finite, a rotation
                that is not a unit quaternion, or too many frames; says which frame.
            LoopRefused: it would make a frame its own ancestor.
            StaleTransform: it is older than what is kept of its frame.
        """
        parent, child = bare(stamped.parent), bare(stamped.child)
        transform = checked(parent, child, stamped.transform)
        self._check_room(parent, child)
        track = self._tracks.get(child)
        if track is None or track.latest.parent != parent:
            self._check_loop(parent, child)
        edge = Edge(parent, transform)
        if static:
            self._tracks[child] = Fixed(edge)
        elif isinstance(track, History):
            if not track.add(stamped.stamp_ns, edge):
                raise StaleTransform(
                    _too_old(parent, child, stamped.stamp_ns, track.latest_ns, self.cache_ns)
                )
        else:
            track = self._tracks[child] = History(self.cache_ns)
            track.add(stamped.stamp_ns, edge)
        self._names.add(parent)
        self._names.add(child)

    def _check_room(self, parent: str, child: str) -> None:
        new = {parent, child} - self._names
        if new and len(self._names) + len(new) > MOST_FRAMES:
            raise InvalidTransform(f"{parent} <- {child}: there are {MOST_FRAMES} frames already")

    def _check_loop(self, parent: str, child: str) -> None:
        """There are no loops yet, and one parent each: only the way up from `parent` can close one."""
        way, frame = [parent], parent
        while (track := self._tracks.get(frame)) is not None and frame != child:
            frame = track.latest.parent
            way.append(frame)
        if frame == child:
            loop = " <- ".join([*reversed(way), child])
            raise LoopRefused(f"{parent} <- {child} would close a loop: {loop}")

    def clear(self) -> None:
        """Forget what moves; static transforms stay, as in tf2."""
        self._tracks = {child: track for child, track in self._tracks.items() if track.is_static}
        self._names = set(self._tracks).union(track.latest.parent for track in self._tracks.values())

    # Asking

    def lookup_transform(self, target: str, source: str, time_ns: int | None = None) -> StampedTransform:
        """What takes points of `source` to `target`.

        Args:
            time_ns: when; None or 0 for the latest common time.

        Returns:
            `parent` is the target and `child` the source. `stamp_ns` is the time of the answer; 0 when
            it only depends on static transforms and no time was asked for.

        Raises:
            UnknownFrame: no transform has named one of them.
            ConnectivityError: nothing joins them.
            ExtrapolationError: the data does not reach that time.
        """
        if bare(target) == bare(source):
            # As in tf2: every frame is where it is, one that nobody has named, too.
            frame = bare(target)
            return StampedTransform(frame, frame, time_ns or self._latest_of(frame), IDENTITY)
        target, source = self._known(target), self._known(source)
        time_ns = time_ns or self._latest_common_time(target, source)
        path = self._path_at(target, source, time_ns)
        return StampedTransform(target, source, time_ns, _along(path, lambda track: track.at(time_ns)))

    def lookup_transform_full(
        self, target: str, target_time_ns: int | None, source: str, source_time_ns: int | None, fixed: str
    ) -> StampedTransform:
        """What takes points of `source` at one time to `target` at another.

        Args:
            fixed: the frame that is taken not to have moved between the two times.

        Raises:
            LookupFailed: as :meth:`lookup_transform`.
        """
        to_target = self.lookup_transform(target, fixed, target_time_ns)
        from_source = self.lookup_transform(fixed, source, source_time_ns)
        both = to_target.transform @ from_source.transform
        return StampedTransform(to_target.parent, from_source.child, to_target.stamp_ns, both)

    def lookup_many(self, target: str, source: str, times_ns: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """:meth:`lookup_transform` at many times at once.

        Returns:
            Translations of shape (N, 3) and rotations (x, y, z, w) of shape (N, 4).

        Raises:
            LookupFailed: as :meth:`lookup_transform`.
        """
        from rwt_tf2.many import lookup_many

        return lookup_many(self, target, source, times_ns)

    def can_transform(self, target: str, source: str, time_ns: int | None = None) -> Verdict:
        """Whether :meth:`lookup_transform` would answer, and why not."""
        return _verdict(lambda: self.lookup_transform(target, source, time_ns))

    def can_transform_full(
        self, target: str, target_time_ns: int | None, source: str, source_time_ns: int | None, fixed: str
    ) -> Verdict:
        """Whether :meth:`lookup_transform_full` would answer, and why not."""
        return _verdict(
            lambda: self.lookup_transform_full(target, target_time_ns, source, source_time_ns, fixed)
        )

    def latest_common_time(self, target: str, source: str) -> int:
        """The latest time that every transform on the way has; 0 when all are static.

        Raises:
            UnknownFrame: no transform has named one of them.
            ConnectivityError: nothing joins them.
        """
        target, source = self._known(target), self._known(source)
        return self._latest_of(target) if target == source else self._latest_common_time(target, source)

    def tracks_between(
        self, target: str, source: str, time_ns: int
    ) -> tuple[tuple[Track, ...], tuple[Track, ...]]:
        """The frames' histories on the way up from the source and from the target, at some time.

        Raises:
            LookupFailed: as :meth:`lookup_transform`.
        """
        path = self._path_at(self._known(target), self._known(source), time_ns)
        return path.from_source, path.from_target

    # The tree

    def has_frame(self, frame: str) -> bool:
        """Whether a transform has named it."""
        return bare(frame) in self._names

    def frames(self) -> tuple[str, ...]:
        """All frames, sorted."""
        return tuple(sorted(self._names))

    def parent(self, frame: str) -> str | None:
        """Whose child the frame is now; None for a root.

        Raises:
            UnknownFrame: no transform has named it.
        """
        track = self._tracks.get(self._known(frame))
        return None if track is None else track.latest.parent

    def latest(self, frame: str) -> StampedTransform | None:
        """The frame's last transform to its parent; None for a root.

        Raises:
            UnknownFrame: no transform has named it.
        """
        name = self._known(frame)
        track = self._tracks.get(name)
        if track is None:
            return None
        return StampedTransform(track.latest.parent, name, track.latest_ns, track.latest.transform)

    def is_static(self, frame: str) -> bool:
        """Whether the frame's transform to its parent is static."""
        track = self._tracks.get(bare(frame))
        return track is not None and track.is_static

    def rate(self, frame: str) -> float:
        """How many transforms a second of the frame there are; 0 for a root, and for what is static."""
        track = self._tracks.get(bare(frame))
        return 0.0 if track is None else track.rate()

    def all_frames_as_yaml(self) -> str:
        """Every frame with its parent, rate and times, as tf2's `/tf2_frames` answers."""
        return listing.as_yaml(self._tracks, self.cache_ns)

    def all_frames_as_dot(self) -> str:
        """The tree as a graph for Graphviz."""
        return listing.as_dot(self._tracks)

    def tree(self) -> str:
        """The tree as indented text."""
        return listing.as_tree(self._tracks, self._names)

    # Ways

    def _known(self, frame: str) -> str:
        name = bare(frame)
        if name not in self._names:
            raise UnknownFrame(name, self.frames())
        return name

    def _latest_of(self, frame: str) -> int:
        """When the frame was last told of; 0 for never."""
        track = self._tracks.get(frame)
        return 0 if track is None else track.latest_ns

    def _latest_common_time(self, target: str, source: str) -> int:
        path = self._path(target, source, lambda track: track.latest.parent)
        if path is None:
            raise ConnectivityError(target, source, self._root(target), self._root(source))
        return _earliest_latest(path)

    def _path_at(self, target: str, source: str, time_ns: int) -> _Path:
        path = self._path(
            target, source, lambda track: track.parent_at(time_ns) if track.covers(time_ns) else None
        )
        if path is not None:
            return path
        for frame in (source, target):
            self._explain_gap(target, source, frame, time_ns)
        raise ConnectivityError(target, source, self._root(target), self._root(source))

    def _path(self, target: str, source: str, parent_of: Callable[[Track], str | None]) -> _Path | None:
        """Up from the source, then from the target until the two ways meet; None if they do not."""
        up = self._way_up(source, target, parent_of)
        down = self._way_up(target, "", parent_of) if target not in up else {target: 0}
        meeting = next((frame for frame in down if frame in up), None)
        if meeting is None:
            return None
        return _Path(
            tuple(self._tracks[frame] for frame in _before(up, meeting)),
            tuple(self._tracks[frame] for frame in _before(down, meeting)),
        )

    def _way_up(self, frame: str, end: str, parent_of: Callable[[Track], str | None]) -> dict[str, int]:
        """The frame and its ancestors, in order, as far as they are known or up to `end`."""
        way = {frame: 0}
        while frame != end and (track := self._tracks.get(frame)) is not None:
            parent = parent_of(track)
            # Frames that changed their parents may have stood in a loop's order at some time of the past.
            if parent is None or parent in way:
                break
            way[parent] = len(way)
            frame = parent
        return way

    def _explain_gap(self, target: str, source: str, frame: str, time_ns: int) -> None:
        """Raise if the way up from `frame` ends where data is missing at that time."""
        seen = set()
        while (track := self._tracks.get(frame)) is not None and frame not in seen:
            seen.add(frame)
            if not track.covers(time_ns):
                late = time_ns > track.latest_ns
                nearest = track.latest_ns if late else track.earliest_ns
                raise ExtrapolationError(target, source, track.latest.parent, frame, time_ns, nearest)
            frame = track.parent_at(time_ns)

    def _root(self, frame: str) -> str:
        while (track := self._tracks.get(frame)) is not None:
            frame = track.latest.parent
        return frame


def _before(way: dict[str, int], end: str) -> Iterable[str]:
    for frame in way:
        if frame == end:
            return
        yield frame


def _along(path: _Path, transform_of: Callable[[Track], Transform]) -> Transform:
    return _up(path.from_target, transform_of).inverse() @ _up(path.from_source, transform_of)


def _up(tracks: tuple[Track, ...], transform_of: Callable[[Track], Transform]) -> Transform:
    way = IDENTITY
    for track in tracks:
        way = transform_of(track) @ way
    return way


def _earliest_latest(path: _Path) -> int:
    moving = (track.latest_ns for track in (*path.from_source, *path.from_target) if not track.is_static)
    return min(moving, default=0)


def _verdict(ask: Callable[[], object]) -> Verdict:
    try:
        ask()
    except LookupFailed as error:
        return Verdict(str(error))
    return Verdict()


def _too_old(parent: str, child: str, stamp_ns: int, latest_ns: int, cache_ns: int) -> str:
    return (
        f"{parent} <- {child} at {seconds(stamp_ns)} s is more than {cache_ns / NANOSECONDS:g} s older "
        f"than the latest, which is of {seconds(latest_ns)} s"
    )
