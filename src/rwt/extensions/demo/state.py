"""The robot's state: odometry, transforms, joint states and battery."""

from __future__ import annotations

from rwt.extensions.demo import messages
from rwt.extensions.demo.arm.kinematics import ARM, Arm
from rwt.extensions.demo.drive import Chassis, DifferentialDrive, Velocity
from rwt.extensions.demo.messages import MAP, ODOM, frame
from rwt.extensions.demo.model.urdf import (
    BASE,
    LEFT_JOINT,
    OPENNI_OPTICAL,
    OPTICAL,
    RIGHT_JOINT,
    Mount,
    arm_mounts,
    fixed_mounts,
    wheel_mounts,
)
from rwt.extensions.demo.world.map import Pose
from rwt_graph import Node
from rwt_tf2 import quaternion_from_euler, quaternion_from_yaw

#: Diagonals of the odometry's covariances: drift in x, y and yaw only.
_POSE_COVARIANCE = [0.001 if i in (0, 7, 35) else 1e-6 if i % 7 == 0 else 0.0 for i in range(36)]

_ARM_JOINTS = tuple(joint.name for joint in ARM)


class StatePublisher:
    """Publisher of `/odom`, `/tf`, `/tf_static`, `/joint_states`, and `/robot_pose` for pages with a map."""

    def __init__(
        self, node: Node, drive: DifferentialDrive, arm: Arm, chassis: Chassis, odom_origin: Pose
    ) -> None:
        self._node = node
        self._drive = drive
        self._arm = arm
        self._origin = odom_origin
        self._map, self._odom_frame, self._base = (frame(node, name) for name in (MAP, ODOM, BASE))
        axes = ["y", "y", *(joint.axis for joint in ARM)]
        #: Parent, link, position and rotation by angle of the wheels, then of the links of the arm.
        self._moving = [
            (
                frame(node, mount.parent),
                frame(node, mount.link),
                messages.vector(mount.x, mount.y, mount.z),
                messages.turn_about_y if axis == "y" else quaternion_from_yaw,
            )
            for mount, axis in zip((*wheel_mounts(chassis), *arm_mounts()), axes, strict=True)
        ]
        self._chassis = chassis
        self._odom = node.advertise("odom", "nav_msgs/Odometry")
        self._pose = node.advertise("robot_pose", "geometry_msgs/Pose")
        self._tf = node.advertise("/tf", "tf2_msgs/TFMessage")
        self._joints = node.advertise("joint_states", "sensor_msgs/JointState")
        self._fixed = node.advertise("/tf_static", "tf2_msgs/TFMessage", latch=True)
        self.publish_fixed()

    def publish_fixed(self, *, openni: bool = False) -> None:
        """Publish the transforms that do not change, with OpenNI's name of the camera's frame if asked."""
        stamp = self._node.clock.time_ns()
        mounts = fixed_mounts(self._chassis) + ((Mount(OPENNI_OPTICAL, parent=OPTICAL),) if openni else ())
        transforms = [
            messages.transform(
                stamp,
                frame(self._node, mount.parent),
                frame(self._node, mount.link),
                messages.vector(mount.x, mount.y, mount.z),
                quaternion_from_euler(*mount.rpy),
            )
            for mount in mounts
        ]
        self._fixed.publish({"transforms": transforms})

    def publish(self) -> None:
        """Publish the current state on every topic with subscribers."""
        stamp = self._node.clock.time_ns()
        if self._pose.subscriber_count:
            self._pose.publish(messages.pose(self._drive.pose))
        if self._odom.subscriber_count:
            self._odom.publish(self._odometry(stamp))
        if self._tf.subscriber_count:
            self._tf.publish({"transforms": self._transforms(stamp)})
        if self._joints.subscriber_count:
            self._joints.publish(self._joint_state(stamp))

    def _odometry(self, stamp: int) -> messages.Message:
        return {
            "header": messages.header(stamp, self._odom_frame),
            "child_frame_id": self._base,
            "pose": {
                "pose": messages.pose(self._drive.pose.seen_from(self._origin)),
                "covariance": _POSE_COVARIANCE,
            },
            "twist": {"twist": messages.twist(self._drive.velocity), "covariance": _POSE_COVARIANCE},
        }

    def _transforms(self, stamp: int) -> list[messages.Message]:
        body = self._drive.pose.seen_from(self._origin)
        return [
            messages.planar_transform(stamp, self._map, self._odom_frame, self._origin),
            messages.planar_transform(stamp, self._odom_frame, self._base, body),
            *(
                messages.transform(stamp, parent, link, place, turn(angle))
                for (parent, link, place, turn), angle in zip(self._moving, self._angles(), strict=True)
            ),
        ]

    def _angles(self) -> list[float]:
        return [self._drive.left_angle, self._drive.right_angle, *self._arm.positions]

    def _joint_state(self, stamp: int) -> messages.Message:
        velocity, chassis = self._drive.velocity, self._chassis
        apart = velocity.angular * chassis.track / 2
        return {
            "header": messages.header(stamp, ""),
            "name": [LEFT_JOINT, RIGHT_JOINT, *_ARM_JOINTS],
            "position": self._angles(),
            "velocity": [
                (velocity.linear - apart) / chassis.wheel_radius,
                (velocity.linear + apart) / chassis.wheel_radius,
                *self._arm.velocities,
            ],
        }


