"""Controller of joints: trajectories by topic and by action, within the limits of each joint."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

import anyio

from rwt_graph.trajectories import Angles, Trajectory, Waypoint
from rwt_lerobot.joints.limits import JointLimit
from rwt_participant.api import RobotApi
from rwt_participant.errors import GoalAborted, GoalCanceled
from rwt_participant.goals import ReceivedGoal
from rwt_participant.messages import Message, MessageLike
from rwt_tf2 import stamp_ns

ACTION_TYPE: Final = "control_msgs/FollowJointTrajectory"
TOPIC_TYPE: Final = "trajectory_msgs/JointTrajectory"

GOAL_TOLERANCE: Final = 0.1
"""Maximum distance of a joint from its goal when a goal succeeds, radians."""

GOAL_SECONDS: Final = 1.0
"""Time after the end of a trajectory in which the joints must reach the goal."""

#: Positions so little beyond a limit are taken for the limit: leader arms and recordings overshoot.
_ROUNDING: Final = 0.01
_FEEDBACK_SECONDS: Final = 0.1
#: Maximum number of points of a trajectory, which are checked at once.
_MAX_POINTS: Final = 5000
#: Characters of a name that are quoted in a rejection.
_QUOTED: Final = 100
#: Error codes of `control_msgs/FollowJointTrajectory`.
_INVALID_GOAL: Final = -1
_GOAL_TOLERANCE_VIOLATED: Final = -5


class TrajectoryRejected(ValueError):
    """The joints cannot follow a trajectory; the text gives the reason."""


class _Run:
    """Trajectory in progress."""

    def __init__(self, trajectory: Trajectory, goal: ReceivedGoal | None) -> None:
        self.trajectory = trajectory
        self.goal = goal
        self.seconds = 0.0
        self.last_feedback = -math.inf
        self.ended = anyio.Event()
        self.reason = ""
        self.code = 0


class TrajectoryController:
    """Controller like ros2_control's joint_trajectory_controller, with limits.

    A trajectory starts on arrival; its header's stamp is not used. The newest replaces the one before, and a
    trajectory without points holds the setpoint. A point at 0 s is a command without a time: the joints move
    there at their maximum speed.

    Args:
        api: node or client that offers topic and action.
        limits: limits of the joints, in the order of all positions.
        prefix: name that the topic and the action begin with.
        report: called with each rejection on the topic.

    Attributes:
        setpoint: positions to command now; None before the first measurement.
        is_commanded: True from the first accepted trajectory on.
    """

    def __init__(
        self, api: RobotApi, limits: Sequence[JointLimit], prefix: str, report: Callable[[str], None]
    ) -> None:
        self._limits = tuple(limits)
        self._index = {limit.name: index for index, limit in enumerate(limits)}
        self._report = report
        self._measured: Angles | None = None
        self._run: _Run | None = None
        self._unavailable = "the position of the joints is not known yet"
        self.setpoint: Angles | None = None
        self.is_commanded = False
        self.topic = f"{prefix}/joint_trajectory"
        self._handles = (
            api.advertise_action(f"{prefix}/follow_joint_trajectory", ACTION_TYPE, self._execute),
            api.subscribe(self.topic, self._take, TOPIC_TYPE),
        )

    def close(self) -> None:
        """Withdraw topic and action."""
        self.hold("the robot has left")
        for handle in self._handles:
            handle.close()

    def measure(self, positions: Angles) -> None:
        """Take the measured positions of all joints."""
        self._measured = positions
        self._unavailable = ""
        if self.setpoint is None or not self.is_commanded:
            self.setpoint = positions

    def fail(self, reason: str) -> None:
        """Reject trajectories with a reason until the next measurement, which is the new setpoint."""
        self.hold(reason)
        self._unavailable = reason
        self.setpoint, self.is_commanded = None, False

    def hold(self, reason: str) -> None:
        """Abort the trajectory under way; the setpoint stays where it is.

        The setpoint is not set to the measured position: an arm sags a little under its weight, and each of
        several stops would lower it.
        """
        self._finish(reason, _INVALID_GOAL)

    def step(self, seconds: float) -> Angles | None:
        """Advance by `seconds`, and return the setpoint; it moves at most at the speed of each joint."""
        run = self._run
        if run is None or self.setpoint is None or self._measured is None:
            return self.setpoint
        if run.goal is not None and run.goal.cancel_requested:
            self._finish("canceled", _INVALID_GOAL)
            return self.setpoint
        run.seconds += seconds
        wanted, _ = run.trajectory.at(run.seconds)
        self.setpoint = tuple(
            _towards(here, min(max(there, limit.lower), limit.upper), limit.speed * seconds)
            for here, there, limit in zip(self.setpoint, wanted, self._limits, strict=True)
        )
        self._give_feedback(run, wanted)
        late = run.seconds - run.trajectory.duration
        if late >= 0 and _distance(self.setpoint, run.trajectory.goal) < 1e-6:
            self._arrive(run, late)
        return self.setpoint

    def _arrive(self, run: _Run, late: float) -> None:
        assert self._measured is not None  # step() requires it.
        if run.goal is None or _distance(self._measured, run.trajectory.goal) <= GOAL_TOLERANCE:
            self._finish("", 0)
        elif late > GOAL_SECONDS:
            worst = max(
                zip(self._limits, self._measured, run.trajectory.goal, strict=True),
                key=lambda each: abs(each[1] - each[2]),
            )
            text = f"{worst[0].name} is at {worst[1]:.3g} rad and does not reach {worst[2]:.3g} rad"
            self._finish(text, _GOAL_TOLERANCE_VIOLATED)

    def _finish(self, reason: str, code: int) -> None:
        run, self._run = self._run, None
        if run is not None:
            run.reason, run.code = reason, code
            run.ended.set()

    def _take(self, message: Message) -> None:
        if not message.points:
            self.hold("an empty trajectory stopped the robot")
            return
        try:
            self._begin(message, None)
        except TrajectoryRejected as error:
            self._report(f"rejected the trajectory on {self.topic}: {error}")

    def _begin(self, message: Message, goal: ReceivedGoal | None) -> _Run:
        trajectory = self._read(message)
        self.hold("a newer trajectory took its place")
        self._run = _Run(trajectory, goal)
        self.is_commanded = True
        return self._run

    async def _execute(self, goal: ReceivedGoal) -> MessageLike:
        try:
            run = self._begin(goal.request.trajectory, goal)
        except TrajectoryRejected as error:
            raise GoalAborted(_result(_INVALID_GOAL, str(error)), str(error)) from error
        try:
            await run.ended.wait()
        finally:
            # However the wait ends, a robot without a goal must stop.
            if self._run is run:
                self.hold("")
        if goal.cancel_requested:
            raise GoalCanceled(_result(_INVALID_GOAL, "canceled"))
        if run.reason:
            raise GoalAborted(_result(run.code, run.reason), run.reason)
        return _result(0, "")

    def _give_feedback(self, run: _Run, wanted: Angles) -> None:
        if run.goal is None or run.seconds - run.last_feedback < _FEEDBACK_SECONDS - 1e-6:
            return
        run.last_feedback = run.seconds
        if run.goal.feedback_wanted and self._measured is not None:
            error = [there - here for there, here in zip(wanted, self._measured, strict=True)]
            run.goal.publish_feedback(
                {
                    "joint_names": [limit.name for limit in self._limits],
                    "desired": {"positions": wanted},
                    "actual": {"positions": self._measured},
                    "error": {"positions": error},
                }
            )

    def _read(self, message: Message) -> Trajectory:
        if self._unavailable or self.setpoint is None:
            raise TrajectoryRejected(self._unavailable)
        columns = self._columns(message.joint_names)
        if not message.points:
            raise TrajectoryRejected("the trajectory has no points")
        if len(message.points) > _MAX_POINTS:
            raise TrajectoryRejected(f"{len(message.points)} points are more than {_MAX_POINTS}")
        waypoints = [Waypoint(0.0, self.setpoint)]
        for point in message.points:
            here, seconds = waypoints[-1], stamp_ns(point.time_from_start) / 1e9
            waypoint = Waypoint(seconds, self._positions(point, columns, here.positions))
            if seconds > here.seconds:
                self._check_speeds(here, waypoint)
                waypoints.append(waypoint)
            elif seconds == 0 and here is waypoints[0]:
                self._check_steps(waypoint)
                waypoints = [waypoint]
            else:
                raise TrajectoryRejected(f"a point at {seconds:g} s comes after one at {here.seconds:g} s")
        return Trajectory(waypoints)

    def _columns(self, names: Sequence[str]) -> dict[int, int]:
        """Map the index of each named joint to that in the message."""
        known = ", ".join(self._index)
        for name in names:
            if name not in self._index:
                raise TrajectoryRejected(f"{name[:_QUOTED]!r} is not a joint; the robot has {known}")
        if not names or len(set(names)) < len(names):
            raise TrajectoryRejected(f"name each joint once; the robot has {known}")
        return {self._index[name]: column for column, name in enumerate(names)}

    def _positions(self, point: Message, columns: dict[int, int], before: Angles) -> Angles:
        if len(point.positions) != len(columns):
            raise TrajectoryRejected(
                f"a point has {len(point.positions)} positions for {len(columns)} joints"
            )
        found = list(before)
        for index, column in columns.items():
            limit, angle = self._limits[index], float(point.positions[column])
            if not limit.lower - _ROUNDING <= angle <= limit.upper + _ROUNDING:  # False for NaN, too.
                raise TrajectoryRejected(
                    f"{limit.name} moves from {limit.lower:.3g} to {limit.upper:.3g} rad, not to {angle:.3g}"
                )
            found[index] = min(max(angle, limit.lower), limit.upper)
        return tuple(found)

    def _check_speeds(self, begin: Waypoint, end: Waypoint) -> None:
        span = end.seconds - begin.seconds
        for limit, here, there in zip(self._limits, begin.positions, end.positions, strict=True):
            speed = abs(there - here) / span
            if speed > limit.speed * 1.001:
                raise TrajectoryRejected(
                    f"{limit.name} would move at {speed:.3g} rad/s before {end.seconds:g} s;"
                    f" its maximum is {limit.speed:g} rad/s"
                )

    def _check_steps(self, waypoint: Waypoint) -> None:
        assert self.setpoint is not None  # _read() requires it.
        for limit, here, there in zip(self._limits, self.setpoint, waypoint.positions, strict=True):
            if abs(there - here) > limit.step:
                raise TrajectoryRejected(
                    f"{limit.name} is {abs(there - here):.3g} rad away from {there:.3g} rad;"
                    f" a command without a time moves it at most {limit.step:g} rad"
                )


def _towards(here: float, there: float, step: float) -> float:
    return there if abs(there - here) <= step else here + math.copysign(step, there - here)


def _distance(one: Angles, other: Angles) -> float:
    return max((abs(a - b) for a, b in zip(one, other, strict=True)), default=0.0)


def _result(code: int, text: str) -> MessageLike:
    return {"error_code": code, "error_string": text}
