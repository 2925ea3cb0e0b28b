"""The physics: motors of wheels and arm, and what becomes of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import pybullet

from husky_xarm.description import ARM_JOINTS, LEFT_WHEELS, RIGHT_WHEELS, Joint, describe
from husky_xarm.scene import HOME, Place, Scene, Snapshot
from rwt.extensions.demo.drive import Velocity
from rwt_tf2 import Transform

STEP: Final = 1 / 240
"""Seconds; Bullet is tuned for this."""
MAX_SPEED: Final = 1.0
"""Metres per second: the Husky's."""
MAX_TURN_RATE: Final = 1.5
"""Radians per second."""

_WHEEL_RADIUS = 0.1778
_TRACK = 0.5708
#: Wheels that do not steer must slip sideways when the robot turns: the less they grip across, the more the
#: turn is the one that was asked for. Along, across, upwards.
_GRIP = (1.0, 0.05, 1.0)
#: What they still lose, measured.
_SLIP = 1.05
_WHEEL_EFFORT = 60.0
_ACCELERATION = 1.5
_TURN_ACCELERATION = 3.0
#: Until wheels and arm have settled on the floor.
_SETTLING_STEPS = 120


@dataclass(frozen=True, slots=True)
class JointState:
    """State of a joint: radians, radians per second, newton metres."""

    position: float
    velocity: float
    effort: float


class Simulation:
    """The world while time passes in it; it stands still between two calls of :meth:`advance`."""

    def __init__(self) -> None:
        self._scene = Scene()
        self._bullet = self._scene.bullet
        self._bullet.setGravity(0.0, 0.0, -9.81)
        self._bullet.setTimeStep(STEP)
        self._arm: dict[str, Joint] = {j.name: j for j in describe().joints if j.name in ARM_JOINTS}
        self._wanted = self._driven = Velocity(0.0, 0.0)
        self._left_over = 0.0
        for wheel in (*LEFT_WHEELS, *RIGHT_WHEELS):
            link = self._scene.link_numbers[f"{wheel}_link"]
            self._bullet.changeDynamics(
                self._scene.robot, link, lateralFriction=1.0, anisotropicFriction=_GRIP
            )
        for name, angle in HOME.items():
            self._bullet.resetJointState(self._scene.robot, self._scene.joint_numbers[name], angle)
        self.move_arm(HOME)
        self._turn_wheels()
        for _ in range(_SETTLING_STEPS):
            self._bullet.stepSimulation()

    def close(self) -> None:
        """End it."""
        self._scene.close()

    def drive(self, velocity: Velocity) -> None:
        """Go this fast from now on, as far as the robot can."""
        self._wanted = Velocity(
            max(-MAX_SPEED, min(velocity.linear, MAX_SPEED)),
            max(-MAX_TURN_RATE, min(velocity.angular, MAX_TURN_RATE)),
        )

    def move_arm(self, positions: Mapping[str, float]) -> None:
        """Let the motors of these joints go to these angles, radians, and hold them."""
        for name, position in positions.items():
            self._bullet.setJointMotorControl2(
                self._scene.robot,
                self._scene.joint_numbers[name],
                pybullet.POSITION_CONTROL,
                targetPosition=position,
                force=self._arm[name].max_effort,
                maxVelocity=self._arm[name].max_velocity,
            )

    def advance(self, seconds: float) -> None:
        """Let time pass, in whole steps; what is left over counts the next time."""
        steps, self._left_over = divmod(self._left_over + seconds, STEP)
        self._speed_up(steps * STEP)
        for _ in range(int(steps)):
            self._bullet.stepSimulation()

    @property
    def place(self) -> Transform:
        """Pose of base_footprint in the world."""
        place: Place = self._bullet.getBasePositionAndOrientation(self._scene.robot)
        return Transform(*place)

    @property
    def velocity(self) -> Velocity:
        """Linear and angular velocity of the robot, in its own frame."""
        linear, angular = self._bullet.getBaseVelocity(self._scene.robot)
        turned_back = Transform(rotation=self.place.rotation).inverse()
        return Velocity(turned_back.apply(linear)[0], turned_back.apply(angular)[2])

    def joints(self) -> Mapping[str, JointState]:
        """Movable joints, by name."""
        names = self._scene.moving
        numbers = [self._scene.joint_numbers[name] for name in names]
        states = self._bullet.getJointStates(self._scene.robot, numbers)
        return {
            name: JointState(state[0], state[1], state[3]) for name, state in zip(names, states, strict=True)
        }

    def snapshot(self) -> Snapshot:
        """Return all positions, for a renderer."""
        return self._scene.snapshot()

    def _speed_up(self, seconds: float) -> None:
        """Towards the speed that is wanted, no faster than the arm stays upright with."""
        driven, wanted = self._driven, self._wanted
        self._driven = Velocity(
            _approach(driven.linear, wanted.linear, _ACCELERATION * seconds),
            _approach(driven.angular, wanted.angular, _TURN_ACCELERATION * seconds),
        )
        self._turn_wheels()

    def _turn_wheels(self) -> None:
        apart = self._driven.angular * _SLIP * _TRACK / 2
        for wheels, speed in (
            (LEFT_WHEELS, self._driven.linear - apart),
            (RIGHT_WHEELS, self._driven.linear + apart),
        ):
            for wheel in wheels:
                self._bullet.setJointMotorControl2(
                    self._scene.robot,
                    self._scene.joint_numbers[wheel],
                    pybullet.VELOCITY_CONTROL,
                    targetVelocity=speed / _WHEEL_RADIUS,
                    force=_WHEEL_EFFORT,
                )


def _approach(value: float, target: float, step: float) -> float:
    return target if abs(target - value) <= step else value + math.copysign(step, target - value)
