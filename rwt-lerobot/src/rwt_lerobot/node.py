"""Robot of LeRobot as a node: joint states and images out, trajectories and velocities in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, Protocol

import anyio.to_thread

from rwt_client import ConnectionEvent, NotConnected, Robot
from rwt_lerobot.calibration import CalibrationError
from rwt_lerobot.joints.controller import TrajectoryController
from rwt_lerobot.joints.features import POSITION
from rwt_lerobot.joints.limits import JointLimit
from rwt_lerobot.joints.scales import UNITS, Scale, calibrated_range, unit_named
from rwt_lerobot.reports import logger, warn
from rwt_participant.api import RobotApi
from rwt_participant.images import compressed_image
from rwt_participant.messages import Message, MessageLike
from rwt_participant.qos import LATCHED
from rwt_participant.timers import Watchdog
from rwt_protocol.states import StateEnum

#: Features of a mobile base, as LeKiwi names them: metres and degrees per second.
_BASE: Final = ("x.vel", "y.vel", "theta.vel")
_BASE_TIMEOUT_SECONDS: Final = 0.5
#: Interval of attempts to read a robot that does not answer.
_RETRY_SECONDS: Final = 1.0
#: Longest time that one step advances a trajectory.
_MAX_STEP_SECONDS: Final = 0.1
#: Ticks of one turn if a robot has no table of its motors: those of the Feetech motors of SO-100 and SO-101.
_USUAL_RESOLUTION: Final = 4096


class LeRobotDevice(Protocol):
    """Part of LeRobot's `Robot` that the node uses."""

    @property
    def observation_features(self) -> dict[str, Any]:
        """Types and shapes of an observation."""

    @property
    def action_features(self) -> dict[str, Any]:
        """Types of an action."""

    def get_observation(self) -> dict[str, Any]:
        """Read the robot."""

    def send_action(self, action: dict[str, Any], /) -> dict[str, Any]:
        """Command the robot."""


@dataclass(frozen=True, slots=True)
class MotorJoint:
    """Motor of a robot, and the joint that it moves.

    Attributes:
        motor: name of the motor in LeRobot's features, without `.pos`.
        limit: limits of the joint, with its name in messages.
        scale: unit of the motor.
    """

    motor: str
    limit: JointLimit
    scale: Scale


class UnknownUnit(ValueError):
    """The unit of a motor is not known; the text says how to state it."""


def motor_joints(
    robot: Any,
    limits: Mapping[str, JointLimit] | None = None,
    units: Mapping[str, str] | None = None,
    *,
    speed: float | None = None,
    step: float | None = None,
) -> tuple[MotorJoint, ...]:
    """Return the joints of a robot of LeRobot, by its motors, their calibration and a URDF.

    Args:
        robot: robot of LeRobot.
        limits: limits of a URDF by joint; a joint has the name of its motor.
        units: units of motors by name, for robots whose class has no `bus` that states them.
        speed: maximum speed of every joint, in place of the URDF's.
        step: maximum distance of a command without a time.

    Raises:
        UnknownUnit: the unit or the range of a motor is not known.
    """
    stated, known = dict(units or {}), limits or {}
    bus = getattr(robot, "bus", None)
    motors = getattr(bus, "motors", {})
    found: list[MotorJoint] = []
    for feature in robot.action_features:
        if not feature.endswith(POSITION):
            continue
        name = feature.removesuffix(POSITION)
        motor = motors.get(name)
        mode = stated.get(name) or getattr(getattr(motor, "norm_mode", None), "value", "")
        unit = unit_named(mode)
        if unit is None:
            raise UnknownUnit(f"the unit of motor {name!r} is {mode!r}: state one of {', '.join(UNITS)}")
        limit = known.get(name)
        calibration = (getattr(robot, "calibration", None) or {}).get(name)
        if limit is None and calibration is not None:
            table = getattr(bus, "model_resolution_table", {})
            resolution = table.get(getattr(motor, "model", ""), _USUAL_RESOLUTION)
            limit = JointLimit(name, *calibrated_range(calibration, resolution, unit))
        if limit is None:
            if unit in ("range_m100_100", "range_0_100"):
                raise UnknownUnit(
                    f"the range of motor {name!r} is not known: calibrate the robot, or give a URDF"
                )
            limit = JointLimit(name)
        if speed is not None:
            limit = replace(limit, speed=speed)
        if step is not None:
            limit = replace(limit, step=step)
        found.append(MotorJoint(name, limit, Scale(unit, limit.lower, limit.upper)))
    return tuple(found)


