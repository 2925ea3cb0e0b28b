"""A small arm with six joints: dimensions, and motion along trajectories."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from rwt_graph.trajectories import Trajectory


@dataclass(frozen=True, slots=True)
class ArmJoint:
    """Joint and the link that it turns, drawn as a cylinder along z.

    Attributes:
        link: link that it turns, with the joint at its origin.
        height: position of the joint along z of the previous link, metres.
        length: length of the link, metres.
        radius: radius of the link, metres.
        limit: maximum angle either way, radians.
        speed: maximum speed, radians per second.
        rest: angle at the start and after a reset, radians.
    """

    name: str
    link: str
    height: float
    axis: Literal["y", "z"]
    length: float
    radius: float
    limit: float
    speed: float
    rest: float


ARM: Final = (
    ArmJoint("shoulder_pan_joint", "shoulder_link", 0.05, "z", 0.04, 0.035, 3.1, 2.0, 0.0),
    ArmJoint("shoulder_lift_joint", "upper_arm_link", 0.04, "y", 0.18, 0.025, 2.2, 2.0, -0.7),
    ArmJoint("elbow_joint", "forearm_link", 0.18, "y", 0.15, 0.02, 2.6, 2.0, 2.2),
    ArmJoint("wrist_1_joint", "wrist_1_link", 0.15, "z", 0.03, 0.018, 3.1, 3.0, 0.0),
    ArmJoint("wrist_2_joint", "wrist_2_link", 0.03, "y", 0.04, 0.018, 2.2, 3.0, 0.6),
    ArmJoint("wrist_3_joint", "wrist_3_link", 0.04, "z", 0.02, 0.016, 3.1, 3.0, 0.0),
)
"""From the base to the hand. Turning about y is away from the robot's front for negative angles."""

REST: Final = tuple(joint.rest for joint in ARM)


class Arm:
    """Kinematics of the arm.

    Attributes:
        positions: radians, in the order of :data:`ARM`.
        velocities: radians a second.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Move every joint to its rest angle at once."""
        self.positions: tuple[float, ...] = REST
        self.stop()

    def stop(self) -> None:
        """Set every joint's velocity to zero."""
        self.velocities: tuple[float, ...] = (0.0,) * len(ARM)

    def go(self, trajectory: Trajectory, seconds: float) -> None:
        """Set the angles of a trajectory at a time in seconds, within the joints' limits."""
        positions, self.velocities = trajectory.at(seconds)
        # A spline may swing further than its waypoints.
        self.positions = tuple(
            max(-joint.limit, min(joint.limit, angle)) for joint, angle in zip(ARM, positions, strict=True)
        )
