"""Depth camera on a drive through a house: colour and depth, with a sensor's noise and holes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rwt.extensions.demo.world.lens import Lens
from rwt.extensions.demo.world.map import Pose, house
from rwt.extensions.demo.world.view import View

RATE: Final = 30
"""Pictures a second."""

LENS: Final = Lens()
_EDGE: Final = 0.15
"""Metres between two neighbours from which on neither is measured: the shadow of what is nearer."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One moment.

    Attributes:
        depths: rows x columns, millimetres; 0 is unknown.
        colours: rows x columns x red, green, blue.
    """

    depths: NDArray[np.uint16]
    colours: NDArray[np.uint8]


def drive(pictures: int) -> Iterator[Shot]:
    """A circle through the hall, ten seconds a round; the same every time."""
    view, rng = View(house(), LENS, 0.3), np.random.default_rng(1)
    for number in range(pictures):
        angle = math.tau * number / (10 * RATE)
        pose = Pose(0.7 + math.cos(angle), -1.9 + math.sin(angle), angle + math.pi / 2)
        hits = view.cast_rays(pose)
        noise = rng.normal(0, 2.0, (LENS.height, LENS.width, 3))
        colours = np.clip(view.colours(hits) + noise + 0.5, 0, 255).astype(np.uint8)
        yield Shot(_measured(view.depths(hits), rng), colours)


def _measured(millimetres: NDArray[np.uint16], rng: np.random.Generator) -> NDArray[np.uint16]:
    """Depths as a structured-light sensor gives them: noise by distance (Nguyen et al. 2012), shadows."""
    metres = millimetres / 1000
    deviation = 0.0012 + 0.0019 * (metres - 0.4) ** 2
    noisy = metres + rng.normal(size=metres.shape) * deviation
    steps = np.abs(np.diff(metres, axis=1)) > _EDGE
    shadow = np.zeros(metres.shape, bool)
    for shift in range(-3, 4):
        shadow[:, 4:-4] |= steps[:, 4 + shift : steps.shape[1] - 3 + shift]
    noisy[shadow | (millimetres == 0)] = 0
    return (noisy * 1000 + 0.5).astype(np.uint16)