class _NodeState(StateEnum):
    RUNNING = "FAILED", "CLOSED"
    FAILED = "RUNNING", "FAILED", "CLOSED"
    CLOSED = "CLOSED"


class LeRobotNode:
    """Node for one robot of LeRobot, which is connected already.

    Life cycle::

        RUNNING ── the robot does not answer ──> FAILED ── close() ──> CLOSED
         │^────── the robot answers again ──────────┘                    ^
         └────────────────────────── close() ────────────────────────────┘

    In FAILED, ``error`` is the reason, and reading is tried again at ``_retry_at``. After CLOSED, an exchange
    with the robot may still end in its thread.

    It reads and commands the robot `rate` times a second, in a thread. Trajectories arrive on
    `arm_controller/joint_trajectory` and the action `arm_controller/follow_joint_trajectory`; a mobile base
    takes `cmd_vel`, and stops after half a second without one. If the robot does not answer, trajectories are
    rejected with the reason, no states are published, and reading is tried once a second. If the connection
    to its server is lost, the robot holds its position.

    Args:
        api: node of a graph, or client of a server.
        robot: robot of LeRobot, or what has its methods.
        joints: joints of the robot; by default :func:`motor_joints`.
        rate: times a second.
        description: URDF to publish on `robot_description`.
        namespace: prefix of all names.
        calibrations: `sensor_msgs/CameraInfo` by camera, of :func:`rwt_lerobot.calibration.camera_info`.

    Raises:
        CalibrationError: a calibration is for another camera, or another size of images.

    Attributes:
        controller: controller of the joints.
        error: reason why the robot does not answer; empty if it does.
    """

    def __init__(
        self,
        api: RobotApi,
        robot: LeRobotDevice,
        joints: Sequence[MotorJoint] | None = None,
        *,
        rate: float = 30.0,
        description: str = "",
        namespace: str = "",
        calibrations: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        self._calibrations = _checked(calibrations or {}, robot.observation_features)
        self._api = api
        self._robot = robot
        self._joints = motor_joints(robot) if joints is None else tuple(joints)
        self._name = namespace.strip("/") or "lerobot"
        self._prefix = f"/{namespace.strip('/')}".rstrip("/")
        self._period = 1.0 / rate
        self._stepped = api.clock.monotonic()
        self._retry_at = 0.0
        self._state = _NodeState.RUNNING
        self.error = ""
        self.controller = TrajectoryController(
            api,
            [joint.limit for joint in self._joints],
            f"{self._prefix}/arm_controller",
            partial(warn, api, self._name),
        )
        self._states = api.advertise(f"{self._prefix}/joint_states", "sensor_msgs/JointState")
        self._images = {
            name: (
                api.advertise(f"{self._prefix}/{name}/image_raw/compressed", "sensor_msgs/CompressedImage"),
                api.advertise(f"{self._prefix}/{name}/camera_info", "sensor_msgs/CameraInfo"),
            )
            for name, shape in robot.observation_features.items()
            if isinstance(shape, tuple)
        }
        self._base: dict[str, float] = dict.fromkeys(_BASE, 0.0)
        self._watchdog: Watchdog | None = None
        if set(_BASE) <= robot.action_features.keys():
            self._watchdog = Watchdog(api, _BASE_TIMEOUT_SECONDS, self._stop_base)
            api.subscribe(f"{self._prefix}/cmd_vel", self._drive, "geometry_msgs/Twist")
            self._velocity = api.advertise(f"{self._prefix}/velocity", "geometry_msgs/TwistStamped")
        if description:
            publisher = api.advertise(f"{self._prefix}/robot_description", "std_msgs/String", qos=LATCHED)
            publisher.publish({"data": description})
        self._timer = api.create_timer(self._period, self._step)
        if isinstance(api, Robot):
            api.on_event(self._on_event)

    def close(self) -> None:
        """Stop reading and commanding. The robot stays connected, and its motors hold their position."""
        self._state = self._state.become(_NodeState.CLOSED)
        self._timer.cancel()
        self.controller.close()
        if self._watchdog is not None:
            self._watchdog.close()
        self._states.close()

    def _on_event(self, event: ConnectionEvent) -> None:
        if event.kind == "lost":  # A stop cannot arrive.
            self.controller.hold("the connection to the server was lost")
            self._stop_base()

    def _drive(self, twist: Message) -> None:
        assert self._watchdog is not None  # Subscribed with it.
        velocities = twist.linear.x, twist.linear.y, math.degrees(twist.angular.z)
        if not all(map(math.isfinite, velocities)):
            warn(self._api, self._name, "rejected a velocity that is not finite")
            return
        self._watchdog.feed()
        self._base = dict(zip(_BASE, velocities, strict=True))

    def _stop_base(self) -> None:
        self._base = dict.fromkeys(_BASE, 0.0)

    async def _step(self) -> None:
        now = self._api.clock.monotonic()
        if self._state is _NodeState.FAILED and now < self._retry_at:
            return
        seconds, self._stepped = min(now - self._stepped, _MAX_STEP_SECONDS), now
        action = None if self.error else self._action(seconds)
        try:
            observation, images = await anyio.to_thread.run_sync(self._exchange, action)
        except Exception as error:  # Drivers raise errors of many classes; clients get the text.
            if self._state is _NodeState.CLOSED:
                return
            self._retry_at = now + _RETRY_SECONDS
            self._fail(f"{type(error).__name__}: {error}")
            return
        if self._state is _NodeState.CLOSED:  # Meanwhile.
            return
        if self._state is _NodeState.FAILED:
            self._state = self._state.become(_NodeState.RUNNING)
            self.error = ""
            warn(self._api, self._name, "the robot answers again, and holds its position")
        with suppress(NotConnected):  # Nobody hears it until the client has restored the connection.
            self._publish(observation, images)

    def _fail(self, reason: str) -> None:
        self._state = self._state.become(_NodeState.FAILED)
        if reason != self.error:
            logger.exception("the robot failed")
            self.error = reason
            warn(self._api, self._name, f"the robot does not answer: {reason}")
        self.controller.fail(f"the robot does not answer: {reason}")
        self._stop_base()

    def _action(self, seconds: float) -> dict[str, float] | None:
        setpoint = self.controller.step(seconds)
        if setpoint is None or not (self.controller.is_commanded or self._watchdog is not None):
            return None
        action = {
            f"{joint.motor}{POSITION}": joint.scale.from_radians(angle)
            for joint, angle in zip(self._joints, setpoint, strict=True)
        }
        return action if self._watchdog is None else {**action, **self._base}

    def _exchange(self, action: dict[str, float] | None) -> tuple[dict[str, Any], dict[str, MessageLike]]:
        """Command and read the robot, and compress its images; runs in a thread."""
        if action is not None:
            self._robot.send_action(action)
        observation = self._robot.get_observation()
        images: dict[str, MessageLike] = {
            name: compressed_image(observation[name], frame_id=f"{name}_optical_frame")
            for name in self._images
        }
        return observation, images

    def _publish(self, observation: dict[str, Any], images: Mapping[str, MessageLike]) -> None:
        positions = tuple(
            joint.scale.to_radians(float(observation[f"{joint.motor}{POSITION}"])) for joint in self._joints
        )
        self.controller.measure(positions)
        names = [joint.limit.name for joint in self._joints]
        self._states.publish({"name": names, "position": positions})
        for name, image in images.items():
            picture, info = self._images[name]
            picture.publish(image)
            height, width = observation[name].shape[:2]
            frame = {"frame_id": f"{name}_optical_frame"}
            size = {"height": height, "width": width}
            info.publish({**self._calibrations.get(name, size), "header": frame})
        if self._watchdog is not None:
            x, y, theta = (float(observation[name]) for name in _BASE)
            twist = {"linear": {"x": x, "y": y}, "angular": {"z": math.radians(theta)}}
            self._velocity.publish({"header": {"frame_id": "base_link"}, "twist": twist})


def _checked(
    calibrations: Mapping[str, Mapping[str, Any]], features: Mapping[str, Any]
) -> Mapping[str, Mapping[str, Any]]:
    for name, info in calibrations.items():
        shape = features.get(name)
        if not isinstance(shape, tuple):
            raise CalibrationError(f"the robot has no camera {name!r}")
        if (info["height"], info["width"]) != shape[:2]:
            raise CalibrationError(
                f"{name}: the calibration is for {info['width']}x{info['height']},"
                f" the images are {shape[1]}x{shape[0]}"
            )
    return calibrations
