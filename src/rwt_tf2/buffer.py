"""Transform buffer: a tree of frames over time, with lookups."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, takewhile
from typing import TYPE_CHECKING, Final

from rwt_tf2.errors import (
    ConnectivityError,
    ExtrapolationError,
    InvalidTransform,
    LookupFailed,
    LoopRefused,
    StaleTransform,
    UnknownFrame,
)
from rwt_tf2.history import Edge, MovingTrack, StaticTrack
from rwt_tf2.times import NANOSECONDS, seconds
from rwt_tf2.transform import IDENTITY, StampedTransform, Transform, bare, checked

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

Track = MovingTrack | StaticTrack

CACHE_NS: Final = 10 * NANOSECONDS
"""Default time for which a transform is retained, as in tf2; nanoseconds."""

MOST_FRAMES: Final = 10_000
"""Maximum number of frames: a stream of new names must not exhaust the memory."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of a check; true if the transform is available.

    Attributes:
        reason: reason why it is not; empty if it is.
    """

    reason: str = ""

    def __bool__(self) -> bool:
        return not self.reason


TrackPath = tuple[tuple[Track, ...], tuple[Track, ...]]
"""Path from a source up to the common ancestor, and from the target up to it."""


class Buffer:
    """Transforms of the last seconds, by frame.

    A leading slash in a frame's name is ignored (TFR-03). Times are integers in nanoseconds. As in tf2, a
    time of 0 (or None) asks for the latest time that all transforms on the path have.

    Args:
        cache_ns: nanoseconds for which a transform is retained after a newer one of its frame.
    """

    def __init__(self, cache_ns: int = CACHE_NS) -> None:
        self.cache_ns = cache_ns
        self._tracks: dict[str, Track] = {}
        self._names: set[str] = set()

    # Transforms

    def set_transform(self, stamped: StampedTransform, *, static: bool = False) -> None:
        """Add a transform.

        A static one is valid at all times, whatever its stamp. A frame that was static and gets a moving
        transform becomes moving, and vice versa.

        Raises:
            InvalidTransform: an empty frame, a frame to itself, a number that is not finite, a rotation
                that is not a unit quaternion, or too many frames.
            LoopRefused: it would make a frame its own ancestor.
            StaleTransform: it is older than what is retained of its frame.
        """
        parent, child = bare(stamped.parent), bare(stamped.child)
        transform = checked(parent, child, stamped.transform)
        new = {parent, child} - self._names
        if new and len(self._names) + len(new) > MOST_FRAMES:
            raise InvalidTransform(f"{parent} <- {child}: there are {MOST_FRAMES} frames already")
        track = self._tracks.get(child)
        if track is None or track.latest.parent != parent:
            self._check_loop(parent, child)
        edge = Edge(parent, transform)
        if static:
            self._tracks[child] = StaticTrack(edge)
        elif isinstance(track, MovingTrack):
            if not track.add(stamped.stamp_ns, edge):
                raise StaleTransform(
                    f"{parent} <- {child} at {seconds(stamped.stamp_ns)} s is more than "
                    f"{self.cache_ns / NANOSECONDS:g} s older than the latest, "
                    f"which is of {seconds(track.latest_ns)} s"
                )
        else:
            track = self._tracks[child] = MovingTrack(self.cache_ns)
            track.add(stamped.stamp_ns, edge)
        self._names.add(parent)
        self._names.add(child)

    def _check_loop(self, parent: str, child: str) -> None:
        # Only the path up from `parent` can close a loop: a frame has one parent.
        way, frame = [parent], parent
        while (track := self._tracks.get(frame)) is not None and frame != child:
            frame = track.latest.parent
            way.append(frame)
        if frame == child:
            loop = " <- ".join([*reversed(way), child])
            raise LoopRefused(f"{parent} <- {child} would close a loop: {loop}")

    def clear(self) -> None:
        """Remove moving transforms; static ones stay, as in tf2."""
        self._tracks = {child: track for child, track in self._tracks.items() if track.is_static}
        self._names = set(self._tracks).union(track.latest.parent for track in self._tracks.values())

    # Lookups

    def lookup_transform(self, target: str, source: str, time_ns: int | None = None) -> StampedTransform:
        """Return the transform that converts points of `source` to `target`.

        Args:
            time_ns: time; None or 0 for the latest common time.

        Returns:
            `parent` is the target and `child` the source. `stamp_ns` is the time of the transform; 0 if only
            static transforms are involved and no time was given.

        Raises:
            UnknownFrame: one of the frames is unknown.
            ConnectivityError: the frames are not connected.
            ExtrapolationError: the data does not cover that time.
        """
        if bare(target) == bare(source):
            # As in tf2: the identity, even for an unknown frame.
            frame = bare(target)
            return StampedTransform(frame, frame, time_ns or self._latest_of(frame), IDENTITY)
        target, source = self._known(target), self._known(source)
        time_ns = time_ns or self._latest_common_time(target, source)
        path = self._path_at(target, source, time_ns)
        return StampedTransform(target, source, time_ns, self.along(path, lambda track: track.at(time_ns)))

    def lookup_transform_full(
        self, target: str, target_time_ns: int | None, source: str, source_time_ns: int | None, fixed: str
    ) -> StampedTransform:
        """Return the transform that converts points of `source` at one time to `target` at another.

        Args:
            fixed: frame that is assumed not to move between the two times.

        Raises:
            LookupFailed: as :meth:`lookup_transform`.
        """
        to_target = self.lookup_transform(target, fixed, target_time_ns)
        from_source = self.lookup_transform(fixed, source, source_time_ns)
        both = to_target.transform @ from_source.transform
        return StampedTransform(to_target.parent, from_source.child, to_target.stamp_ns, both)

    def lookup_many(self, target: str, source: str, times_ns: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Look up transforms at many times at once.

        Returns:
            Translations of shape (N, 3) and rotations (x, y, z, w) of shape (N, 4).

        Raises:
            LookupFailed: as :meth:`lookup_transform`.
        """
        from rwt_tf2.many import lookup_many

        return lookup_many(self, target, source, times_ns)

    def can_transform(self, target: str, source: str, time_ns: int | None = None) -> Verdict:
        """Return whether :meth:`lookup_transform` would succeed, and the reason if not."""
        return _verdict(lambda: self.lookup_transform(target, source, time_ns))

    def can_transform_full(
        self, target: str, target_time_ns: int | None, source: str, source_time_ns: int | None, fixed: str
    ) -> Verdict:
        """Return whether :meth:`lookup_transform_full` would succeed, and the reason if not."""
        return _verdict(
            lambda: self.lookup_transform_full(target, target_time_ns, source, source_time_ns, fixed)
        )

    def latest_common_time(self, target: str, source: str) -> int:
        """Return the latest time that every transform on the path has; 0 if all are static.

        Raises:
            UnknownFrame: one of the frames is unknown.
            ConnectivityError: the frames are not connected.
        """
        target, source = self._known(target), self._known(source)
        return self._latest_of(target) if target == source else self._latest_common_time(target, source)

    @staticmethod
    def along(path: TrackPath, transform_of: Callable[[Track], Transform]) -> Transform:
        """Return the transform along a path, composed of those of its histories."""
        from_source, from_target = path
        return _up(from_target, transform_of).inverse() @ _up(from_source, transform_of)

    def tracks_between(self, target: str, source: str, time_ns: int) -> TrackPath:
        """Return the histories on the path up from the source and up from the target, at some time.

        Raises:
            LookupFailed: as :meth:`lookup_transform`.
        """
        return self._path_at(self._known(target), self._known(source), time_ns)

    # The tree

    def has_frame(self, frame: str) -> bool:
        """True if the frame is known."""
        return bare(frame) in self._names

    def frames(self) -> tuple[str, ...]:
        """Return all frames, sorted."""
        return tuple(sorted(self._names))

    def parent(self, frame: str) -> str | None:
        """Return the current parent of a frame; None for a root.

        Raises:
            UnknownFrame: the frame is unknown.
        """
        track = self._tracks.get(self._known(frame))
        return None if track is None else track.latest.parent

    def latest(self, frame: str) -> StampedTransform | None:
        """Return the latest transform of a frame to its parent; None for a root.

        Raises:
            UnknownFrame: the frame is unknown.
        """
        name = self._known(frame)
        track = self._tracks.get(name)
        if track is None:
            return None
        return StampedTransform(track.latest.parent, name, track.latest_ns, track.latest.transform)

    def is_static(self, frame: str) -> bool:
        """True if the frame's transform to its parent is static."""
        track = self._tracks.get(bare(frame))
        return track is not None and track.is_static

    def rate(self, frame: str) -> float:
        """Return the transforms per second of a frame; 0 for roots and static frames."""
        track = self._tracks.get(bare(frame))
        return 0.0 if track is None else track.rate()

    def all_frames_as_yaml(self) -> str:
        """Return every frame with its parent, rate and times, in the format of tf2's `/tf2_frames`."""
        entries = (_entry(child, track, self.cache_ns) for child, track in sorted(self._tracks.items()))
        return "".join(entries) or "{}\n"

    def all_frames_as_dot(self) -> str:
        """Return the tree as a graph for Graphviz."""
        arrows = (
            f"  {_quoted(track.latest.parent)} -> {_quoted(child)} [label={_quoted(_label(track))}];\n"
            for child, track in sorted(self._tracks.items())
        )
        return f"digraph frames {{\n{''.join(arrows)}}}\n"

    def tree(self) -> str:
        """Return the tree as indented text."""
        tracks = self._tracks
        children: dict[str, list[str]] = {}
        for child in sorted(tracks):
            children.setdefault(tracks[child].latest.parent, []).append(child)
        waiting = [(root, "", "") for root in sorted(self._names - tracks.keys(), reverse=True)]
        lines = []
        while waiting:
            frame, before, indent = waiting.pop()
            track = tracks.get(frame)
            lines.append(f"{before}{frame}" + ("\n" if track is None else f" ({_label(track)})\n"))
            below = children.get(frame, [])
            waiting.extend(
                (child, f"{indent}{'└─ ' if last else '├─ '}", f"{indent}{'   ' if last else '│  '}")
                for child, last in zip(reversed(below), (True, *(False,) * len(below)), strict=False)
            )
        return "".join(lines)

    # Paths

    def _known(self, frame: str) -> str:
        name = bare(frame)
        if name not in self._names:
            raise UnknownFrame(name, self.frames())
        return name

    def _latest_of(self, frame: str) -> int:
        track = self._tracks.get(frame)
        return 0 if track is None else track.latest_ns

    def _latest_common_time(self, target: str, source: str) -> int:
        path = self._path(target, source, lambda track: track.latest.parent)
        if path is None:
            raise ConnectivityError(target, source, self._root(target), self._root(source))
        return min((track.latest_ns for track in chain(*path) if not track.is_static), default=0)

    def _path_at(self, target: str, source: str, time_ns: int) -> TrackPath:
        path = self._path(
            target, source, lambda track: track.parent_at(time_ns) if track.covers(time_ns) else None
        )
        if path is not None:
            return path
        for frame in (source, target):
            self._explain_gap(target, source, frame, time_ns)
        raise ConnectivityError(target, source, self._root(target), self._root(source))

    def _path(self, target: str, source: str, parent_of: Callable[[Track], str | None]) -> TrackPath | None:
        up = self._way_up(source, target, parent_of)
        down = self._way_up(target, "", parent_of) if target not in up else {target: 0}
        meeting = next((frame for frame in down if frame in up), None)
        if meeting is None:
            return None
        source_side, target_side = (
            tuple(self._tracks[frame] for frame in takewhile(lambda frame: frame != meeting, way))
            for way in (up, down)
        )
        return source_side, target_side

    def _way_up(self, frame: str, end: str, parent_of: Callable[[Track], str | None]) -> dict[str, int]:
        way = {frame: 0}
        while frame != end and (track := self._tracks.get(frame)) is not None:
            parent = parent_of(track)
            # At a past time, frames that have changed their parents may form a loop.
            if parent is None or parent in way:
                break
            way[parent] = len(way)
            frame = parent
        return way

    def _explain_gap(self, target: str, source: str, frame: str, time_ns: int) -> None:
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


