"""An independent answer to compare with: homogeneous matrices of numpy, rotation by Rodrigues' formula."""

from __future__ import annotations

import numpy as np

from rwt_tf2 import StampedTransform, Transform


def matrix_of(transform: Transform) -> np.ndarray:
    """The 4 x 4 matrix, by axis and angle."""
    x, y, z, w = transform.rotation
    axis = np.array([x, y, z])
    sine = np.linalg.norm(axis)
    matrix = np.eye(4)
    if sine > 0:
        angle = 2 * np.arctan2(sine, w)
        matrix[:3, :3] = rodrigues(axis / sine, float(angle))
    matrix[:3, 3] = transform.translation
    return matrix


def rodrigues(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned: np.ndarray = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turned


def axis_and_angle(rotation: np.ndarray) -> tuple[np.ndarray, float]:
    """Of a rotation matrix; the axis is x where there is no rotation."""
    sines = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = np.linalg.norm(sines) / 2, (np.trace(rotation) - 1) / 2
    angle = float(np.arctan2(sine, cosine))
    if sine < 1e-12:
        return np.array([1.0, 0.0, 0.0]), angle
    return sines / (2 * sine), angle


def interpolated(a: np.ndarray, b: np.ndarray, fraction: float) -> np.ndarray:
    """Straight between the origins, and a part of the rotation from `a` to `b` around its own axis."""
    axis, angle = axis_and_angle(a[:3, :3].T @ b[:3, :3])
    between = np.eye(4)
    between[:3, :3] = a[:3, :3] @ rodrigues(axis, angle * fraction)
    between[:3, 3] = a[:3, 3] + (b[:3, 3] - a[:3, 3]) * fraction
    return between


class Oracle:
    """Every transform ever given, and lookups by walking all the way to the root with matrices."""

    def __init__(self) -> None:
        self._given: dict[str, tuple[str, list[tuple[int, np.ndarray]]]] = {}

    def add(self, stamped: StampedTransform) -> None:
        _, kept = self._given.setdefault(stamped.child, (stamped.parent, []))
        kept.append((stamped.stamp_ns, matrix_of(stamped.transform)))
        kept.sort(key=lambda entry: entry[0])

    def _edge(self, frame: str, time_ns: int) -> np.ndarray:
        _, kept = self._given[frame]
        later = next(index for index, (stamp, _) in enumerate(kept) if stamp >= time_ns)
        stamp, matrix = kept[later]
        if stamp == time_ns:
            return matrix
        before_ns, before = kept[later - 1]
        return interpolated(before, matrix, (time_ns - before_ns) / (stamp - before_ns))

    def to_root(self, frame: str, time_ns: int) -> np.ndarray:
        matrix = np.eye(4)
        while frame in self._given:
            matrix = self._edge(frame, time_ns) @ matrix
            frame = self._given[frame][0]
        return matrix

    def lookup(self, target: str, source: str, time_ns: int) -> np.ndarray:
        answer: np.ndarray = np.linalg.inv(self.to_root(target, time_ns)) @ self.to_root(source, time_ns)
        return answer