#: Volts of three lithium cells, empty and full.
EMPTY_VOLTAGE = 9.9
FULL_VOLTAGE = 12.6
#: Ampere hours when full.
CAPACITY = 2.5
#: Numbers of `sensor_msgs/BatteryState`.
_DISCHARGING, _HEALTH_GOOD, _LITHIUM_ION = 2, 1, 2
_CELLS = 3
#: Amperes of the computer and the laser, and of the motors for each m/s and each rad/s.
_IDLE_CURRENT = 0.8
_DRIVING_CURRENT = 3.0
_TURNING_CURRENT = 0.6


class Battery:
    """State of charge.

    Attributes:
        level: 1.0 full, 0.0 empty.
        current: current draw, amperes.
    """

    def __init__(self) -> None:
        self.level = 1.0
        self.current = _IDLE_CURRENT

    @property
    def voltage(self) -> float:
        """Voltage at this level."""
        return EMPTY_VOLTAGE + (FULL_VOLTAGE - EMPTY_VOLTAGE) * self.level

    def swap(self) -> None:
        """Recharge the battery."""
        self.level = 1.0

    def drain(self, velocity: Velocity, seconds: float) -> None:
        """Draw current for `seconds` at that velocity; an empty battery stays at 0."""
        self.current = (
            _IDLE_CURRENT + _DRIVING_CURRENT * abs(velocity.linear) + _TURNING_CURRENT * abs(velocity.angular)
        )
        self.level = max(0.0, self.level - self.current * seconds / 3600 / CAPACITY)


class BatteryPublisher:
    """Publisher of `/battery_state`."""

    def __init__(self, node: Node, battery: Battery) -> None:
        self._node = node
        self._battery = battery
        self._frame = messages.frame(node, BASE)
        self._states = node.advertise("battery_state", "sensor_msgs/BatteryState")

    def publish(self) -> None:
        """Publish the current state."""
        battery = self._battery
        self._states.publish(
            {
                "header": messages.header(self._node.clock.time_ns(), self._frame),
                "voltage": round(battery.voltage, 3),
                "current": round(-battery.current, 3),
                "charge": round(battery.level * CAPACITY, 4),
                "capacity": CAPACITY,
                "design_capacity": CAPACITY,
                "percentage": round(battery.level, 4),
                "power_supply_status": _DISCHARGING,
                "power_supply_health": _HEALTH_GOOD,
                "power_supply_technology": _LITHIUM_ION,
                "present": True,
                "cell_voltage": [round(battery.voltage / _CELLS, 3)] * _CELLS,
                "location": "main",
            }
        )
