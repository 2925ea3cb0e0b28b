"""The arm's controller: `/arm_controller/follow_joint_trajectory` and `/arm_controller/joint_trajectory`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import anyio

from rwt.extensions.demo import messages
from rwt.extensions.demo.arm.kinematics import ARM, Arm
from rwt_graph import Node
from rwt_graph.trajectories import Angles, Trajectory, Waypoint
from rwt_participant.errors import GoalAborted, GoalCanceled
from rwt_participant.goals import ReceivedGoal
from rwt_participant.messages import Message
from rwt_tf2 import stamp_ns

ACTION: Final = "control_msgs/FollowJointTrajectory"
#: Maximum distance of the first waypoint from the arm's position if its time is 0, radians.
_START_TOLERANCE: Final = 0.05
#: Seconds from one feedback to the next.
_FEEDBACK_EVERY: Final = 0.1
#: Error code of `control_msgs/FollowJointTrajectory` for errors without a code of their own.
_INVALID_GOAL: Final = -1
_NAMES: Final = tuple(joint.name for joint in ARM)


class TrajectoryRefused(ValueError):
    """The arm cannot follow a trajectory; the text gives the reason."""


class _ActiveTrajectory:
    def __init__(self, trajectory: Trajectory, began: float, goal: ReceivedGoal | None) -> None:
        self.trajectory = trajectory
        self.began = began
        self.goal = goal
        self.last_feedback = -math.inf
        self.ended = anyio.Event()
        self.reason = ""


class ArmController:
    """Trajectory controller of the arm, like ros2_control's joint_trajectory_controller.

    Joints missing from a trajectory stay. A trajectory with a later start waits for it; otherwise, the newest
    replaces the one before. One without points on the topic stops the arm where it is, as in ROS 1.
    """

    def __init__(self, node: Node, arm: Arm) -> None:
        self._node = node
        self._arm = arm
        self._run: _ActiveTrajectory | None = None
        node.advertise_action(
            "arm_controller/follow_joint_trajectory", ACTION, self._execute, accept=self._accept
        )
        node.subscribe("arm_controller/joint_trajectory", self._take, type="trajectory_msgs/JointTrajectory")

    def step(self) -> None:
        """Move the arm to its current position on the trajectory."""
        run = self._run
        if run is None:
            return
        if run.goal is not None and run.goal.cancel_requested:
            self.end("canceled")
            return
        seconds = self._node.clock.monotonic() - run.began
        self._arm.go(run.trajectory, seconds)
        self._give_feedback(run, seconds)
        if seconds >= run.trajectory.duration:
            self.end("")

    def end(self, reason: str) -> None:
        """End the trajectory under way, aborted unless the reason is empty; the arm stays where it is."""
        self._arm.stop()
        run, self._run = self._run, None
        if run is not None:
            run.reason = reason
            run.ended.set()

    def _begin(self, message: Message, goal: ReceivedGoal | None) -> _ActiveTrajectory:
        trajectory = self._read(message)
        self.end("a newer trajectory took its place")
        wait = max(0, stamp_ns(message.header.stamp) - self._node.clock.time_ns()) / 1e9
        self._run = _ActiveTrajectory(trajectory, self._node.clock.monotonic() + wait, goal)
        return self._run

    def _take(self, message: Message) -> None:
        if not message.points:
            self.end("an empty trajectory stopped the arm")
            return
        try:
            self._begin(message, None)
        except TrajectoryRefused as error:
            topic = self._node.resolve("arm_controller/joint_trajectory")
            line = f"the trajectory on {topic} is left: {error}"
            self._node.log.warning(line)

    def _accept(self, request: Message) -> bool | str:
        try:
            self._read(request.trajectory)
        except TrajectoryRefused as error:
            return str(error)
        return True

    async def _execute(self, goal: ReceivedGoal) -> messages.Message:
        try:
            run = self._begin(goal.request.trajectory, goal)
        except TrajectoryRefused as error:  # the arm has moved on since the goal was accepted
            raise GoalAborted(_result(_INVALID_GOAL, str(error)), str(error)) from error
        try:
            await run.ended.wait()
        finally:
            # However the wait ends, an arm without a goal must stop.
            if self._run is run:
                self.end("")
        if goal.cancel_requested:
            raise GoalCanceled(_result(_INVALID_GOAL, "canceled"))
        if run.reason:
            raise GoalAborted(_result(_INVALID_GOAL, run.reason), run.reason)
        return _result(0, "")

    def _give_feedback(self, run: _ActiveTrajectory, seconds: float) -> None:
        # Rounding may make a step slightly early; half a step of tolerance keeps the rate.
        is_due = seconds - run.last_feedback >= _FEEDBACK_EVERY - 0.025
        if run.goal is None or not is_due or not run.goal.feedback_wanted:
            return
        run.last_feedback = seconds
        point = {"positions": self._arm.positions, "velocities": self._arm.velocities}
        run.goal.publish_feedback(
            {
                "header": messages.header(self._node.clock.time_ns(), ""),
                "joint_names": _NAMES,
                "desired": point,
                "actual": point,
                "error": {"positions": [0.0] * len(ARM), "velocities": [0.0] * len(ARM)},
            }
        )

    def _read(self, message: Message) -> Trajectory:
        columns = _columns(message.joint_names)
        if not message.points:
            raise TrajectoryRefused("the trajectory has no points")
        waypoints = [Waypoint(0.0, self._arm.positions, self._arm.velocities)]
        for point in message.points:
            here = waypoints[-1]
            seconds = stamp_ns(point.time_from_start) / 1e9
            waypoint = Waypoint(seconds, *_angles(point, columns, here.positions))
            if seconds > here.seconds:
                _check_speeds(here, waypoint)
                waypoints.append(waypoint)
            elif here is waypoints[0] and seconds == 0 and _is_near(here.positions, waypoint.positions):
                continue  # many planners begin at the arm's position
            else:
                raise TrajectoryRefused(
                    f"a point at {seconds:g} s comes after one at {here.seconds:g} s; "
                    "the first may be at 0 s where the arm is"
                )
        return Trajectory(waypoints)


def _columns(names: Sequence[str]) -> Mapping[int, int]:
    """Map each named joint from its index in the arm to that in the message."""
    unknown = [name for name in names if name not in _NAMES]
    if unknown or not names or len(set(names)) < len(names):
        wrong = f"{unknown[0]} is no joint" if unknown else "name each joint once"
        raise TrajectoryRefused(f"{wrong}; the arm has {', '.join(_NAMES)}")
    return {_NAMES.index(name): column for column, name in enumerate(names)}


def _angles(point: Message, columns: Mapping[int, int], before: Angles) -> tuple[Angles, Angles | None]:
    """Return positions and velocities of all joints at a point; missing ones stay."""
    for name, values in (("positions", point.positions), ("velocities", point.velocities)):
        if len(values) != len(columns) and (name == "positions" or len(values)):
            raise TrajectoryRefused(f"a point has {len(values)} {name} for {len(columns)} joints")
        if not all(map(math.isfinite, values)):
            raise TrajectoryRefused(f"a point's {name} have a value that is not a finite number")
    positions = tuple(
        float(point.positions[columns[n]]) if n in columns else angle for n, angle in enumerate(before)
    )
    for joint, angle in zip(ARM, positions, strict=True):
        if abs(angle) > joint.limit:
            raise TrajectoryRefused(f"{joint.name} turns {joint.limit} rad either way, not to {angle:g}")
    if not len(point.velocities):
        return positions, None
    velocities = tuple(float(point.velocities[columns[n]]) if n in columns else 0.0 for n in range(len(ARM)))
    for joint, speed in zip(ARM, velocities, strict=True):
        if abs(speed) > joint.speed:
            raise TrajectoryRefused(f"{joint.name} can turn at {joint.speed:g} rad/s, not at {speed:g} rad/s")
    return positions, velocities


def _check_speeds(begin: Waypoint, end: Waypoint) -> None:
    span = end.seconds - begin.seconds
    for joint, here, there in zip(ARM, begin.positions, end.positions, strict=True):
        speed = abs(there - here) / span
        if speed > joint.speed:
            raise TrajectoryRefused(
                f"{joint.name} would turn at {speed:.3g} rad/s before {end.seconds:g} s; "
                f"it can do {joint.speed:g} rad/s"
            )


def _is_near(a: Angles, b: Angles) -> bool:
    return all(abs(x - y) <= _START_TOLERANCE for x, y in zip(a, b, strict=True))


def _result(code: int, text: str) -> messages.Message:
    return {"error_code": code, "error_string": text}
