"""The action `/xarm6_traj_controller/follow_joint_trajectory`: the arm along a trajectory.

Moving is done in :meth:`Arm.step`, once a control step; the action's coroutine only waits for the end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Final, Protocol

import anyio

from husky_xarm.description import ARM_JOINTS, describe
from husky_xarm.simulation import Simulation
from rwt import GoalAborted, GoalCanceled, Node, ReceivedGoal
from rwt.extensions.demo import messages
from rwt_graph.trajectories import Trajectory, Waypoint
from rwt_tf2 import stamp_ns

ACTION: Final = "/xarm6_traj_controller/follow_joint_trajectory"
_FEEDBACK_EVERY = 0.1
#: How near the end counts as there, and for how long after the end it may still come near, unless the goal
#: says otherwise. Radians, seconds.
_GOAL_TOLERANCE = 0.02
_GOAL_TIME_TOLERANCE = 1.0
#: How far the arm may be from a first point at 0 s, with which many planners begin. Radians.
_START_TOLERANCE = 0.05
#: At each point: the way between two is a cubic that starts and stops gently.
_STANDING: Final = (0.0,) * len(ARM_JOINTS)


class ErrorCode(IntEnum):
    """Of `control_msgs/FollowJointTrajectory`."""

    SUCCESSFUL = 0
    GOAL_TOLERANCE_VIOLATED = -5


class Point(Protocol):
    """`trajectory_msgs/JointTrajectoryPoint`."""

    positions: Sequence[float]
    time_from_start: Any


class TrajectoryMessage(Protocol):
    """`trajectory_msgs/JointTrajectory`."""

    joint_names: Sequence[str]
    points: Sequence[Point]


class Tolerance(Protocol):
    """`control_msgs/JointTolerance`."""

    name: str
    position: float


class Request(Protocol):
    """The goal of `control_msgs/FollowJointTrajectory`."""

    trajectory: TrajectoryMessage
    goal_tolerance: Sequence[Tolerance]
    goal_time_tolerance: Any


@dataclass(slots=True)
class _Motion:
    """One goal on its way. Times are seconds of the graph's clock."""

    goal: ReceivedGoal
    way: Trajectory
    started: float
    tolerance: Mapping[str, float]
    patience: float
    ended: anyio.Event = field(default_factory=anyio.Event)
    reason: str = ""
    last_feedback: float = -math.inf