def _up(tracks: tuple[Track, ...], transform_of: Callable[[Track], Transform]) -> Transform:
    way = IDENTITY
    for track in tracks:
        way = transform_of(track) @ way
    return way


def _verdict(ask: Callable[[], object]) -> Verdict:
    try:
        ask()
    except LookupFailed as error:
        return Verdict(str(error))
    return Verdict()


def _entry(child: str, track: Track, cache_ns: int) -> str:
    length = 0 if track.is_static else min(track.latest_ns - track.earliest_ns, cache_ns)
    return (
        f"{_quoted(child)}:\n"
        f"  parent: {_quoted(track.latest.parent)}\n"
        f"  static: {'true' if track.is_static else 'false'}\n"
        f"  rate: {track.rate():.3f}\n"
        f"  most_recent_transform: {seconds(track.latest_ns)}\n"
        f"  oldest_transform: {seconds(track.earliest_ns)}\n"
        f"  buffer_length: {length / NANOSECONDS:.3f}\n"
    )


def _quoted(name: str) -> str:
    # Frame names may be any string; YAML and Graphviz both read JSON strings.
    return json.dumps(name, ensure_ascii=False)


def _label(track: Track) -> str:
    if track.is_static:
        return "static"
    rate = track.rate()
    return f"{rate:.1f} Hz" if rate else "once"
