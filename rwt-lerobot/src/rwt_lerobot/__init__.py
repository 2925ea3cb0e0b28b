"""LeRobot's robots and MuJoCo's models as robots for rosbridge clients.

:class:`LeRobotNode` publishes a robot of LeRobot; :mod:`rwt_lerobot.simulation` a MuJoCo model;
:mod:`rwt_lerobot.plugin` makes a rosbridge server a robot of LeRobot.
"""

from __future__ import annotations

from rwt_lerobot.joints.limits import JointLimit
from rwt_lerobot.joints.scales import Scale
from rwt_lerobot.node import LeRobotNode, MotorJoint, motor_joints

__all__ = ["JointLimit", "LeRobotNode", "MotorJoint", "Scale", "motor_joints"]
