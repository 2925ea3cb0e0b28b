"""Service introspection, and topics of actions, as in ROS 2.

Events of a service `/add` of type `pkg/srv/X` are on `/add/_service_event` (`pkg/srv/X_Event`): each request
and each response. ROS 2 has no failed calls: of such a call only the request is published. Events of an
action `/go` are on `/go/_action/feedback` and `/go/_action/status`, and in the events of
`/go/_action/send_goal` and `/go/_action/get_result`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from rwt_graph.api import ActionInfo, CallObserver, GoalEvents, Graph, OnReply, Publisher, ServiceInfo
from rwt_interfaces import Payload
from rwt_participant.errors import CallFailed, RobotError
from rwt_participant.goals import GoalStatus
from rwt_participant.qos import DEFAULT_QOS, LATCHED, QoS
from rwt_participant.timers import Timer

logger = logging.getLogger(__name__)

REQUEST_RECEIVED: Final = 1
RESPONSE_SENT: Final = 2

_LOOK_SECONDS: Final = 1.0
_NOBODY: Final = bytes(16)


class NotObservable(Exception):
    """The calls of the graph cannot be observed: it is a ROS 1 graph, or its backend does not see them."""


@dataclass(frozen=True, slots=True)
class _Open:
    service: str
    type: str
    number: int


class Introspection(CallObserver):
    """Node that publishes the calls and goals of a graph.

    Args:
        graph: graph of ROS 2.
        on_topic: called when a topic was added, before its first message.

    Raises:
        NotObservable: the calls of the graph cannot be published.
    """

    def __init__(self, graph: Graph, on_topic: Callable[[], None] = lambda: None) -> None:
        if not graph.distro.introspects_calls:
            raise NotObservable("ROS 1 has no service introspection; its actions are topics already")
        self._graph = graph
        self._on_topic = on_topic
        self._publishers: dict[str, tuple[str, Publisher]] = {}  # by topic, with the type's name
        self._needed: set[str] = set()
        self._refused: set[str] = set()
        self._statuses: dict[str, dict[str, tuple[GoalStatus, int]]] = {}
        self._calls = 0
        self._participant = graph.participant("/introspection")
        self._timer: Timer | None = None
        if not graph.observe_calls(self):
            self._participant.close()
            raise NotObservable("the calls in this graph are seen by their own nodes only")
        self._look()

    def _look(self) -> None:
        self._needed.clear()
        for service in self._graph.services():
            if _is_observed(service.name):
                self._events_of(service.name, service.type.name)
        for action in self._graph.actions():
            if _is_observed(action.name):
                self._topics_of(action)
        for topic in self._publishers.keys() - self._needed:
            self._publishers.pop(topic)[1].close()
        self._refused &= self._needed
        self._timer = self._graph.clock.call_later(_LOOK_SECONDS, self._look)

    def _topics_of(self, action: ActionInfo) -> None:
        for part, kind in (("send_goal", "SendGoal"), ("get_result", "GetResult")):
            self._events_of(f"{action.name}/_action/{part}", f"{action.type.name}_{kind}")
        if not self._is_carried(action):
            self._feedback_of(action)
            self._status_of(action)

    def _is_carried(self, action: ActionInfo) -> bool:
        """Return True if the action server itself has the topics of ROS 2, as over a network."""
        return self._graph.service(f"{action.name}/_action/send_goal") is not None

    def _events_of(self, service: str, type_name: str) -> Publisher | None:
        return self._publisher(f"{service}/_service_event", f"{type_name}_Event")

    def _feedback_of(self, action: ActionInfo) -> Publisher | None:
        return self._publisher(f"{action.name}/_action/feedback", f"{action.type.name}_FeedbackMessage")

    def _status_of(self, action: ActionInfo) -> Publisher | None:
        return self._publisher(f"{action.name}/_action/status", "action_msgs/GoalStatusArray", LATCHED)

    def _publisher(self, topic: str, type_name: str, qos: QoS = DEFAULT_QOS) -> Publisher | None:
        self._needed.add(topic)
        known, publisher = self._publishers.get(topic, ("", None))
        if publisher is not None and known == type_name:
            return publisher
        if publisher is not None:  # The service was offered again with another type.
            del self._publishers[topic]
            publisher.close()
        try:
            message = self._graph.registry.message(type_name)
            publisher = self._participant.advertise(topic, message, qos)
        except RobotError as error:
            if topic not in self._refused:
                self._refused.add(topic)
                logger.warning("nothing is published on %s: %s", topic, error)
            return None
        self._publishers[topic] = (type_name, publisher)
        self._on_topic()
        return publisher

    # -- services ------------------------------------------------------------------------------------------

    def on_call(self, service: ServiceInfo, request: Payload, on_reply: OnReply) -> OnReply:
        """Publish a call, and later its response."""
        if not _is_observed(service.name):
            return on_reply
        call = self._begin(service.name, service.type.name)
        self.publish_event(call, REQUEST_RECEIVED, request.value())

        def answered(answer: Payload | CallFailed) -> None:
            if isinstance(answer, Payload):
                self.publish_event(call, RESPONSE_SENT, answer.value())
            on_reply(answer)

        return answered

    def now(self) -> dict[str, int]:
        """Return the time of the graph, as in messages."""
        return self._graph.distro.time(self._graph.clock.time_ns())

    def _begin(self, service: str, type_name: str) -> _Open:
        self._calls += 1
        return _Open(service, type_name, self._calls)

    def publish_event(self, call: _Open, event: int, content: object) -> None:
        """Publish an event of a call."""
        publisher = self._events_of(call.service, call.type)
        if publisher is None:
            return
        info = {
            "event_type": event,
            "stamp": self.now(),
            "client_gid": _NOBODY,
            "sequence_number": call.number,
        }
        part = "request" if event == REQUEST_RECEIVED else "response"
        publisher.publish(Payload.from_value(publisher.type, {"info": info, part: [content]}))

    # -- actions -------------------------------------------------------------------------------------------

    def on_goal(self, action: ActionInfo, goal_id: str, goal: Payload, events: GoalEvents) -> GoalEvents:
        """Publish a goal, and later its progress."""
        if not _is_observed(action.name):
            return events
        watched = _WatchedGoal(self, action, goal_id, events)
        watched.sent(goal)
        return GoalEvents(watched.ended, watched.fed_back, watched.accepted)

    def publish_status(self, action: ActionInfo, goal_id: str, status: GoalStatus) -> None:
        """Publish the status of this goal and of the action's other active goals."""
        if self._is_carried(action):
            return
        goals = self._statuses.setdefault(action.name, {})
        accepted_at = goals.get(goal_id, (status, self._graph.clock.time_ns()))[1]
        goals[goal_id] = (status, accepted_at)
        listed = [
            {"goal_info": {"goal_id": uuid(each), "stamp": self._graph.distro.time(at)}, "status": int(state)}
            for each, (state, at) in goals.items()
        ]
        if status.is_terminal:
            del goals[goal_id]
        if not goals:
            del self._statuses[action.name]
        publisher = self._status_of(action)
        if publisher is not None:
            publisher.publish(Payload.from_value(publisher.type, {"status_list": listed}))

    def publish_feedback(self, action: ActionInfo, goal_id: str, feedback: Payload) -> None:
        """Publish a goal's feedback."""
        if self._is_carried(action):
            return
        publisher = self._feedback_of(action)
        content = {"goal_id": uuid(goal_id), "feedback": feedback.value()}
        if publisher is not None:
            publisher.publish(Payload.from_value(publisher.type, content))

    def begin_step(self, action: ActionInfo, part: str, kind: str, request: dict[str, object]) -> _Open:
        """Publish the request of one step of a goal."""
        step = self._begin(f"{action.name}/_action/{part}", f"{action.type.name}_{kind}")
        self.publish_event(step, REQUEST_RECEIVED, request)
        return step

    def close(self) -> None:
        """Stop publishing. Idempotent."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._graph.observe_calls(None)
            self._participant.close()


@dataclass(eq=False)
class _WatchedGoal:
    """Goal whose events are published, and forwarded to its client."""

    introspection: Introspection
    action: ActionInfo
    id: str
    events: GoalEvents
    sending: _Open | None = None
    result: _Open | None = None

    def sent(self, goal: Payload) -> None:
        request: dict[str, object] = {"goal_id": uuid(self.id), "goal": goal.value()}
        self.sending = self.introspection.begin_step(self.action, "send_goal", "SendGoal", request)

    def accepted(self) -> None:
        self._answer(accepted=True)
        self.introspection.publish_status(self.action, self.id, GoalStatus.EXECUTING)
        asked: dict[str, object] = {"goal_id": uuid(self.id)}
        self.result = self.introspection.begin_step(self.action, "get_result", "GetResult", asked)
        if self.events.on_accepted is not None:
            self.events.on_accepted()

    def fed_back(self, feedback: Payload) -> None:
        self.introspection.publish_feedback(self.action, self.id, feedback)
        if self.events.on_feedback is not None:
            self.events.on_feedback(feedback)

    def ended(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        if self.result is None:
            self._answer(accepted=False)
        else:
            self.introspection.publish_status(self.action, self.id, status)
            if isinstance(outcome, Payload):
                response: dict[str, object] = {"status": int(status), "result": outcome.value()}
                self.introspection.publish_event(self.result, RESPONSE_SENT, response)
        self.events.on_result(status, outcome)

    def _answer(self, *, accepted: bool) -> None:
        sending, self.sending = self.sending, None
        if sending is not None:
            response = {"accepted": accepted, "stamp": self.introspection.now()}
            self.introspection.publish_event(sending, RESPONSE_SENT, response)


def _is_observed(name: str) -> bool:
    return not name.startswith("/rosapi/") and "/_action/" not in name


def uuid(goal_id: str) -> dict[str, bytes]:
    """Return a goal id as in `unique_identifier_msgs/UUID`."""
    return {"uuid": bytes.fromhex(goal_id)}