class Arm:
    """Serves the action. A new goal takes the place of the one before, as robots' controllers do."""

    def __init__(self, node: Node, simulation: Simulation) -> None:
        self._node = node
        self._simulation = simulation
        self._limits = {j.name: (j.lower, j.upper) for j in describe().joints if j.name in ARM_JOINTS}
        self._motion: _Motion | None = None
        node.advertise_action(
            ACTION, "control_msgs/FollowJointTrajectory", self._execute, accept=self._accept
        )

    def step(self) -> None:
        """Say where the joints go now, or see that they have arrived."""
        motion = self._motion
        if motion is None:
            return
        here = self._positions()
        if motion.goal.cancel_requested:
            self._simulation.move_arm(dict(zip(ARM_JOINTS, here, strict=True)))
            self._end(motion, "")
            return
        now = self._node.clock.monotonic() - motion.started
        wanted = motion.way.at(now)[0]
        self._simulation.move_arm(dict(zip(ARM_JOINTS, wanted, strict=True)))
        self._give_feedback(motion, now, wanted, here)
        if now >= motion.way.duration:
            self._look_for_arrival(motion, now, here)

    def _look_for_arrival(self, motion: _Motion, now: float, here: tuple[float, ...]) -> None:
        wanted = motion.way.goal
        off = [
            f"{name} is at {is_at:.3f} rad and was to be at {to_be:.3f}"
            for name, is_at, to_be in zip(ARM_JOINTS, here, wanted, strict=True)
            if abs(is_at - to_be) > motion.tolerance[name]
        ]
        if not off:
            self._end(motion, "")
        elif now > motion.way.duration + motion.patience:
            self._end(motion, "; ".join(off))

    def _end(self, motion: _Motion, reason: str) -> None:
        motion.reason = reason
        motion.ended.set()
        if self._motion is motion:
            self._motion = None

    def _positions(self) -> tuple[float, ...]:
        joints = self._simulation.joints()
        return tuple(joints[name].position for name in ARM_JOINTS)

    def _accept(self, request: Request) -> bool | str:
        """True, or why the arm cannot do that."""
        trajectory = request.trajectory
        names = list(trajectory.joint_names)
        if sorted(names) != sorted(ARM_JOINTS):
            return f"the trajectory is of joints {names}; it must be of {', '.join(ARM_JOINTS)}, in any order"
        if not trajectory.points:
            return "the trajectory has no points"
        before = -1.0
        for number, point in enumerate(trajectory.points, 1):
            seconds = stamp_ns(point.time_from_start) / 1e9
            if seconds <= before:
                return f"point {number} is at {seconds:g} s; it must be later than {before:g} s"
            before = seconds
            if reason := self._out_of_reach(names, point.positions):
                return f"point {number}: {reason}"
            if seconds <= 0.0 and not self._is_at(names, point.positions):
                return (
                    f"point {number} is at {seconds:g} s and the arm is elsewhere; give it time to get there"
                )
        return True

    def _out_of_reach(self, names: Sequence[str], positions: Sequence[float]) -> str:
        if len(positions) != len(names):
            return f"{len(positions)} positions for {len(names)} joints"
        for name, position in zip(names, positions, strict=True):
            lower, upper = self._limits[name]
            if not lower <= position <= upper:
                return f"{name} cannot be at {position:g} rad, only from {lower:.3f} to {upper:.3f}"
        return ""

    def _is_at(self, names: Sequence[str], positions: Sequence[float]) -> bool:
        here = dict(zip(ARM_JOINTS, self._positions(), strict=True))
        return all(
            abs(here[name] - position) <= _START_TOLERANCE
            for name, position in zip(names, positions, strict=True)
        )

    async def _execute(self, goal: ReceivedGoal) -> messages.Message:
        if self._motion is not None:
            self._end(self._motion, "a newer goal took its place")
        motion = self._motion = self._motion_of(goal)
        try:
            await motion.ended.wait()
        finally:
            if self._motion is motion:  # the action was withdrawn
                self._motion = None
        if goal.cancel_requested:
            raise GoalCanceled(_result(ErrorCode.SUCCESSFUL, "canceled"))
        if motion.reason:
            raise GoalAborted(_result(ErrorCode.GOAL_TOLERANCE_VIOLATED, motion.reason), motion.reason)
        return _result(ErrorCode.SUCCESSFUL, "")

    def _motion_of(self, goal: ReceivedGoal) -> _Motion:
        """A goal that was accepted, from where the arm is now."""
        request: Request = goal.request
        order = [list(request.trajectory.joint_names).index(name) for name in ARM_JOINTS]
        points = request.trajectory.points
        way = [Waypoint(0.0, self._positions(), _STANDING)]
        for point in points:
            seconds = stamp_ns(point.time_from_start) / 1e9
            if seconds > 0.0:
                way.append(Waypoint(seconds, tuple(point.positions[index] for index in order), _STANDING))
        asked = {tolerance.name: tolerance.position for tolerance in request.goal_tolerance}
        return _Motion(
            goal,
            Trajectory(way),
            self._node.clock.monotonic(),
            {name: asked.get(name) or _GOAL_TOLERANCE for name in ARM_JOINTS},
            stamp_ns(request.goal_time_tolerance) / 1e9 or _GOAL_TIME_TOLERANCE,
        )

    def _give_feedback(
        self, motion: _Motion, now: float, wanted: tuple[float, ...], here: tuple[float, ...]
    ) -> None:
        if now - motion.last_feedback < _FEEDBACK_EVERY:
            return
        motion.last_feedback = now
        apart = [to_be - is_at for to_be, is_at in zip(wanted, here, strict=True)]
        motion.goal.publish_feedback(
            {
                "header": messages.header(self._node.clock.time_ns(), ""),
                "joint_names": ARM_JOINTS,
                "desired": {"positions": wanted},
                "actual": {"positions": here},
                "error": {"positions": apart},
            }
        )


def _result(code: ErrorCode, text: str) -> messages.Message:
    return {"error_code": int(code), "error_string": text}
