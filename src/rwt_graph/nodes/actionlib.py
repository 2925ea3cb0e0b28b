"""Actions of ROS 1: goals, cancels, status, feedback and results as messages on five topics (ALB-01).

On noetic each action of a node is also served over topics: a goal message is sent as a goal of the graph, and
its events are published as messages. Unlike with ROS 1's simple server, goals run concurrently.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import partial

from rwt_graph.accounts import Release, hold_for_asker
from rwt_graph.api import ClientGoal, GoalEvents, Graph, Participant, Sample, Subscription
from rwt_graph.nodes.endpoints import TopicPublisher
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ActionType
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.errors import CallFailed, GoalRejected
from rwt_participant.goals import GoalStatus
from rwt_participant.messages import Message
from rwt_participant.timers import Timer

logger = logging.getLogger(__name__)

#: Interval of status messages in seconds: clients wait 3 s for the first one (ALB-04, ALB-05).
STATUS_PERIOD = 0.5

#: Seconds for which an ended goal stays in the status messages, as in ROS 1.
ENDED_GOALS_STAY = 5.0

#: Maximum number of goals with which each change is published at once; beyond it, only the timer publishes.
FEW_GOALS = 50

#: Maximum number of ended goals in the status messages; beyond it, the oldest are removed early.
MOST_ENDED = 100

#: Maximum length of a client's goal id in characters; ROS 1's own have fewer than a hundred.
LONGEST_ID = 256


class ActionlibStatus(IntEnum):
    """States of `actionlib_msgs/GoalStatus`, which differ from those of ROS 2 (ALB-08)."""

    PENDING = 0
    ACTIVE = 1
    PREEMPTED = 2
    SUCCEEDED = 3
    ABORTED = 4
    REJECTED = 5
    PREEMPTING = 6


#: Status of actionlib by state of a goal.
STATUS: Mapping[GoalStatus, ActionlibStatus] = {
    GoalStatus.UNKNOWN: ActionlibStatus.PENDING,
    GoalStatus.ACCEPTED: ActionlibStatus.PENDING,
    GoalStatus.EXECUTING: ActionlibStatus.ACTIVE,
    GoalStatus.CANCELING: ActionlibStatus.PREEMPTING,
    GoalStatus.SUCCEEDED: ActionlibStatus.SUCCEEDED,
    GoalStatus.CANCELED: ActionlibStatus.PREEMPTED,
    GoalStatus.ABORTED: ActionlibStatus.ABORTED,
}


@dataclass(slots=True)
class Tracked:
    """Goal that was received as a message.

    Attributes:
        id: id that the client gave.
        stamp_ns: the client's time of sending; time of arrival if it gave none.
        forget_at: steady time at which it leaves the status messages.
        release: releases the charge of its client.
    """

    id: str
    stamp_ns: int
    goal: ClientGoal | None = None
    ended: ActionlibStatus | None = None
    text: str = ""
    forget_at: float = 0.0
    release: Release | None = None

    @property
    def status(self) -> ActionlibStatus:
        if self.ended is not None:
            return self.ended
        return ActionlibStatus.ACTIVE if self.goal is None else STATUS[self.goal.status]


class ActionlibServer:
    """Server of one action of a node over topics.

    Args:
        idle_status: True to publish the status without goals, too; ROS 1 clients wait for it.
    """

    def __init__(
        self,
        graph: Graph,
        participant: Participant,
        action: str,
        interface: ActionType,
        create_timer: Callable[[float, Callable[[], None]], Timer],
        *,
        idle_status: bool = True,
    ) -> None:
        self._idle_status = idle_status
        self._action = action
        self._interface = interface
        self._participant = participant
        self._graph = graph
        self._goals: dict[str, Tracked] = {}
        self._count = 0
        self._node_name = participant.name
        self._feedback = self._advertise("feedback", f"{interface.name}ActionFeedback")
        self._result = self._advertise("result", f"{interface.name}ActionResult")
        self._status = self._advertise("status", "actionlib_msgs/GoalStatusArray")
        self._subscriptions = (
            self._subscribe("goal", f"{interface.name}ActionGoal", self._on_goal),
            self._subscribe("cancel", "actionlib_msgs/GoalID", self._on_cancel),
        )
        self._timer = create_timer(STATUS_PERIOD, self._publish_status)

    def _advertise(self, topic: str, type: str) -> TopicPublisher:
        message = self._graph.registry.message(type)
        return TopicPublisher(self._graph, self._participant.advertise(f"{self._action}/{topic}", message))

    def _subscribe(self, topic: str, type: str, callback: Callable[[Message], None]) -> Subscription:
        def on_sample(sample: Sample) -> None:
            callback(sample.payload.value())

        message = self._graph.registry.message(type)
        return self._participant.subscribe(f"{self._action}/{topic}", on_sample, message)

    def close(self) -> None:
        """Leave the topics; the results of running goals have been sent by then."""
        self._timer.cancel()
        for endpoint in (*self._subscriptions, self._feedback, self._result, self._status):
            endpoint.close()

    def _serving(self) -> bool:
        """Return True if the node still offers the action; a replaced one must not answer, too."""
        info = self._graph.action(self._action)
        return info is not None and info.node == self._node_name

    def _on_goal(self, message: Message) -> None:
        """Send a goal; without an id from the client it gets ROS 1's `node-count-time` (ALB-02)."""
        if not self._serving():
            return
        now = self._graph.clock.time_ns()
        stamp = self._graph.distro.time_ns(message.goal_id.stamp) or now
        self._count += 1
        goal_id = message.goal_id.id or f"{self._node_name}-{self._count}-{now / NANOSECONDS:.9f}"
        if len(goal_id) > LONGEST_ID:
            logger.warning(
                "a goal of %s is ignored: its id has %d characters, and %d is the limit",
                self._action,
                len(goal_id),
                LONGEST_ID,
            )
            return
        if goal_id in self._goals:
            logger.warning("goal %s of %s was sent twice; the second is ignored", goal_id, self._action)
            return
        payload = Payload.from_value(self._interface.goal, message.goal, self._graph.clock.time_ns)
        tracked = self._goals[goal_id] = Tracked(goal_id, stamp)
        events = GoalEvents(
            partial(self._on_result, tracked),
            lambda feedback: self._send(self._feedback, tracked, "feedback", feedback.value()),
            self._publish_change,
        )
        try:
            tracked.release = hold_for_asker(payload.kept_size)
        except CallFailed as failed:
            self._on_result(tracked, GoalStatus.UNKNOWN, GoalRejected(str(failed)))
            return
        tracked.goal = self._participant.send_goal(self._action, payload, events)

    def _on_cancel(self, message: Message) -> None:
        """Cancel all goals, the named one, or those sent no later than the stamp (ALB-07)."""
        stamp = self._graph.distro.time_ns(message.stamp)
        everything = not stamp and not message.id
        for tracked in tuple(self._goals.values()):
            named = bool(message.id) and tracked.id == message.id
            if tracked.goal is not None and (everything or named or 0 < tracked.stamp_ns <= stamp):
                tracked.goal.cancel()
        self._publish_change()

    def _on_result(self, tracked: Tracked, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        if tracked.release is not None:
            tracked.release()
        if isinstance(outcome, CallFailed):
            rejected = isinstance(outcome, GoalRejected)
            tracked.ended = ActionlibStatus.REJECTED if rejected else ActionlibStatus.ABORTED
            tracked.text = str(outcome)
            result: Message = {}
        else:
            tracked.ended = STATUS[status]
            tracked.text = "" if tracked.goal is None else tracked.goal.reason
            result = outcome.value()
        tracked.forget_at = self._graph.clock.monotonic() + ENDED_GOALS_STAY
        self._send(self._result, tracked, "result", result)
        self._publish_change()

    def _send(self, publisher: TopicPublisher, tracked: Tracked, part: str, message: Message) -> None:
        header = {"stamp": self._graph.distro.time(self._graph.clock.time_ns())}
        publisher.publish({"header": header, "status": self._status_of(tracked), part: message})

    def _status_of(self, tracked: Tracked) -> dict[str, object]:
        goal_id = {"stamp": self._graph.distro.time(tracked.stamp_ns), "id": tracked.id}
        return {"goal_id": goal_id, "status": int(tracked.status), "text": tracked.text}

    def _update_feedback_wanted(self) -> None:
        heard = self._feedback.subscriber_count > 0
        for tracked in self._goals.values():
            if tracked.goal is not None:
                tracked.goal.want_feedback(heard)

    def _publish_change(self) -> None:
        if len(self._goals) <= FEW_GOALS:
            self._publish_status()
        else:
            self._forget_ended()
            self._update_feedback_wanted()

    def _forget_ended(self) -> None:
        now = self._graph.clock.monotonic()
        ended = [tracked for tracked in self._goals.values() if tracked.ended is not None]
        for number, tracked in enumerate(ended):
            if tracked.forget_at <= now or number < len(ended) - MOST_ENDED:
                del self._goals[tracked.id]

    def _publish_status(self) -> None:
        if not self._serving():
            return
        self._update_feedback_wanted()
        self._forget_ended()
        if not self._status.subscriber_count or not (self._goals or self._idle_status):
            return
        self._status.publish(
            {
                "header": {"stamp": self._graph.distro.time(self._graph.clock.time_ns())},
                "status_list": [self._status_of(tracked) for tracked in self._goals.values()],
            }
        )
