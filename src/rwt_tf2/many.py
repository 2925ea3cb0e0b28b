"""Vectorised lookups at many times: transforms whose numbers are arrays with an element for each time."""

from __future__ import annotations

from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from rwt_tf2.history import MovingTrack, StaticTrack
from rwt_tf2.transform import Transform

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rwt_tf2.buffer import Buffer


def lookup_many(
    buffer: Buffer, target: str, source: str, times_ns: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Implement :meth:`rwt_tf2.Buffer.lookup_many`."""
    times = np.asarray(times_ns, np.int64).ravel()
    if not len(times):
        return np.empty((0, 3)), np.empty((0, 4))
    begin, end = int(times.min()), int(times.max())
    first, last = (buffer.tracks_between(target, source, time) for time in (begin, end))
    if first == last and all(_has_one_parent(track, begin, end) for track in chain(*first)):
        found = buffer.along(first, partial(_at, times=times))
        return _rows(found.translation, len(times)), _rows(found.rotation, len(times))
    # A frame on the path has changed its parent.
    each = [buffer.lookup_transform(target, source, int(time)).transform for time in times]
    return np.array([one.translation for one in each]), np.array([one.rotation for one in each])


def _has_one_parent(track: MovingTrack | StaticTrack, first: int, last: int) -> bool:
    return isinstance(track, StaticTrack) or len({edge.parent for _, edge in track.between(first, last)}) == 1


def _rows(columns: tuple[Any, ...], count: int) -> np.ndarray:
    return np.stack([np.broadcast_to(column, count) for column in columns], axis=1)


def _at(track: MovingTrack | StaticTrack, times: np.ndarray) -> Transform:
    if isinstance(track, StaticTrack):
        return track.latest.transform
    kept = list(track.between(int(times.min()), int(times.max())))
    if len(kept) == 1:
        return kept[0][1].transform
    stamps = np.array([stamp for stamp, _ in kept], np.int64)
    moved = np.array([edge.transform.translation for _, edge in kept])
    turned = np.array([edge.transform.rotation for _, edge in kept])
    after = np.clip(np.searchsorted(stamps, times, side="left"), 1, len(stamps) - 1)
    before = after - 1
    fraction = ((times - stamps[before]) / (stamps[after] - stamps[before]))[:, None]
    translations = moved[before] + (moved[after] - moved[before]) * fraction
    columns: Any = tuple(translations.T), tuple(_slerp(turned[before], turned[after], fraction).T)
    return Transform(*columns)


def _slerp(a: np.ndarray, b: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    """Like :func:`rwt_tf2.quaternion.slerp`, for each row."""
    b = np.where(np.sum(a * b, axis=1, keepdims=True) < 0.0, -b, b)
    apart = np.linalg.norm(a - b, axis=1, keepdims=True)
    half = 2.0 * np.arctan2(apart, np.linalg.norm(a + b, axis=1, keepdims=True))
    sine = np.sin(half)
    close = sine < 1e-9
    safe = np.where(close, 1.0, sine)
    first = np.where(close, 1.0 - fraction, np.sin((1.0 - fraction) * half) / safe)
    second = np.where(close, fraction, np.sin(fraction * half) / safe)
    mixed = first * a + second * b
    unit: np.ndarray = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
    return unit
