"""Goals of action servers on ROS 1, through the five topics of actionlib."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import anyio

from rwt_graph.api import ActionInfo, ClientGoal, Sample
from rwt_graph.backend import STATUS, ActionlibStatus, NotifyingGoal, PerNode
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, GoalRejected, ProviderGone
from rwt_participant.goals import GoalStatus
from rwt_participant.qos import DEFAULT_QOS

if TYPE_CHECKING:
    from rwt.extensions.ros1.session import Session
    from rwt.extensions.ros1.topics import Ros1Topics
    from rwt_graph.api import GoalEvents
    from rwt_graph.backend import DistributedGraph, NodeResources, Topic

_GOAL: Final = "/goal"
_GOAL_TYPE: Final = "ActionGoal"

#: Seconds in which a server must connect to its client, and seconds between two looks.
_CONNECT_SECONDS: Final = 10.0
_CONNECT_LOOKS: Final = 0.02
_GONE_LOOKS: Final = 1.0

#: Seconds for which a result waits for feedback that was sent before it, over a connection of its own.
_FEEDBACK_SECONDS: Final = 0.02

_RECALLED, _LOST = 8, 9

#: States of the graph by status of actionlib; the cancelled and lost ones have several.
_STATES: Final = {int(status): state for state, status in STATUS.items()} | {
    int(ActionlibStatus.PENDING): GoalStatus.UNKNOWN,
    _RECALLED: GoalStatus.CANCELED,
    _LOST: GoalStatus.ABORTED,
}


class Ros1Actions:
    """Actions of other nodes: a node that subscribes to `<action>/goal` as an action server does."""

    def __init__(self, graph: DistributedGraph, topics: Ros1Topics) -> None:
        self.graph = graph
        self.ros_topics = topics
        self.session: Session | None = None
        self._clients: PerNode[ActionClient] = PerNode(ActionClient.close)

    def _goal_topics(self) -> Iterator[tuple[str, Topic]]:
        for topic in self.graph.topic_table.all():
            if topic.remote_subscribers and topic.name.endswith(_GOAL) and _action_type(topic):
                yield topic.name.removesuffix(_GOAL), topic

    def names(self) -> set[str]:
        return {name for name, _ in self._goal_topics()}

    def by_node(self) -> Iterator[tuple[str, str]]:
        for name, topic in self._goal_topics():
            yield topic.remote_subscribers[0].node, name

    def info(self, name: str) -> ActionInfo | None:
        topic = self.graph.topic_table.find(f"{name}{_GOAL}")
        if topic is None or not topic.remote_subscribers:
            return None
        try:
            type = self.graph.registry.action(_action_type(topic))
        except InterfaceError:
            return None
        return ActionInfo(name, type, topic.remote_subscribers[0].node)

    def send(
        self, action: str, payload: Payload, events: GoalEvents, goal_id: str, client: NodeResources
    ) -> ClientGoal | None:
        info = self.info(action)
        if info is None or self.session is None:
            return None
        return self._client(info, self.session, client).send(payload, events, goal_id)

    def cancel(self, action: str, goal_id: str, client: NodeResources) -> None:
        info = self.info(action)
        if info is not None and self.session is not None:
            self._client(info, self.session, client).cancel(goal_id)

    def cancel_every(self, action: str, client: NodeResources) -> None:
        self.cancel(action, "", client)  # An empty id without a time means all goals (ALB-07).

    def _client(self, info: ActionInfo, session: Session, owner: NodeResources) -> ActionClient:
        return self._clients.get(owner, info.name, lambda: ActionClient(self, session, info, owner))

    def close_client(self, client: ActionClient) -> None:
        """Close the client of an action that is gone."""
        self._clients.close(client.owner, client.info.name)


def _action_type(topic: Topic) -> str:
    """Return the name of the action whose goals a topic carries; empty if it carries none."""
    name = topic.remote_subscribers[0].type_name
    return name.removesuffix(_GOAL_TYPE) if name.endswith(_GOAL_TYPE) else ""


class ActionClient:
    """Endpoints of one node for one action, and its open goals."""

    def __init__(
        self, actions: Ros1Actions, session: Session, info: ActionInfo, owner: NodeResources
    ) -> None:
        self.info = info
        self.owner = owner
        self._actions = actions
        self._session = session
        self._goals: dict[str, Ros1Goal] = {}
        self._unsent: list[Callable[[], None]] = []
        self._is_watching = False
        # Publishers of results when the open goals were sent.
        self._servers: set[str] = set()
        graph, name, type = actions.graph, info.name, info.type.name
        self._clock = graph.clock
        self._distro = graph.distro
        message = graph.registry.message
        advertise = partial(graph.topic_table.advertise, qos=DEFAULT_QOS, owner=owner)
        self._goal = advertise(f"{name}/goal", message(f"{type}ActionGoal"))
        self._cancel = advertise(f"{name}/cancel", message("actionlib_msgs/GoalID"))
        subscribe = partial(graph.topic_table.subscribe, qos=DEFAULT_QOS, owner=owner)
        self._subscriptions = (
            subscribe(f"{name}/status", self._on_status, message("actionlib_msgs/GoalStatusArray")),
            subscribe(f"{name}/feedback", self._on_feedback, message(f"{type}ActionFeedback")),
            subscribe(f"{name}/result", self._on_result, message(f"{type}ActionResult")),
        )

    def send(self, payload: Payload, events: GoalEvents, goal_id: str) -> Ros1Goal:
        """Send a goal as soon as the server is connected."""
        goal = self._goals[goal_id] = Ros1Goal(self, goal_id, events)
        now = self._distro.time(self._clock.time_ns())
        header, identity = {"stamp": now}, {"stamp": now, "id": goal_id}
        message = {"header": header, "goal_id": identity, "goal": payload.value()}
        self._unsent.append(partial(self._goal.publish, Payload.from_value(self._goal.type, message)))
        self._watch()
        return goal

    def cancel(self, goal_id: str) -> None:
        """Request cancellation of a goal, or of all with an empty id."""
        message = Payload.from_value(self._cancel.type, {"id": goal_id})
        self._unsent.append(partial(self._cancel.publish, message))
        self._watch()

    def _is_connected(self) -> bool:
        """Return True if the server is connected to all topics: it would miss an earlier message."""
        node = self._session.nodes.get(self.owner.name)
        if node is None:
            return False
        sent = (node.publications.get(each.topic) for each in (self._goal, self._cancel))
        received = (self._actions.ros_topics.subscriptions.get(each.topic) for each in self._subscriptions)
        return all(each is not None and each.links for each in sent) and all(
            each is not None and each.connected for each in received
        )

    def _results(self) -> set[str]:
        """Return the connected publishers of results."""
        found = self._actions.ros_topics.subscriptions.get(f"{self.info.name}/result")
        return set() if found is None else set(found.connected)

    def _watch(self) -> None:
        if not self._is_watching:
            self._is_watching = True
            self._session.network.spawn(self._run, f"action {self.info.name}")

    async def _run(self) -> None:
        """Send what waits once the server is connected, and end the goals when it leaves."""
        try:
            with anyio.move_on_after(_CONNECT_SECONDS):
                while not self._is_connected():  # noqa: ASYNC110 - no single event covers the links of five topics
                    await anyio.sleep(_CONNECT_LOOKS)
            if not self._is_connected():
                self._lose_goals(f"Action {self.info.name} did not connect within {_CONNECT_SECONDS:g} s")
            self._servers = self._results()
            while self._unsent or self._goals:
                if self._servers - self._results():  # One that comes back does not know the goals.
                    self._lose_goals(f"Action {self.info.name} is no longer connected")
                    self._servers = self._results()
                unsent, self._unsent = self._unsent, []
                for send in unsent:
                    send()
                if self._actions.info(self.info.name) is None:
                    self._lose_goals(f"Action {self.info.name} was unadvertised")
                    self._actions.close_client(self)
                    return
                await anyio.sleep(_CONNECT_LOOKS if self._unsent else _GONE_LOOKS)
        finally:
            self._is_watching = False

    def _lose_goals(self, why: str) -> None:
        """Drop what waits to be sent, and abort all goals."""
        self._unsent.clear()
        for goal in tuple(self._goals.values()):
            goal.end(GoalStatus.ABORTED, ProviderGone(why))

    def forget(self, goal_id: str) -> None:
        """Remove a goal that has ended."""
        self._goals.pop(goal_id, None)

    def _on_status(self, sample: Sample) -> None:
        message: Any = sample.payload.value()
        for each in message.status_list:
            goal = self._goals.get(each.goal_id.id)
            if goal is not None:
                goal.on_status(_STATES.get(each.status, GoalStatus.UNKNOWN))

    def _on_feedback(self, sample: Sample) -> None:
        message: Any = sample.payload.value()
        goal = self._goals.get(message.status.goal_id.id)
        if goal is not None:
            goal.notify_feedback(Payload.from_value(self.info.type.feedback, message.feedback))

    def _on_result(self, sample: Sample) -> None:
        message: Any = sample.payload.value()
        goal = self._goals.get(message.status.goal_id.id)
        if goal is None:
            return
        if goal.wants_feedback:
            self._clock.call_later(_FEEDBACK_SECONDS, partial(self._end, goal, message))
        else:
            self._end(goal, message)

    def _end(self, goal: Ros1Goal, message: Any) -> None:
        """End a goal with its result, unless it has ended meanwhile."""
        if goal.id not in self._goals:
            return
        goal.reason = message.status.text
        if message.status.status == ActionlibStatus.REJECTED:
            goal.end(GoalStatus.UNKNOWN, GoalRejected(goal.reason or f"{goal.action} rejected the goal"))
        else:
            result = Payload.from_value(self.info.type.result, message.result)
            goal.end(_STATES.get(message.status.status, GoalStatus.ABORTED), result)

    def close(self) -> None:
        """Leave the topics."""
        self._lose_goals(f"the client of {self.info.name} was closed")
        for endpoint in (self._goal, self._cancel, *self._subscriptions):
            endpoint.close()


class Ros1Goal(NotifyingGoal):
    """Goal as its client sees it."""

    def __init__(self, server: ActionClient, goal_id: str, events: GoalEvents) -> None:
        super().__init__(goal_id, server.info.name, events, server.owner)
        self._server = server

    def on_status(self, status: GoalStatus) -> None:
        """Follow the server's state, until the result ends the goal."""
        if status.is_terminal or status is self.status:
            return
        was_unknown, self.status = self.status is GoalStatus.UNKNOWN, status
        if was_unknown:
            self.notify_accepted()

    def end(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        """End the goal; no-op if it has ended."""
        self.status = status
        self.notify_end(outcome)

    def cancel(self) -> None:
        if self.is_heard:
            self._server.cancel(self.id)

    def _let_go(self) -> None:
        super()._let_go()
        self._server.forget(self.id)
