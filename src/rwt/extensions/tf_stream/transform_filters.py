"""Requests for transforms, and filters that select those that have moved since they were sent."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from rwt_participant.messages import Message
from rwt_tf2 import IDENTITY, Buffer, LookupFailed, StampedTransform, Transform, UnknownFrame
from rwt_tf2.quaternion import dot
from rwt_tf2.transform import bare

T = TypeVar("T", Transform, StampedTransform)

DEFAULT_RATE: Final = 10.0
"""Default rate in Hz, for a request of 0."""

HIGHEST_RATE: Final = 100.0
"""Maximum rate in Hz; higher ones count as this."""

LOWEST_RATE: Final = 0.001
"""Minimum rate in Hz; lower ones count as this, because the smallest floats have no period."""

MOST_FRAMES: Final = 1000
"""Maximum number of frames in one request."""


class InvalidRequest(ValueError):
    """A request is rejected; the text gives the remedy."""


@dataclass(frozen=True, slots=True)
class Request:
    """Subscription to transforms.

    Attributes:
        target: target frame; empty for the parent of each frame, the mode that sends the tree.
        sources: source frames; empty for all.
        angular: minimum rotation for sending a transform again, in radians.
        linear: minimum translation for sending a transform again, in metres.
        period: seconds between updates.
    """

    target: str
    sources: tuple[str, ...]
    angular: float
    linear: float
    period: float

    @classmethod
    def read(cls, message: Message) -> Request:
        """Parse a goal of the action or a request of the service; leading slashes are removed (TFR-03).

        Raises:
            InvalidRequest: a rate or threshold is NaN, a rate is negative, or there are too many frames.
        """
        for name in ("angular_thres", "trans_thres", "rate"):
            value = getattr(message, name)
            if not math.isfinite(value):
                raise InvalidRequest(f"{name} must be a finite number, got {value}")
        if message.rate < 0:
            raise InvalidRequest(f"rate must not be negative, got {message.rate:g}")
        if len(message.source_frames) > MOST_FRAMES:
            raise InvalidRequest(
                f"at most {MOST_FRAMES} source_frames, got {len(message.source_frames)}; none means all"
            )
        # tf2_web_republisher itself divides by a rate of 0 (TFR-01).
        rate = max(LOWEST_RATE, min(message.rate or DEFAULT_RATE, HIGHEST_RATE))
        sources = tuple(dict.fromkeys(map(bare, message.source_frames)))
        return cls(bare(message.target_frame), sources, message.angular_thres, message.trans_thres, 1 / rate)


GRACE: Final = 2.0
"""Seconds that a frame may be missing before it is logged: the first transforms take a moment."""


class MissingFrames:
    """Log of frames that cannot be looked up: once per frame, until it is found again (TFR-06)."""

    def __init__(self, say: Callable[[str], None], monotonic: Callable[[], float]) -> None:
        self._say = say
        self._monotonic = monotonic
        self._since: dict[str, float] = {}
        self._said: set[str] = set()

    def miss(self, frame: str, why: LookupFailed) -> None:
        """Note that a frame could not be looked up."""
        since = self._since.setdefault(frame, self._monotonic())
        if frame not in self._said and self._monotonic() - since >= GRACE:
            self._said.add(frame)
            self._say(str(why))

    def found(self, frame: str) -> None:
        """Note that a frame was looked up."""
        if self._since.pop(frame, None) is not None:
            self._said.discard(frame)


class TransformFilter(ABC, Generic[T]):
    """Filter of the transforms of one client."""

    def __init__(self, request: Request, missing: MissingFrames) -> None:
        self._request = request
        self._missing = missing
        self._sent: dict[str, T] = {}

    @abstractmethod
    def due(self, buffer: Buffer, now_ns: int) -> list[StampedTransform]:
        """Return the transforms to send now; they count as sent."""

    def forget(self) -> None:
        """Forget what was sent: every transform is due."""
        self._sent.clear()


def make_filter(request: Request, missing: MissingFrames) -> TransformFilter[Any]:
    """Return the filter for a request."""
    return TargetFrameFilter(request, missing) if request.target else TreeFilter(request, missing)


class TargetFrameFilter(TransformFilter[Transform]):
    """Filter of each source frame relative to the target (TFR-02), sent again if it has moved (TFR-04).

    Transforms are stamped with the current time. Frames that cannot be looked up are omitted, also at first:
    tf2_web_republisher sends zeros then (TFR-07).
    """

    def due(self, buffer: Buffer, now_ns: int) -> list[StampedTransform]:
        """Return the transforms of frames that have moved, stamped with the current time."""
        target = self._request.target
        found = []
        for source in self._request.sources or [frame for frame in buffer.frames() if frame != target]:
            try:
                transform = buffer.lookup_transform(target, source).transform
            except LookupFailed as error:
                self._missing.miss(source, error)
                continue
            self._missing.found(source)
            last = self._sent.get(source)
            if last is None or self._moved(last, transform):
                self._sent[source] = transform
                found.append(StampedTransform(target, source, now_ns, transform))
        return found

    def _moved(self, last: Transform, now: Transform) -> bool:
        request = self._request
        return (
            request.linear == 0
            or request.angular == 0
            or last.distance_to(now) > request.linear
            or half_angle(last, now) > request.angular
        )


def half_angle(a: Transform, b: Transform) -> float:
    """Return the angle that thresholds apply to: acos of the dot product, which is half the rotation.

    It is near π if the sign of the quaternion has flipped (TFR-05); thresholds of clients were chosen with
    it.
    """
    return math.acos(max(-1.0, min(1.0, dot(a.rotation, b.rotation))))


class TreeFilter(TransformFilter[StampedTransform]):
    """Filter of each frame relative to its parent, sent again only if the poses of frames change.

    A robot that drives moves one transform of its tree, and every frame as seen from the map. What the client
    has stays within the thresholds for each frame as seen from the root: where that is exceeded, all
    transforms from there up to the root that have changed at all are sent, parents first, with their own
    stamps. Angles are the rotation's own.
    """

    def due(self, buffer: Buffer, now_ns: int) -> list[StampedTransform]:
        """Return the transforms that keep every pose within the thresholds, with their own stamps."""
        edges = self._edges(buffer)
        true = _poses(edges)
        due = {frame for frame, edge in edges.items() if self._is_new(edge)}
        while more := self._needed(edges, true, due):
            due |= more
        found = [edge for frame, edge in edges.items() if frame in due]
        self._sent.update((edge.child, edge) for edge in found)
        return found

    def _edges(self, buffer: Buffer) -> dict[str, StampedTransform]:
        """Return the latest transforms of the requested frames and their ancestors, parents first."""
        edges: dict[str, StampedTransform] = {}
        for source in self._request.sources or buffer.frames():
            way: list[StampedTransform] = []
            try:
                edge = buffer.latest(source)
            except UnknownFrame as error:
                self._missing.miss(source, error)
                continue
            self._missing.found(source)
            while edge is not None and edge.child not in edges:
                way.append(edge)
                edge = buffer.latest(edge.parent)
            edges.update((each.child, each) for each in reversed(way))
        return edges

    def _needed(
        self, edges: Mapping[str, StampedTransform], true: Mapping[str, Transform], due: set[str]
    ) -> set[str]:
        """Return the transforms needed besides `due` to keep every frame within the thresholds.

        Correcting one frame moves others that were checked before, so callers repeat until nothing is needed.
        """
        more: set[str] = set()
        held: dict[str, Transform] = {}
        for frame, edge in edges.items():
            known = edge if frame in due or frame in more else self._sent[frame]
            held[frame] = held.get(edge.parent, IDENTITY) @ known.transform
            if self._apart(held[frame], true[frame]):
                for each in _ancestry(edges, frame):
                    held[each] = true[each]
                    if each not in due and self._has_changed(edges[each]):
                        more.add(each)
        return more

    def _is_new(self, edge: StampedTransform) -> bool:
        sent = self._sent.get(edge.child)
        return sent is None or sent.parent != edge.parent

    def _has_changed(self, edge: StampedTransform) -> bool:
        return self._is_new(edge) or self._sent[edge.child].transform != edge.transform

    def _apart(self, a: Transform, b: Transform) -> bool:
        return a.distance_to(b) > self._request.linear or a.angle_to(b) > self._request.angular


def _poses(edges: Mapping[str, StampedTransform]) -> dict[str, Transform]:
    poses: dict[str, Transform] = {}
    for frame, edge in edges.items():
        poses[frame] = poses.get(edge.parent, IDENTITY) @ edge.transform
    return poses


def _ancestry(edges: Mapping[str, StampedTransform], frame: str) -> Iterable[str]:
    while frame in edges:
        yield frame
        frame = edges[frame].parent
