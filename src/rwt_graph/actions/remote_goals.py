"""Goals of action servers in other processes, through the services and topics of ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from rwt_graph.actions.names import SEND_GOAL, ActionNames, struct_payload, uuid_struct
from rwt_graph.api import ActionInfo, ClientGoal, GoalEvents, PendingCall, Sample, Subscription
from rwt_graph.memory.actions import NotifyingGoal
from rwt_graph.memory.services import RemoteServices, Services
from rwt_graph.memory.tables import NodeResources
from rwt_graph.memory.topics import Topics
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.errors import CallFailed, GoalRejected, ProviderGone, ServiceFailed
from rwt_participant.goals import GoalStatus
from rwt_participant.qos import DEFAULT_QOS
from rwt_participant.timers import Timer

#: Goal id that means all goals for ROS 2's cancel service.
_EVERY_GOAL = "0" * 32

_STATES = {status.value: status for status in GoalStatus}


class Ros2Actions:
    """Actions of other processes, known as soon as their three services are: DDS announces each by itself.

    Args:
        remote: services of other processes.
        linger: seconds of subscribing to feedback after a goal has ended, for those that follow. With
            a middleware that connects subscriptions slowly, they would miss their first feedback.
    """

    def __init__(
        self,
        topics: Topics,
        services: Services,
        remote: RemoteServices,
        registry: Registry,
        *,
        linger: float = 0,
    ) -> None:
        self.topics = topics
        self.services = services
        self.registry = registry
        self._remote = remote
        self._linger = linger
        self._readers: dict[tuple[NodeResources, str], FeedbackReader] = {}

    def info(self, name: str) -> ActionInfo | None:
        names = ActionNames(name)
        service, *others = map(self._remote.info, (names.send_goal, names.get_result, names.cancel_goal))
        if service is None or None in others:
            return None
        try:
            type = self.registry.action(service.type.name.removesuffix("_SendGoal"))
        except InterfaceError:
            return None
        return ActionInfo(name, type, service.node)

    def names(self) -> set[str]:
        return {name.removesuffix(SEND_GOAL) for name in self._remote.names() if name.endswith(SEND_GOAL)}

    def by_node(self) -> Iterator[tuple[str, str]]:
        for node, name in self._remote.by_node():
            if name.endswith(SEND_GOAL):
                yield node, name.removesuffix(SEND_GOAL)

    def send(
        self, action: str, payload: Payload, events: GoalEvents, goal_id: str, client: NodeResources
    ) -> ClientGoal | None:
        info = self.info(action)
        if info is None:
            return None
        goal = RemoteGoal(self, info, events, goal_id, client)
        goal.send(payload)
        return goal

    def cancel(self, action: str, goal_id: str, client: NodeResources) -> None:
        if goal_id == _EVERY_GOAL:
            return  # The id of no goal: it would cancel every goal.
        self.ask_to_cancel(action, goal_id, client, lambda _: None)

    def cancel_every(self, action: str, client: NodeResources) -> None:
        self.ask_to_cancel(action, _EVERY_GOAL, client, lambda _: None)

    def want_feedback(self, goal: RemoteGoal) -> None:
        key = (goal.client, goal.action)
        reader = self._readers.get(key)
        if reader is None:
            reader = self._readers[key] = FeedbackReader(self.topics, goal, self._linger)
            reader.on_close = lambda: self._readers.pop(key)
        reader.add(goal)

    def drop_feedback(self, goal: RemoteGoal) -> None:
        """Unsubscribe from the feedback of a goal; no-op without a subscription."""
        reader = self._readers.get((goal.client, goal.action))
        if reader is not None:
            reader.remove(goal)

    def ask_to_cancel(
        self,
        action: str,
        goal_id: str,
        client: NodeResources,
        on_reply: Callable[[Payload | CallFailed], None],
    ) -> None:
        request = self.registry.service("action_msgs/CancelGoal").request
        info = {"goal_info": {"goal_id": {"uuid": bytes.fromhex(goal_id)}}}
        name = ActionNames(action).cancel_goal
        self.services.call(name, Payload.from_value(request, info), on_reply, None, client)


class FeedbackReader:
    """Subscription of one node to the feedback of an action, for all its goals."""

    def __init__(self, topics: Topics, goal: RemoteGoal, linger: float) -> None:
        self.on_close: Callable[[], object] = lambda: None
        self._clock = topics.clock
        self._linger = linger
        self._goals: dict[str, RemoteGoal] = {}
        self._timer: Timer | None = None
        self._client = goal.client
        type = topics.registry.message(f"{goal.type.name}_FeedbackMessage")
        name = ActionNames(goal.action).feedback
        self._subscription = topics.subscribe(name, self._on_sample, type, DEFAULT_QOS, goal.client)
        goal.client.add(self, self.close)

    def add(self, goal: RemoteGoal) -> None:
        self._goals[goal.id] = goal
        self._cancel_timer()

    def remove(self, goal: RemoteGoal) -> None:
        """Ignore the feedback of a goal; close after the last one."""
        self._goals.pop(goal.id, None)
        if self._goals or self._timer is not None:
            return
        if self._linger:
            self._timer = self._clock.call_later(self._linger, self.close)
        else:
            self.close()

    def close(self) -> None:
        self._cancel_timer()
        self._client.drop(self)
        self.on_close()
        self._subscription.close()

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _on_sample(self, sample: Sample) -> None:
        message: Any = sample.payload.value()
        goal = self._goals.get(bytes(message.goal_id.uuid).hex())
        if goal is not None:
            goal.notify_feedback(Payload.from_value(goal.type.feedback, message.feedback))


class RemoteGoal(NotifyingGoal):
    """Goal as its client sees it; only servers of this project send reasons."""

    def __init__(
        self, actions: Ros2Actions, info: ActionInfo, events: GoalEvents, goal_id: str, client: NodeResources
    ) -> None:
        super().__init__(goal_id, info.name, events, client)
        self.type = info.type
        self._names = ActionNames(info.name)
        self._actions = actions
        self._reasons: Subscription | None = None
        self._pending: PendingCall | None = None

    def send(self, payload: Payload) -> None:
        """Subscribe to the goal's feedback and reason, then send it."""
        self.want_feedback(True)
        topics, registry = self._actions.topics, self._actions.registry
        reasons = topics.info(self._names.reasons)
        if reasons is not None and reasons.publishers:
            text = registry.message("std_msgs/String")
            self._reasons = topics.subscribe(reasons.name, self._on_reason, text, DEFAULT_QOS, self.client)
        request = registry.service(f"{self.type.name}_SendGoal").request
        goal = struct_payload(request, goal_id=uuid_struct(request, self.id), goal=payload.value())
        self._call(self._names.send_goal, goal, self._on_answer)

    def want_feedback(self, wanted: bool) -> None:
        """Subscribe to the feedback or unsubscribe: a server without subscribers sends none."""
        if not wanted:
            self._actions.drop_feedback(self)
        elif self.wants_feedback:
            self._actions.want_feedback(self)

    def _call(self, service: str, request: Payload, on_reply: Callable[[Payload | CallFailed], None]) -> None:
        self._pending = self._actions.services.call(service, request, on_reply, None, self.client)

    # Answers of the server

    def _on_answer(self, answer: Payload | CallFailed) -> None:
        if isinstance(answer, CallFailed):
            self._failed(GoalRejected(str(answer)) if isinstance(answer, ServiceFailed) else answer)
            return
        response: Any = answer.value()
        if not response.accepted:
            text = self.reason or f"action {self.action} rejected the goal"
            self._end(GoalStatus.UNKNOWN, GoalRejected(text))
            return
        # A cancel may have been granted before this answer came.
        self.status = max(self.status, GoalStatus.EXECUTING)
        if self.is_heard:
            self.notify_accepted()
            request = self._actions.registry.service(f"{self.type.name}_GetResult").request
            payload = struct_payload(request, goal_id=uuid_struct(request, self.id))
            self._call(self._names.get_result, payload, self._on_result)

    def _on_result(self, answer: Payload | CallFailed) -> None:
        if isinstance(answer, CallFailed):
            self._failed(answer)
            return
        response: Any = answer.value()
        status = _STATES.get(response.status, GoalStatus.UNKNOWN)
        if not status.is_terminal:
            self._failed(ProviderGone(f"Action {self.action} no longer knows goal {self.id}"))
            return
        self._end(status, Payload.from_value(self.type.result, response.result))

    def _failed(self, failure: CallFailed) -> None:
        if isinstance(failure, ProviderGone):
            why = f": its node {failure.node} left" if failure.node else ""
            gone = ProviderGone(f"Action {self.action} was unadvertised{why}")
            gone.node = failure.node
            self._end(GoalStatus.ABORTED, gone)
        else:
            self._end(self.status, failure)

    def _on_reason(self, sample: Sample) -> None:
        message: Any = sample.payload.value()
        goal_id, _, reason = message.data.partition(" ")
        if goal_id == self.id:
            self.reason = reason

    def _end(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        self.status = status
        if isinstance(outcome, ProviderGone):
            self.reason = str(outcome)
        self.notify_end(outcome)

    # Requests of the client

    def cancel(self) -> None:
        if self.is_heard and not self.status.is_terminal:
            self._actions.ask_to_cancel(self.action, self.id, self.client, self._on_cancel_answer)

    def _on_cancel_answer(self, answer: Payload | CallFailed) -> None:
        if isinstance(answer, CallFailed) or self.status.is_terminal:
            return
        response: Any = answer.value()
        if any(bytes(info.goal_id.uuid).hex() == self.id for info in response.goals_canceling):
            self.status = GoalStatus.CANCELING

    def abandon(self) -> None:
        pending = self._pending
        self._let_go()
        if pending is not None and self.status is not GoalStatus.UNKNOWN:
            # Let the call be answered: cancelling it might cancel the goal.
            pending.cancel()

    def _let_go(self) -> None:
        super()._let_go()
        self.want_feedback(False)
        if self._reasons is not None:
            self._reasons.close()
