"""Goals of action servers in other processes, through the services and topics of ROS 2."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from rwt_graph.actions.names import SEND_GOAL, ActionNames, struct_payload, uuid_struct
from rwt_graph.api import ActionInfo, ClientGoal, Sample, Subscription
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, GoalRejected, ProviderGone, ServiceFailed
from rwt_participant.goals import GoalStatus
from rwt_participant.qos import DEFAULT_QOS

if TYPE_CHECKING:
    from rwt_graph.api import GoalEvents, PendingCall
    from rwt_graph.memory.services import RemoteServices, Services
    from rwt_graph.memory.tables import NodeResources
    from rwt_graph.memory.topics import Topics
    from rwt_interfaces.registry import Registry

logger = logging.getLogger(__name__)

#: Goal id that means all goals for ROS 2's cancel service.
_EVERY_GOAL = "0" * 32

_STATES = {status.value: status for status in GoalStatus}


class Ros2Actions:
    """Actions of other processes: a node that offers `<action>/_action/send_goal` offers the action."""

    def __init__(
        self, topics: Topics, services: Services, remote: RemoteServices, registry: Registry
    ) -> None:
        self.topics = topics
        self.services = services
        self.registry = registry
        self._remote = remote

    def info(self, name: str) -> ActionInfo | None:
        service = self._remote.info(f"{name}{SEND_GOAL}")
        if service is None:
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

    def ask_to_cancel(
        self,
        action: str,
        goal_id: str,
        client: NodeResources,
        on_reply: Callable[[Payload | CallFailed], None],
    ) -> None:
        """Call the action's cancel service."""
        request = self.registry.service("action_msgs/CancelGoal").request
        info = {"goal_info": {"goal_id": {"uuid": bytes.fromhex(goal_id)}}}
        name = ActionNames(action).cancel_goal
        self.services.call(name, Payload.from_value(request, info), on_reply, None, client)


class RemoteGoal(ClientGoal):
    """Goal as its client sees it; only servers of this project send reasons."""

    status = GoalStatus.UNKNOWN
    reason = ""

    def __init__(
        self, actions: Ros2Actions, info: ActionInfo, events: GoalEvents, goal_id: str, client: NodeResources
    ) -> None:
        self.id = goal_id
        self.action = info.name
        self._type = info.type
        self._names = ActionNames(info.name)
        self._actions = actions
        self._events: GoalEvents | None = events
        self._client = client
        self._feedback: Subscription | None = None
        self._reasons: Subscription | None = None
        self._pending: PendingCall | None = None

    def send(self, payload: Payload) -> None:
        """Subscribe to the goal's feedback and reason, then send it."""
        self._client.add(self, self.client_closed)
        self.want_feedback(True)
        self._reasons = self._listen(self._names.reasons, "std_msgs/String", self._on_reason)
        request = self._actions.registry.service(f"{self._type.name}_SendGoal").request
        goal = struct_payload(request, goal_id=uuid_struct(request, self.id), goal=payload.value())
        self._call(self._names.send_goal, goal, self._on_answer)

    def want_feedback(self, wanted: bool) -> None:
        """Subscribe to the feedback or unsubscribe: a server without subscribers sends none."""
        feedback = self._feedback
        if not wanted and feedback is not None:
            self._feedback = None
            feedback.close()
        elif (
            wanted and feedback is None and self._events is not None and self._events.on_feedback is not None
        ):
            type = f"{self._type.name}_FeedbackMessage"
            self._feedback = self._listen(self._names.feedback, type, self._on_feedback)

    def _listen(self, topic: str, type: str, on_sample: Callable[[Sample], None]) -> Subscription:
        actions = self._actions
        return actions.topics.subscribe(
            topic, on_sample, actions.registry.message(type), DEFAULT_QOS, self._client
        )

    def _call(self, service: str, request: Payload, on_reply: Callable[[Payload | CallFailed], None]) -> None:
        self._pending = self._actions.services.call(service, request, on_reply, None, self._client)

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
        if self._events is not None:
            if self._events.on_accepted is not None:
                self._run_callback(self._events.on_accepted)
            self._ask_result()

    def _ask_result(self) -> None:
        request = self._actions.registry.service(f"{self._type.name}_GetResult").request
        self._call(
            self._names.get_result,
            struct_payload(request, goal_id=uuid_struct(request, self.id)),
            self._on_result,
        )

    def _on_result(self, answer: Payload | CallFailed) -> None:
        if isinstance(answer, CallFailed):
            self._failed(answer)
            return
        response: Any = answer.value()
        status = _STATES.get(response.status, GoalStatus.UNKNOWN)
        if not status.is_terminal:
            self._failed(ProviderGone(f"Action {self.action} no longer knows goal {self.id}"))
            return
        self._end(status, Payload.from_value(self._type.result, response.result))

    def _failed(self, failure: CallFailed) -> None:
        if isinstance(failure, ProviderGone):
            self._end(GoalStatus.ABORTED, ProviderGone(f"Action {self.action} was unadvertised"))
        else:
            self._end(self.status, failure)

    def _on_feedback(self, sample: Sample) -> None:
        message: Any = sample.payload.value()
        events = self._events
        if bytes(message.goal_id.uuid).hex() != self.id or events is None:
            return
        if (on_feedback := events.on_feedback) is not None:
            feedback = Payload.from_value(self._type.feedback, message.feedback)
            self._run_callback(lambda: on_feedback(feedback))

    def _on_reason(self, sample: Sample) -> None:
        message: Any = sample.payload.value()
        goal_id, _, reason = message.data.partition(" ")
        if goal_id == self.id:
            self.reason = reason

    def _end(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        self.status = status
        if isinstance(outcome, ProviderGone):
            self.reason = str(outcome)
        events = self._events
        self._let_go()
        if events is not None:
            self._run_callback(lambda: events.on_result(status, outcome))

    # Requests of the client

    def cancel(self) -> None:
        if self._events is not None and not self.status.is_terminal:
            self._actions.ask_to_cancel(self.action, self.id, self._client, self._on_cancel_answer)

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

    def client_closed(self) -> None:
        """Drop the callbacks of a client whose node leaves; the goal continues (ACT-19)."""
        self._end(self.status, CallFailed(f"node {self._client.name} was closed"))

    def _let_go(self) -> None:
        self._events = None
        self._client.drop(self)
        self.want_feedback(False)
        if self._reasons is not None:
            self._reasons.close()

    def _run_callback(self, callback: Callable[[], None]) -> None:
        try:
            callback()
        except Exception:
            logger.exception("a callback of goal %s of %s failed", self.id, self.action)
