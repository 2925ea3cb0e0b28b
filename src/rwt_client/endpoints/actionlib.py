"""Goals for the actions of ROS 1, sent as messages on five topics (ALB-01)."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from rwt_interfaces import NOETIC
from rwt_participant.errors import GoalRejected
from rwt_participant.goals import Goal, GoalResult, GoalStatus
from rwt_participant.messages import Message

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt_interfaces import Payload
    from rwt_interfaces.structs import ActionType
    from rwt_participant.handles import Handle, Publisher
    from rwt_participant.transforms import SubscribeVerb

PREEMPTED, SUCCEEDED, ABORTED, REJECTED = 2, 3, 4, 5
"""States of ``actionlib_msgs/GoalStatus``, which differ from those of ROS 2 (ALB-08)."""

_ENDED: Final = {
    PREEMPTED: GoalStatus.CANCELED,
    8: GoalStatus.CANCELED,  # RECALLED: canceled before it started
    SUCCEEDED: GoalStatus.SUCCEEDED,
    ABORTED: GoalStatus.ABORTED,
}


async def send_over_topics(
    subscribe: SubscribeVerb,
    advertise: Callable[[str, str], Publisher],
    goal: Goal,
    action_type: ActionType,
    payload: Payload,
) -> Goal:
    """Send a goal, after subscribing to its feedback and result."""
    name = goal.action
    sent = _ActionlibGoal(goal)
    goal.channel = sent
    sent.topics = [
        await subscribe(f"{name}/feedback", sent.on_feedback, f"{action_type.name}ActionFeedback"),
        await subscribe(f"{name}/result", sent.on_result, f"{action_type.name}ActionResult"),
    ]
    sent.cancel = await advertise(f"{name}/cancel", "actionlib_msgs/GoalID")
    sent.goals = await advertise(f"{name}/goal", f"{action_type.name}ActionGoal")
    sent.goals.publish({"goal_id": {"id": goal.id, "stamp": _now()}, "goal": payload.value()})
    return goal


class _ActionlibGoal:
    """Goal of ROS 1 in flight; satisfies :class:`rwt_participant.goals.GoalChannel`."""

    def __init__(self, goal: Goal) -> None:
        self._goal = goal
        self.topics: list[Handle] = []
        self.cancel: Publisher | None = None
        self.goals: Publisher | None = None

    def send_cancel(self) -> None:
        if self.cancel is not None:
            self.cancel.publish({"id": self._goal.id})

    def forget(self) -> None:
        for topic in self.topics:
            topic.close()
        for publisher in (self.cancel, self.goals):
            if publisher is not None:
                publisher.close()

    def on_feedback(self, message: Message) -> None:
        """Pass on feedback of this goal; the topic carries that of all goals."""
        if message.status.goal_id.id == self._goal.id:
            self._goal.take_feedback(message.feedback)

    def on_result(self, message: Message) -> None:
        """End the goal with its result; the topic carries those of all goals."""
        if message.status.goal_id.id != self._goal.id:
            return
        status = _ENDED.get(message.status.status)
        if status is None:
            self._goal.end(GoalRejected(message.status.text or f"{self._goal.action} rejected the goal"))
        else:
            self._goal.end(GoalResult(status, message.result))


def _now() -> dict[str, int]:
    return NOETIC.time(time.time_ns())
