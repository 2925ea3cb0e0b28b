"""The world in a Bullet of its own: the robot, and what stands around it.

Two processes load it: the one that simulates, and the one that draws. Bodies get the same numbers in both, so
what moves is handed over as a :class:`Snapshot`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import pybullet
import pybullet_data

from husky_xarm.description import ARM_JOINTS, describe

Place = tuple[tuple[float, float, float], tuple[float, float, float, float]]
"""Position (metres) and orientation (x, y, z, w) in the world."""

HOME: Final = dict(zip(ARM_JOINTS, (0.0, -0.9, -0.7, 0.0, 1.6, 0.0), strict=True))
"""Initial joint angles of the arm, radians."""

_BLOCKS: Final = (
    ((2.2, 0.0, 0.25), 0.25, (0.9, 0.1, 0.1, 1.0)),
    ((3.0, 1.2, 0.35), 0.35, (0.1, 0.6, 0.15, 1.0)),
    ((2.8, -1.3, 0.2), 0.2, (0.15, 0.25, 0.9, 1.0)),
    ((-2.5, 0.8, 0.3), 0.3, (0.95, 0.75, 0.1, 1.0)),
)
"""Centre, half of the edge, colour. They can be pushed."""
_BLOCK_MASS = 3.0
_START_HEIGHT = 0.02


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Positions of all bodies and joints.

    Attributes:
        bodies: by the body's number.
        joints: angles of the robot's joints that move, in the order of :attr:`Scene.moving`, radians.
    """

    bodies: tuple[Place, ...]
    joints: tuple[float, ...]


class Bullet:
    """A world of PyBullet's own: its functions, each for this world.

    PyBullet has no types; what comes back from here is what its own documentation says.
    """

    def __init__(self) -> None:
        self._number: int = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(pybullet, name)
        return partial(function, physicsClientId=self._number)


class Scene:
    """The world, loaded.

    Attributes:
        bullet: what it is loaded in.
        robot: the robot's number.
        joint_numbers: of the robot, by the joint's name.
        link_numbers: of the robot, by the link's name.
        moving: joints that move.
    """

    def __init__(self) -> None:
        self.bullet = Bullet()
        self.bullet.loadURDF(f"{pybullet_data.getDataPath()}/plane.urdf")
        self.robot = self._load_robot()
        for place, half, colour in _BLOCKS:
            self._add_block(place, half, colour)
        infos = [
            self.bullet.getJointInfo(self.robot, number)
            for number in range(self.bullet.getNumJoints(self.robot))
        ]
        self.joint_numbers: dict[str, int] = {info[1].decode(): info[0] for info in infos}
        self.link_numbers: dict[str, int] = {info[12].decode(): info[0] for info in infos}
        self.moving: tuple[str, ...] = tuple(
            info[1].decode() for info in infos if info[2] == pybullet.JOINT_REVOLUTE
        )

    def snapshot(self) -> Snapshot:
        """Return the current positions."""
        bodies = tuple(
            self.bullet.getBasePositionAndOrientation(body) for body in range(self.bullet.getNumBodies())
        )
        numbers = [self.joint_numbers[name] for name in self.moving]
        return Snapshot(bodies, tuple(state[0] for state in self.bullet.getJointStates(self.robot, numbers)))

    def restore(self, snapshot: Snapshot) -> None:
        """Put everything where it was."""
        for body, (position, orientation) in enumerate(snapshot.bodies):
            self.bullet.resetBasePositionAndOrientation(body, position, orientation)
        for name, angle in zip(self.moving, snapshot.joints, strict=True):
            self.bullet.resetJointState(self.robot, self.joint_numbers[name], angle)

    def close(self) -> None:
        """End this Bullet."""
        self.bullet.disconnect()

    def _load_robot(self) -> int:
        """Bullet reads descriptions from files only."""
        with tempfile.TemporaryDirectory(prefix="husky_xarm_") as folder:
            file = Path(folder, "robot.urdf")
            file.write_text(describe().with_paths(), encoding="utf-8")
            robot: int = self.bullet.loadURDF(
                str(file), (0.0, 0.0, _START_HEIGHT), flags=pybullet.URDF_USE_SELF_COLLISION_EXCLUDE_PARENT
            )
        return robot

    def _add_block(self, place: tuple[float, ...], half: float, colour: tuple[float, ...]) -> None:
        size = (half, half, half)
        bullet = self.bullet
        bullet.createMultiBody(
            _BLOCK_MASS,
            bullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=size),
            bullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=size, rgbaColor=colour),
            place,
        )
