"""State publisher: `/odom`, `/tf`, `/tf_static`, `/joint_states`, `/robot_description`."""

from __future__ import annotations

import math
from collections.abc import Mapping

from husky_xarm.description import ROOT, Description, Joint
from husky_xarm.simulation import JointState, Simulation
from rwt.extensions.demo import messages
from rwt_graph import Node
from rwt_tf2 import StampedTransform, Transform, write_transform

_ODOM = "odom"


class StatePublisher:
    """Publishes them, to those who listen. Odometry is where the robot truly is, from the world's origin."""

    def __init__(self, node: Node, simulation: Simulation, description: Description) -> None:
        self._node = node
        self._simulation = simulation
        self._turning = [joint for joint in description.joints if joint.axis is not None]
        self._odom = node.advertise("/odom", "nav_msgs/Odometry")
        self._tf = node.advertise("/tf", "tf2_msgs/TFMessage")
        self._joints = node.advertise("/joint_states", "sensor_msgs/JointState")
        self._describe(description.urdf)
        fixed = [joint for joint in description.joints if joint.axis is None]
        stamp = node.clock.time_ns()
        node.advertise("/tf_static", "tf2_msgs/TFMessage", latch=True).publish(
            {"transforms": [_transform(stamp, joint, joint.origin) for joint in fixed]}
        )

    def publish(self) -> None:
        """Publish the state of this moment."""
        stamp = self._node.clock.time_ns()
        if self._odom.subscriber_count:
            self._odom.publish(self._odometry(stamp))
        if not (self._tf.subscriber_count or self._joints.subscriber_count):
            return
        states = self._simulation.joints()
        if self._tf.subscriber_count:
            self._tf.publish({"transforms": self._transforms(stamp, states)})
        if self._joints.subscriber_count:
            self._joints.publish(_joint_states(stamp, states))

    def _odometry(self, stamp: int) -> messages.Message:
        place = self._simulation.place
        return {
            "header": messages.header(stamp, _ODOM),
            "child_frame_id": ROOT,
            "pose": {
                "pose": {
                    "position": messages.vector(*place.translation),
                    "orientation": dict(zip("xyzw", place.rotation, strict=True)),
                }
            },
            "twist": {"twist": messages.twist(self._simulation.velocity)},
        }

    def _transforms(self, stamp: int, states: Mapping[str, JointState]) -> list[messages.Message]:
        base = StampedTransform(_ODOM, ROOT, stamp, self._simulation.place)
        return [
            write_transform(base),
            *(
                _transform(stamp, joint, joint.origin @ _turn(joint, states[joint.name].position))
                for joint in self._turning
            ),
        ]

    def _describe(self, urdf: str) -> None:
        """The URDF where programs look for it: a latched topic, a parameter, and ROS 1's global parameter."""
        node = self._node
        node.advertise("/robot_description", "std_msgs/String", latch=True).publish({"data": urdf})
        if node.distro.parameters_belong_to_nodes:
            node.parameters.declare(
                "robot_description", urdf, description="The robot as URDF.", read_only=True
            )
        node.graph.run_on_graph(lambda: node.graph.parameters.set("/robot_description", urdf))


def _turn(joint: Joint, angle: float) -> Transform:
    """A turn around the joint's axis; one that never moves has none."""
    x, y, z = joint.axis or (0.0, 0.0, 0.0)
    sine = math.sin(angle / 2)
    return Transform(rotation=(x * sine, y * sine, z * sine, math.cos(angle / 2)))


def _transform(stamp: int, joint: Joint, transform: Transform) -> messages.Message:
    return write_transform(StampedTransform(joint.parent, joint.child, stamp, transform))


def _joint_states(stamp: int, states: Mapping[str, JointState]) -> messages.Message:
    return {
        "header": messages.header(stamp, ""),
        "name": list(states),
        "position": [state.position for state in states.values()],
        "velocity": [state.velocity for state in states.values()],
        "effort": [state.effort for state in states.values()],
    }
