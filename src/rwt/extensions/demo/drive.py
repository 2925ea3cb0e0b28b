"""A differential drive: two wheels, velocity commands, and the resulting motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rwt.extensions.demo.world.map import World
from rwt_graph import Node
from rwt_participant.messages import Message

#: Maximum distance between two collision checks, metres; far less than the thickness of walls.
_CHECK_EVERY = 0.02


@dataclass(frozen=True, slots=True)
class Chassis:
    """Dimensions and limits of the robot's body.

    Attributes:
        radius: radius of the round body, metres.
        wheel_radius: metres.
        track: distance between the two wheels, metres.
    """

    radius: float = 0.2
    wheel_radius: float = 0.05
    track: float = 0.3


@dataclass(slots=True)
class MotorLimits:
    """Limits of the motors, in m/s, rad/s, m/s² and rad/s²."""

    speed: float = 0.8
    turn_rate: float = 2.0
    acceleration: float = 2.0
    turn_acceleration: float = 8.0


@dataclass(frozen=True, slots=True)
class Velocity:
    """Velocity: forwards in m/s, counterclockwise in rad/s."""

    linear: float = 0.0
    angular: float = 0.0

    @property
    def is_zero(self) -> bool:
        """True if the robot stands still."""
        return self.linear == 0.0 and self.angular == 0.0


STANDSTILL = Velocity()


class DifferentialDrive:
    """Motion of the robot, step by step: pose, velocity and wheel angles.

    Attributes:
        limits: limits of the motors; may be changed at any time.
        pose: pose in the map frame.
        left_angle: rotation of the left wheel since the start, radians.
        right_angle: rotation of the right wheel since the start, radians.
        enabled: True if the motors have power.
        bumped: True if the last step ended at something solid.
    """

    def __init__(self, world: World, chassis: Chassis, limits: MotorLimits) -> None:
        self.limits = limits
        self._world = world
        self._chassis = chassis
        self.enabled = True
        self.reset()

    def reset(self) -> None:
        """Return to the start with the wheels at zero. The motors keep their state."""
        self.pose = self._world.start
        self.velocity = STANDSTILL
        self.left_angle = 0.0
        self.right_angle = 0.0
        self.bumped = False

    def stop(self) -> None:
        """Stop at once, as with brakes."""
        self.velocity = STANDSTILL

    def step(self, wanted: Velocity, seconds: float) -> None:
        """Follow `wanted` within the limits for `seconds`; obstacles stop the robot."""
        limits, now = self.limits, self.velocity
        if not self.enabled:
            wanted = STANDSTILL
        linear = _approach(now.linear, wanted.linear, limits.speed, limits.acceleration * seconds)
        turn_change = limits.turn_acceleration * seconds
        angular = _approach(now.angular, wanted.angular, limits.turn_rate, turn_change)
        self.bumped = False
        if linear or angular:
            self._move(linear, angular, seconds)
        else:
            self.velocity = STANDSTILL

    def _move(self, linear: float, angular: float, seconds: float) -> None:
        checks = max(1, math.ceil(abs(linear) * seconds / _CHECK_EVERY))
        slice_ = seconds / checks
        for _ in range(checks):
            there = self.pose.moved(linear, angular, slice_)
            if linear and self._world.clearance(there.x, there.y) < self._chassis.radius:
                # A round body can always turn in place, so only forward motion is blocked.
                self.bumped = True
                linear = 0.0
                there = self.pose.moved(0.0, angular, slice_)
            self._turn_wheels(linear, angular, slice_)
            self.pose = there
        self.velocity = Velocity(linear, angular)

    def _turn_wheels(self, linear: float, angular: float, seconds: float) -> None:
        apart = angular * self._chassis.track / 2
        self.left_angle += (linear - apart) / self._chassis.wheel_radius * seconds
        self.right_angle += (linear + apart) / self._chassis.wheel_radius * seconds


def _approach(value: float, target: float, limit: float, change: float) -> float:
    target = max(-limit, min(limit, target))
    # The tolerance is for sums of steps that miss the target by rounding.
    if abs(target - value) <= change + 1e-9:
        return target
    return value + math.copysign(change, target - value)


class Teleop:
    """The last velocity command.

    Attributes:
        timeout: seconds after which a command expires.
    """

    timeout = 0.5

    def __init__(self, node: Node) -> None:
        self._node = node
        self._last: Velocity | None = None
        self._since = 0.0
        node.subscribe("cmd_vel", self._on_twist, "geometry_msgs/Twist")

    @property
    def velocity(self) -> Velocity | None:
        """Return the current command, or None if it has expired."""
        # A step that ends with the timeout still belongs to the command, despite rounding.
        if self._last is not None and self._node.clock.monotonic() - self._since > self.timeout + 1e-6:
            self._last = None
        return self._last

    def forget(self) -> None:
        """Drop the command."""
        self._last = None

    def _on_twist(self, twist: Message) -> None:
        if not (math.isfinite(twist.linear.x) and math.isfinite(twist.angular.z)):
            topic = self._node.resolve("cmd_vel")
            text = f"{topic}: linear.x or angular.z is not a finite number; ignored"
            self._node.log.warning(text)
            return
        self._last = Velocity(twist.linear.x, twist.angular.z)
        self._since = self._node.clock.monotonic()
