"""Actions `/navigate_to_pose` and, on ROS 1, `/move_base`: plan a path, follow it, plan again.

:meth:`Navigation.steer` drives in each control step; the coroutine of the action only waits for the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter
from typing import Final

import anyio

from rwt.extensions.demo import messages
from rwt.extensions.demo.drive import STANDSTILL, DifferentialDrive, Velocity
from rwt.extensions.demo.messages import MAP, ODOM, frame
from rwt.extensions.demo.model.urdf import BASE
from rwt.extensions.demo.navigation.planner import NoPath, PathFollower, Planner
from rwt.extensions.demo.world.map import ORIGIN, Pose
from rwt_graph import Node
from rwt_participant.errors import GoalAborted, GoalCanceled
from rwt_participant.goals import GoalStatus, ReceivedGoal
from rwt_participant.messages import Message

ACTION = "nav2_msgs/NavigateToPose"
#: Interval of feedback in seconds.
_FEEDBACK_EVERY = 0.2
#: Time without motion after which the task is aborted, in seconds.
_PATIENCE = 5.0
#: Distance from the path, after manual driving, at which a new one is planned, in metres.
_REPLAN_AT = 0.4


@dataclass(frozen=True, slots=True)
class _Interface:
    """Conventions of one navigation action.

    Attributes:
        target: returns the `geometry_msgs/PoseStamped` of a goal.
        pose_field: field of the feedback with the pose of the robot.
        has_progress: True if feedback and result have further fields.
    """

    target: Callable[[Message], Message]
    pose_field: str
    has_progress: bool


_NAV2 = _Interface(attrgetter("pose"), "current_pose", has_progress=True)
_MOVE_BASE = _Interface(attrgetter("target_pose"), "base_position", has_progress=False)


@dataclass(slots=True)
class _NavigationTask:
    goal: ReceivedGoal
    interface: _Interface
    follower: PathFollower
    started: float
    ended: anyio.Event = field(default_factory=anyio.Event)
    status: GoalStatus = GoalStatus.EXECUTING
    reason: str = ""
    still_since: float | None = None
    last_feedback: float = -math.inf


_MOVE_BASE_TYPES: Final = {"noetic": "move_base_msgs/MoveBase"}
"""Type of `/move_base` by distribution. Nav2 has its own action."""


class Navigation:
    """Action server that computes velocities while a goal is active."""

    def __init__(self, node: Node, drive: DifferentialDrive, planner: Planner, odom_origin: Pose) -> None:
        self._node = node
        self._drive = drive
        self._planner = planner
        self._odom_origin = odom_origin
        self._task: _NavigationTask | None = None
        self._plans = node.advertise("plan", "nav_msgs/Path")
        self._offer("navigate_to_pose", ACTION, _NAV2)
        move_base = _MOVE_BASE_TYPES.get(node.distro.conventions)
        if move_base is not None:
            self._offer("move_base", move_base, _MOVE_BASE)

    def _offer(self, name: str, type: str, interface: _Interface) -> None:
        execute = partial(self._execute, interface)
        self._node.advertise_action(name, type, execute, accept=partial(self._accept, interface))

    @property
    def active(self) -> bool:
        """True while the robot drives to a goal."""
        return self._task is not None

    def steer(self, overridden: bool) -> Velocity:
        """Return the velocity for this step; manual driving (`overridden`) only pauses the task."""
        task = self._task
        if task is None:
            return STANDSTILL
        if task.goal.cancel_requested:
            if overridden or self._drive.velocity.is_zero:
                self._finish(GoalStatus.CANCELED)
            return STANDSTILL
        if not self._drive.enabled:
            self._finish(GoalStatus.ABORTED, "the motors are disabled; call /enable_motors")
            return STANDSTILL
        self._give_feedback(task)
        if overridden:
            task.still_since = None
            return STANDSTILL
        return self._follow(task)

    def abort(self, reason: str) -> None:
        """Abort the active goal, if there is one."""
        self._finish(GoalStatus.ABORTED, reason)

    def _follow(self, task: _NavigationTask) -> Velocity:
        pose = self._drive.pose
        if task.follower.arrived(pose) and self._drive.velocity.is_zero:
            self._finish(GoalStatus.SUCCEEDED)
            return STANDSTILL
        if self._is_stuck(task):
            self._finish(GoalStatus.ABORTED, "the robot is stuck")
            return STANDSTILL
        if task.follower.off_track(pose) > _REPLAN_AT:
            try:
                task.follower = self._plan(task.follower.goal)
            except NoPath as error:
                self._finish(GoalStatus.ABORTED, str(error))
                return STANDSTILL
        return task.follower.steer(pose)

    def _finish(self, status: GoalStatus, reason: str = "") -> None:
        task, self._task = self._task, None
        if task is not None:
            task.status, task.reason = status, reason
            task.ended.set()

    def _is_stuck(self, task: _NavigationTask) -> bool:
        now = self._node.clock.monotonic()
        if self._drive.bumped or self._drive.velocity.is_zero:
            if task.still_since is None:
                task.still_since = now
            return now - task.still_since > _PATIENCE
        task.still_since = None
        return False

    def _accept(self, interface: _Interface, request: Message) -> bool | str:
        asked = interface.target(request)
        target = messages.read_pose(asked.pose)
        if not all(math.isfinite(value) for value in (target.x, target.y, target.heading)):
            return "the goal's pose has a value that is not a finite number"
        given, known = asked.header.frame_id, self._frames()
        if _bare(given) not in known:
            _, *others, last = known
            return f'the goal is in frame "{given}"; use {", ".join(others)} or {last}'
        return True

    def _frames(self) -> dict[str, Pose]:
        """Return the origin of each supported frame in the map; goals without a frame are in the map."""
        return {
            "": ORIGIN,
            frame(self._node, MAP): ORIGIN,
            frame(self._node, ODOM): self._odom_origin,
            frame(self._node, BASE): self._drive.pose,
        }

    async def _execute(self, interface: _Interface, goal: ReceivedGoal) -> messages.Message:
        self.abort("a newer goal took its place")
        asked = interface.target(goal.request)
        origin = self._frames()[_bare(asked.header.frame_id)]
        try:
            follower = self._plan(origin.after(messages.read_pose(asked.pose)))
        except NoPath as error:
            raise GoalAborted(self._result(interface, str(error)), str(error)) from error
        task = self._task = _NavigationTask(goal, interface, follower, self._node.clock.monotonic())
        try:
            await task.ended.wait()
        finally:
            # However the wait ends, a robot without a goal must stop.
            if self._task is task:
                self._task = None
        if task.status is GoalStatus.CANCELED:
            raise GoalCanceled(self._result(interface, "canceled"))
        if task.status is GoalStatus.ABORTED:
            raise GoalAborted(self._result(interface, task.reason), task.reason)
        return self._result(interface, "")

    def _plan(self, target: Pose) -> PathFollower:
        here = self._drive.pose
        corners = self._planner.plan((here.x, here.y), (target.x, target.y))
        self._publish_plan(corners, target)
        return PathFollower(corners, target, self._drive.limits)

    def _publish_plan(self, corners: list[tuple[float, float]], target: Pose) -> None:
        header = messages.header(self._node.clock.time_ns(), frame(self._node, MAP))
        poses = [{"header": header, "pose": messages.pose(Pose(x, y, target.heading))} for x, y in corners]
        self._plans.publish({"header": header, "poses": poses})

    def _give_feedback(self, task: _NavigationTask) -> None:
        now = self._node.clock.monotonic()
        # Rounding may make a step slightly early; half a step of tolerance keeps the rate.
        if now - task.last_feedback < _FEEDBACK_EVERY - 0.025:
            return
        task.last_feedback = now
        header = messages.header(self._node.clock.time_ns(), frame(self._node, MAP))
        pose = {"header": header, "pose": messages.pose(self._drive.pose)}
        progress = self._progress(task, now) if task.interface.has_progress else {}
        task.goal.publish_feedback({task.interface.pose_field: pose, **progress})

    def _progress(self, task: _NavigationTask, now: float) -> messages.Message:
        remaining = task.follower.remaining(self._drive.pose)
        speed = max(abs(self._drive.velocity.linear), self._drive.limits.speed / 2)
        return {
            "navigation_time": messages.time(round((now - task.started) * 1e9)),
            "estimated_time_remaining": messages.time(round(remaining / speed * 1e9)),
            "number_of_recoveries": 0,
            "distance_remaining": remaining,
        }

    def _result(self, interface: _Interface, error: str) -> messages.Message:
        """Return the result with the fields of this distribution; `/move_base` has none."""
        if not interface.has_progress:
            return {}
        fields = self._node.registry.action(ACTION).result.struct.__struct_fields__
        outcome = {"error_code": 1 if error else 0, "error_msg": error}
        return {name: value for name, value in outcome.items() if name in fields}


def _bare(frame: str) -> str:
    """Return a frame's name without the leading slash of old ROS 1 programs."""
    return frame.removeprefix("/")
