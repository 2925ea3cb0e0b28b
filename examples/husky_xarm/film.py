"""Precomputed camera images of a drive: drawing is slower than the 30 Hz of a camera.

>>> film = keep(Path("build/paper"), Lens(), pictures=300)
>>> film.colours[0].shape, film.depths[0].shape
((480, 640, 3), (480, 640))
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib.format import open_memmap
from numpy.typing import NDArray

from husky_xarm.camera import Picture, draw
from husky_xarm.scene import HOME, Scene
from husky_xarm.simulation import Simulation
from rwt.extensions.demo.drive import Velocity
from rwt.extensions.demo.world.lens import Lens

#: Round a circle, while the arm looks about.
_DRIVE = Velocity(0.4, 0.6)
_ARM_PERIOD = 4.0


@dataclass(frozen=True, slots=True)
class Film:
    """Pictures in their order, read from the disk as they are needed.

    Attributes:
        colours: pictures x rows x columns x red, green, blue.
        depths: pictures x rows x columns, millimetres; 0 for nothing seen.
    """

    colours: NDArray[np.uint8]
    depths: NDArray[np.uint16]


def keep(
    folder: Path,
    lens: Lens,
    pictures: int,
    rate: float = 30.0,
    on_picture: Callable[[int], None] | None = None,
) -> Film:
    """The film of this lens, length and rate; drawn if it is not in `folder` yet.

    Args:
        folder: where films are kept.
        lens: of the camera.
        pictures: how many.
        rate: pictures a second of the simulation's time.
        on_picture: told of each picture's number as it is drawn, from 1 on: 300 of 640x480 take 40 s.
    """
    place = folder / f"husky_xarm_{lens.width}x{lens.height}_{pictures}_at_{rate:g}_hz"
    if not place.is_dir():
        half_made = place.with_suffix(".part")
        shutil.rmtree(half_made, ignore_errors=True)
        half_made.mkdir(parents=True)
        _write(half_made, lens, pictures, rate, on_picture)
        half_made.rename(place)
    return Film(*(np.load(place / name, mmap_mode="r") for name in ("colours.npy", "depths.npy")))


def _write(
    place: Path, lens: Lens, pictures: int, rate: float, on_picture: Callable[[int], None] | None
) -> None:
    size = (pictures, lens.height, lens.width)
    colours = open_memmap(place / "colours.npy", mode="w+", dtype=np.uint8, shape=(*size, 3))
    depths = open_memmap(place / "depths.npy", mode="w+", dtype=np.uint16, shape=size)
    for number, picture in enumerate(_shots(lens, pictures, rate)):
        colours[number], depths[number] = picture.colours, picture.depths
        if on_picture is not None:
            on_picture(number + 1)
    colours.flush()
    depths.flush()


def _shots(lens: Lens, pictures: int, rate: float) -> Iterator[Picture]:
    """The simulation runs in its own time, and waits for each picture."""
    simulation, scene = Simulation(), Scene()
    simulation.drive(_DRIVE)
    for number in range(pictures):
        swing = math.sin(math.tau * number / rate / _ARM_PERIOD)
        simulation.move_arm({"joint1": 0.8 * swing, "joint3": HOME["joint3"] - 0.3 * swing})
        simulation.advance(1 / rate)
        scene.restore(simulation.snapshot())
        yield draw(scene, lens)
    simulation.close()
    scene.close()
