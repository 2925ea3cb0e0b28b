"""A transform between two frames."""

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
"""How far from 1 the square of a quaternion's length may be, as in tf2."""


@dataclass(frozen=True, slots=True)
class Transform:
    """Takes what is given in a child frame to its parent's: first turned, then moved.

    Attributes:
        translation: where the child's origin is in the parent, metres.
        rotation: how the child is turned in the parent, a unit quaternion (x, y, z, w).
    """

    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def from_rpy(cls, translation: Vector, roll: float, pitch: float, yaw: float) -> Transform:
        """From angles around the fixed axes x, y, z in this order, radians: URDF's rpy."""
        return cls(translation, rotations.from_rpy(roll, pitch, yaw))

    def __matmul__(self, other: Transform) -> Transform:
        """`a @ b` takes a point through `b` and then through `a`."""
        x, y, z = rotations.rotate(self.rotation, other.translation)
        tx, ty, tz = self.translation
        return Transform((tx + x, ty + y, tz + z), rotations.multiply(self.rotation, other.rotation))

    def inverse(self) -> Transform:
        """The way back."""
        back = rotations.conjugate(self.rotation)
        x, y, z = rotations.rotate(back, self.translation)
        return Transform((-x, -y, -z), back)

    def apply(self, point: Vector) -> Vector:
        """A point of the child's frame, in the parent's."""
        x, y, z = rotations.rotate(self.rotation, point)
        tx, ty, tz = self.translation
        return (tx + x, ty + y, tz + z)

    def apply_all(self, points: ArrayLike) -> np.ndarray:
        """Many points at once: an array of shape (…, 3)."""
        import numpy as np

        matrix = self.matrix()
        moved: np.ndarray = np.asarray(points, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        return moved

    def matrix(self) -> np.ndarray:
        """The homogeneous 4 x 4 matrix."""
        import numpy as np

        matrix = np.eye(4)
        for column, axis in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
            matrix[:3, column] = rotations.rotate(self.rotation, axis)
        matrix[:3, 3] = self.translation
        return matrix

    def rpy(self) -> Vector:
        """Roll, pitch and yaw, radians."""
        return rotations.to_rpy(self.rotation)

    def distance_to(self, other: Transform) -> float:
        """Metres between the two translations."""
        (x, y, z), (ox, oy, oz) = self.translation, other.translation
        return float(((x - ox) ** 2 + (y - oy) ** 2 + (z - oz) ** 2) ** 0.5)

    def angle_to(self, other: Transform) -> float:
        """The angle of the rotation from one to the other, radians in [0, π]."""
        return rotations.angle_between(self.rotation, other.rotation)

    def interpolated(self, other: Transform, fraction: float) -> Transform:
        """What lies at `fraction` of the way to `other`: straight, and by slerp."""
        (x, y, z), (ox, oy, oz) = self.translation, other.translation
        return Transform(
            (x + (ox - x) * fraction, y + (oy - y) * fraction, z + (oz - z) * fraction),
            rotations.slerp(self.rotation, other.rotation, fraction),
        )


#: The transform that moves and turns nothing.
IDENTITY = Transform()


@dataclass(frozen=True, slots=True)
class StampedTransform:
    """A transform with the frames it joins and its time.

    Attributes:
        parent: the frame it leads to (`header.frame_id`; the target of a lookup).
        child: the frame it leads from (`child_frame_id`; the source of a lookup).
        stamp_ns: its time, nanoseconds; 0 for what holds always.
    """

    parent: str
    child: str
    stamp_ns: int
    transform: Transform

    def checked(self) -> StampedTransform:
        """The same, as it can be sent: frames without a leading slash, and a rotation of length 1.

        Raises:
            InvalidTransform: an empty frame, a frame to itself, a number that is not finite, or a rotation
                that is not a unit quaternion; says which frame.
        """
        parent, child = bare(self.parent), bare(self.child)
        return StampedTransform(parent, child, self.stamp_ns, checked(parent, child, self.transform))


def bare(frame: str) -> str:
    """A frame's name without a leading slash (TFR-03)."""
    return frame[1:] if frame.startswith("/") else frame


def checked(parent: str, child: str, transform: Transform) -> Transform:
    """The transform with its rotation at length 1; names and numbers are what tf2 takes."""
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
