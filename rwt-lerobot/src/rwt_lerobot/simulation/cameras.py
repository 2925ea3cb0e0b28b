"""Cameras of a model: a thread that renders and publishes images."""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rwt_lerobot.reports import logger
from rwt_lerobot.simulation.model import Model
from rwt_participant.handles import Publisher
from rwt_participant.images import compressed_image


@dataclass(frozen=True, slots=True)
class Lens:
    """Size of images, and their number per second.

    Attributes:
        shadows: render shadows, which takes ten times as long in software.
    """

    width: int = 320
    height: int = 240
    rate: float = 30.0
    shadows: bool = False


@dataclass(frozen=True, slots=True)
class _Shot:
    """State of a simulation to render."""

    positions: Any
    cameras: Sequence[str]
    stamp_ns: int


class CameraThread:
    """Renderer of a model in a thread of its own, which publishes JPEG images.

    The thread has a state of the model of its own; the simulation goes on meanwhile. A shot that arrives
    while another one is rendered is dropped.

    Args:
        model: the model.
        lens: size of the images.
        publishers: publishers of `sensor_msgs/CompressedImage` by camera; used from the thread.

    Attributes:
        dropped: number of shots that were dropped.
        error: reason why the thread has ended; empty while it renders.
    """

    def __init__(self, model: Model, lens: Lens, publishers: Mapping[str, Publisher]) -> None:
        self._model = model
        self._lens = lens
        self._publishers = publishers
        self._shots: queue.Queue[_Shot | None] = queue.Queue(1)
        self._thread = threading.Thread(target=self._run, name="cameras", daemon=True)
        self.dropped = 0
        self.error = ""
        self._thread.start()

    def shoot(self, positions: Any, cameras: Sequence[str], stamp_ns: int) -> None:
        """Render and publish images of some cameras.

        Args:
            positions: positions of the model, which the thread keeps.
            cameras: names of the cameras.
            stamp_ns: stamp of the images.
        """
        try:
            self._shots.put_nowait(_Shot(positions, cameras, stamp_ns))
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """End the thread."""
        if self._thread.is_alive():
            self._shots.put(None)
            self._thread.join()

    def _run(self) -> None:
        mujoco, compiled = self._model.mujoco, self._model.compiled
        try:
            with mujoco.Renderer(compiled, self._lens.height, self._lens.width) as renderer:
                renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = self._lens.shadows
                data = mujoco.MjData(compiled)
                while (shot := self._shots.get()) is not None:
                    data.qpos[:] = shot.positions
                    mujoco.mj_forward(compiled, data)
                    for camera in shot.cameras:
                        renderer.update_scene(data, camera)
                        image = compressed_image(
                            renderer.render(), frame_id=optical_frame(camera), stamp_ns=shot.stamp_ns
                        )
                        self._publishers[camera].publish(image)
        except Exception as error:  # OpenGL raises errors of many classes; the simulation goes on.
            self.error = f"{type(error).__name__}: {error}"
            logger.exception("the cameras ended: install libegl1, or set MUJOCO_GL=osmesa")


def optical_frame(camera: str) -> str:
    """Return the frame of a camera's images: z forward, x right, y down (REP 103)."""
    return f"{camera}_optical_frame"


def camera_info(camera: str, lens: Lens, fovy: float, stamp: Mapping[str, int]) -> dict[str, object]:
    """Return the `sensor_msgs/CameraInfo` of a pinhole camera.

    Args:
        camera: name of the camera.
        lens: size of its images.
        fovy: vertical field of view, radians.
        stamp: stamp of the header.
    """
    focal = lens.height / 2 / math.tan(fovy / 2)
    x, y = lens.width / 2, lens.height / 2
    return {
        "header": {"stamp": stamp, "frame_id": optical_frame(camera)},
        "width": lens.width,
        "height": lens.height,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [focal, 0, x, 0, focal, y, 0, 0, 1],
        "r": [1, 0, 0, 0, 1, 0, 0, 0, 1],
        "p": [focal, 0, x, 0, 0, focal, y, 0, 0, 0, 1, 0],
    }
