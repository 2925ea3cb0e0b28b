"""Camera images, drawn by Bullet's CPU renderer in a process of their own.

A picture takes some 40 to 130 ms, and Bullet keeps Python's lock for all of it: in a thread of the robot's
own process it would stop the physics and every client that long.
"""

from __future__ import annotations

import math
import multiprocessing
import signal
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np
import pybullet
from numpy.typing import NDArray

from husky_xarm.description import OPTICAL
from husky_xarm.scene import Scene, Snapshot
from rwt.extensions.demo.world.lens import Lens
from rwt_tf2 import Transform

_NEAR = 0.05
_FAR = 20.0
"""Metres; what lies further has no depth."""
_PATIENCE = 5.0
_LIGHT = (-4.0, -3.0, 8.0)


class RendererGone(RuntimeError):
    """The process that draws has ended."""


@dataclass(frozen=True, slots=True)
class Picture:
    """One look.

    Attributes:
        colours: red, green and blue; rows x columns x 3, uint8.
        depths: along the camera's axis, millimetres, on the same pixels; 0 for nothing seen; uint16.
    """

    colours: NDArray[np.uint8]
    depths: NDArray[np.uint16]


def draw(scene: Scene, lens: Lens) -> Picture:
    """Draw what the robot's camera sees in `scene`."""
    position, orientation = scene.bullet.getLinkState(
        scene.robot, scene.link_numbers[OPTICAL], computeForwardKinematics=True
    )[4:6]
    camera = Transform(position, orientation)
    vertical = math.degrees(2 * math.atan(lens.height / 2 / lens.focal))
    view = scene.bullet.computeViewMatrix(position, camera.apply((0, 0, 1)), _up(camera))
    projection = scene.bullet.computeProjectionMatrixFOV(vertical, lens.width / lens.height, _NEAR, _FAR)
    _, _, colours, buffer, _ = scene.bullet.getCameraImage(
        lens.width,
        lens.height,
        view,
        projection,
        lightDirection=_LIGHT,
        shadow=0,
        flags=pybullet.ER_NO_SEGMENTATION_MASK,
        renderer=pybullet.ER_TINY_RENDERER,
    )
    rgb = np.ascontiguousarray(np.asarray(colours, np.uint8).reshape(lens.height, lens.width, 4)[:, :, :3])
    return Picture(rgb, _depths(np.asarray(buffer, np.float64).reshape(lens.height, lens.width)))


def _up(camera: Transform) -> tuple[float, float, float]:
    return Transform(rotation=camera.rotation).apply((0, -1, 0))


def _depths(buffer: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Millimetres of what a depth buffer says (0 at the near plane, 1 at the far one)."""
    metres = _FAR * _NEAR / (_FAR - (_FAR - _NEAR) * buffer)
    return np.where(buffer < 1.0, np.rint(metres * 1000), 0).astype(np.uint16)


class Renderer:
    """The process that draws, which ends with the one that started it.

    Args:
        lens: of the camera.
    """

    def __init__(self, lens: Lens) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_draw_on_demand, args=(theirs, lens), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def pid(self) -> int:
        """Number of the process."""
        assert self._process.pid is not None, "it was started"
        return self._process.pid

    def draw(self, snapshot: Snapshot) -> Picture:
        """Draw the world as it was. Blocks; one call at a time.

        Raises:
            RendererGone: it was closed, or killed.
        """
        try:
            self._pipe.send(snapshot)
            picture: Picture = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise RendererGone("the process that draws the camera's pictures has ended") from error
        return picture

    def close(self) -> None:
        """End it; a call of :meth:`draw` that waits ends too."""
        self._process.terminate()
        self._process.join(_PATIENCE)


def _draw_on_demand(pipe: Connection[Picture, Snapshot], lens: Lens) -> None:
    """Until the other end is gone. Ctrl-C in a terminal reaches this process too, and is not for it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    scene = Scene()
    while True:
        try:
            scene.restore(pipe.recv())
            pipe.send(draw(scene, lens))
        except (EOFError, OSError):
            return
