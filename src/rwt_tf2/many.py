"""Vectorised lookups at many times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rwt_tf2.history import MovingTrack, StaticTrack

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rwt_tf2.buffer import Buffer

Poses = tuple[np.ndarray, np.ndarray]
"""Translations (N, 3) and rotations (N, 4), x, y, z, w."""


def lookup_many(buffer: Buffer, target: str, source: str, times_ns: ArrayLike) -> Poses:
    """Implement :meth:`rwt_tf2.Buffer.lookup_many`."""
    times = np.asarray(times_ns, np.int64).ravel()
    if not len(times):
        return np.empty((0, 3)), np.empty((0, 4))
    first, last = (buffer.tracks_between(target, source, int(time)) for time in (times.min(), times.max()))
    tracks = {id(track): track for side in first for track in side}
    steady = all(_one_parent(track, int(times.min()), int(times.max())) for track in tracks.values())
    if first != last or not steady:
        # A frame on the path has changed its parent.
        return _one_by_one(buffer, target, source, times)
    from_source, from_target = (_way_up(side, times) for side in first)
    return _product(_inverse(from_target), from_source)


def _one_by_one(buffer: Buffer, target: str, source: str, times: np.ndarray) -> Poses:
    found = [buffer.lookup_transform(target, source, int(time)).transform for time in times]
    return np.array([each.translation for each in found]), np.array([each.rotation for each in found])


def _one_parent(track: MovingTrack | StaticTrack, first: int, last: int) -> bool:
    return isinstance(track, StaticTrack) or len({edge.parent for _, edge in track.between(first, last)}) == 1


def _way_up(tracks: tuple[MovingTrack | StaticTrack, ...], times: np.ndarray) -> Poses:
    way = np.zeros((len(times), 3)), np.tile((0.0, 0.0, 0.0, 1.0), (len(times), 1))
    for track in tracks:
        way = _product(_at(track, times), way)
    return way


def _at(track: MovingTrack | StaticTrack, times: np.ndarray) -> Poses:
    if isinstance(track, StaticTrack):
        transform = track.latest.transform
        return (
            np.tile(transform.translation, (len(times), 1)),
            np.tile(transform.rotation, (len(times), 1)),
        )
    kept = list(track.between(int(times.min()), int(times.max())))
    stamps = np.array([stamp for stamp, _ in kept], np.int64)
    moved = np.array([edge.transform.translation for _, edge in kept])
    turned = np.array([edge.transform.rotation for _, edge in kept])
    if len(stamps) == 1:
        return np.repeat(moved, len(times), axis=0), np.repeat(turned, len(times), axis=0)
    after = np.clip(np.searchsorted(stamps, times, side="left"), 1, len(stamps) - 1)
    before = after - 1
    fraction = ((times - stamps[before]) / (stamps[after] - stamps[before]))[:, None]
    return (
        moved[before] + (moved[after] - moved[before]) * fraction,
        _slerp(turned[before], turned[after], fraction),
    )


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


def _inverse(poses: Poses) -> Poses:
    moved, turned = poses
    back = turned * np.array((-1.0, -1.0, -1.0, 1.0))
    return -_rotate(back, moved), back


def _product(a: Poses, b: Poses) -> Poses:
    return a[0] + _rotate(a[1], b[0]), _multiply(a[1], b[1])


def _rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    axis, w = q[:, :3], q[:, 3:]
    twice = 2.0 * np.cross(axis, v)
    turned: np.ndarray = v + w * twice + np.cross(axis, twice)
    return turned


def _multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    av, aw, bv, bw = a[:, :3], a[:, 3:], b[:, :3], b[:, 3:]
    axis = aw * bv + bw * av + np.cross(av, bv)
    return np.hstack((axis, aw * bw - np.sum(av * bv, axis=1, keepdims=True)))
