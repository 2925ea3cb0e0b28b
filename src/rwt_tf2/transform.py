"""Transform between two frames."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from rwt_tf2 import quaternion as rotations
from rwt_tf2.errors import InvalidTransform
from rwt_tf2.quaternion import Quaternion, Vector, normalised

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike


_LONGEST_NAME: Final = 256
_UNIT_TOLERANCE: Final = 0.01
"""Maximum deviation of a quaternion's squared length from 1, as in tf2."""


@dataclass(frozen=True, slots=True)
class Transform:
    """Conversion from a child frame to its parent: rotation, then translation.

    Attributes:
        translation: origin of the child in the parent, metres.
        rotation: orientation of the child in the parent, a unit quaternion (x, y, z, w).
    """

    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def from_rpy(cls, translation: Vector, roll: float, pitch: float, yaw: float) -> Transform:
        """Return the transform of turns around the fixed axes x, y, z in this order, radians (URDF's rpy)."""
        return cls(translation, rotations.from_rpy(roll, pitch, yaw))

    def __matmul__(self, other: Transform) -> Transform:
        """Compose two transforms: `a @ b` applies `b`, then `a`."""
        x, y, z = rotations.rotate(self.rotation, other.translation)
        tx, ty, tz = self.translation
        return Transform((tx + x, ty + y, tz + z), rotations.multiply(self.rotation, other.rotation))

    def inverse(self) -> Transform:
        """Return the inverse transform."""
        back = rotations.conjugate(self.rotation)
        x, y, z = rotations.rotate(back, self.translation)
        return Transform((-x, -y, -z), back)

    def apply(self, point: Vector) -> Vector:
        """Convert a point of the child's frame to the parent's."""
        x, y, z = rotations.rotate(self.rotation, point)
        tx, ty, tz = self.translation
        return (tx + x, ty + y, tz + z)

    def apply_all(self, points: ArrayLike) -> np.ndarray:
        """Convert many points at once: an array of shape (…, 3)."""
        import numpy as np

        matrix = self.matrix()
        moved: np.ndarray = np.asarray(points, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        return moved

    def matrix(self) -> np.ndarray:
        """Return the homogeneous 4 x 4 matrix."""
        import numpy as np

        matrix = np.eye(4)
        for column, axis in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
            matrix[:3, column] = rotations.rotate(self.rotation, axis)
        matrix[:3, 3] = self.translation
        return matrix

    def rpy(self) -> Vector:
        """Return roll, pitch and yaw in radians."""
        return rotations.to_rpy(self.rotation)

    def distance_to(self, other: Transform) -> float:
        """Return the distance between the two translations in metres."""
        return math.dist(self.translation, other.translation)

    def angle_to(self, other: Transform) -> float:
        """Return the angle of the rotation between the two, radians in [0, π]."""
        return rotations.angle_between(self.rotation, other.rotation)

    def interpolated(self, other: Transform, fraction: float) -> Transform:
        """Interpolate towards `other`, linearly in translation and by slerp in rotation."""
        (x, y, z), (ox, oy, oz) = self.translation, other.translation
        return Transform(
            (x + (ox - x) * fraction, y + (oy - y) * fraction, z + (oz - z) * fraction),
            rotations.slerp(self.rotation, other.rotation, fraction),
        )


#: Identity transform.
IDENTITY = Transform()


@dataclass(frozen=True, slots=True)
class StampedTransform:
    """Transform with its frames and time.

    Attributes:
        parent: frame to which it converts (`header.frame_id`; the target of a lookup).
        child: frame from which it converts (`child_frame_id`; the source of a lookup).
        stamp_ns: time in nanoseconds; 0 if it is valid at all times.
    """

    parent: str
    child: str
    stamp_ns: int
    transform: Transform

    def checked(self) -> StampedTransform:
        """Return the transform with valid names and a rotation of length 1.

        Raises:
            InvalidTransform: an empty frame, a frame to itself, a number that is not finite, or a rotation
                that is not a unit quaternion.
        """
        parent, child = bare(self.parent), bare(self.child)
        return StampedTransform(parent, child, self.stamp_ns, checked(parent, child, self.transform))


def bare(frame: str) -> str:
    """Return a frame's name without a leading slash (TFR-03)."""
    return frame[1:] if frame.startswith("/") else frame


def checked(parent: str, child: str, transform: Transform) -> Transform:
    """Validate names and numbers like tf2; return the transform with its rotation at length 1."""
    if not parent or not child:
        missing = "parent (header.frame_id)" if not parent else "child (child_frame_id)"
        raise InvalidTransform(f'the transform "{parent}" <- "{child}" has no {missing}')
    if len(parent) > _LONGEST_NAME or len(child) > _LONGEST_NAME:
        raise InvalidTransform(f"a frame's name is longer than {_LONGEST_NAME} characters: {child[:40]}…")
    if parent == child:
        raise InvalidTransform(f"{child} cannot be its own parent")
    numbers = (*transform.translation, *transform.rotation)
    if not all(map(math.isfinite, numbers)):
        raise InvalidTransform(f"{parent} <- {child} has a number that is not finite: {numbers}")
    square = sum(number * number for number in transform.rotation)
    if abs(square - 1.0) > _UNIT_TOLERANCE:
        raise InvalidTransform(
            f"{parent} <- {child}: the rotation {transform.rotation} is not a unit quaternion; its length is "
            f"{math.sqrt(square):.6g}"
        )
    if abs(square - 1.0) < 1e-15:
        return transform
    return Transform(transform.translation, normalised(transform.rotation))
