"""A LiDAR of 64 rings between boxes on a plain: points as it sends them, with noise. No recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RINGS: Final = 64
FIRINGS: Final = 1562
"""Directions of one turn: 99,968 points."""
SPREAD: Final = (-24.8, 2.0)
"""Lowest and highest ring, degrees."""
HEIGHT: Final = 1.73
FARTHEST: Final = 120.0
NOISE: Final = 0.02
"""Standard deviation of a distance, metres."""
_BOXES: Final = 60
_NEAREST: Final = 6.0


@dataclass(frozen=True, slots=True)
class Field:
    """Field of a point: a float of 32 bits."""

    name: str
    offset: int
    datatype: int = 7
    count: int = 1


@dataclass(frozen=True, slots=True)
class Cloud:
    """A `sensor_msgs/PointCloud2` of x, y, z and intensity in one row."""

    data: bytes
    width: int
    header: object = None
    height: int = 1
    is_bigendian: bool = False
    point_step: int = 16
    is_dense: bool = True

    @property
    def row_step(self) -> int:
        return self.point_step * self.width

    @property
    def fields(self) -> tuple[Field, ...]:
        return tuple(Field(name, 4 * place) for place, name in enumerate(("x", "y", "z", "intensity")))


def turn(seed: int = 1) -> NDArray[np.float32]:
    """Return one turn: rings x firings x (x, y, z, intensity)."""
    draw = np.random.default_rng(seed)
    around, up = np.meshgrid(
        np.linspace(0, 2 * np.pi, FIRINGS, endpoint=False), np.radians(np.linspace(*SPREAD, RINGS))
    )
    rays = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1)
    reach = np.full(around.shape, FARTHEST)
    down = rays[..., 2] < 0
    reach[down] = np.minimum(reach[down], -HEIGHT / rays[..., 2][down])
    for _ in range(_BOXES):
        reach = np.minimum(reach, _to_box(rays, draw))
    reach += draw.normal(0, NOISE, reach.shape)
    places = rays * reach[..., None]
    bright = 40 + 20 * np.sin(places[..., 0] / 3) - 0.2 * reach + draw.normal(0, 6, reach.shape)
    return np.concatenate([places, np.clip(bright, 0, 255)[..., None]], axis=-1).astype(np.float32)


def _to_box(rays: Floats, draw: np.random.Generator) -> Floats:
    """Return the distance along each ray to a box on the ground; infinite beside it."""
    middle, half, high = draw.uniform(-60, 60, 2), draw.uniform(1, 6, 2), draw.uniform(1, 8)
    if np.hypot(*middle) < _NEAREST:
        return np.full(rays.shape[:2], np.inf)
    low, top = np.array([*(middle - half), -HEIGHT]), np.array([*(middle + half), high - HEIGHT])
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = low / rays, top / rays
    near, far = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
    return np.where((near < far) & (near > 0), near, np.inf)


def by_ring() -> Cloud:
    """Return the points ring after ring."""
    return _cloud(turn().reshape(-1, 4))


def by_firing() -> Cloud:
    """Return the points as they are measured: all rings of one direction, then of the next."""
    return _cloud(turn().transpose(1, 0, 2).reshape(-1, 4))


def without_order() -> Cloud:
    """Return the points in a random order."""
    return _cloud(np.random.default_rng(0).permutation(turn().reshape(-1, 4)))


def _cloud(points: NDArray[np.float32]) -> Cloud:
    return Cloud(np.ascontiguousarray(points).tobytes(), len(points))
