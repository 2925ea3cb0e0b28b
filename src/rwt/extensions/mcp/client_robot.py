"""Robot as one client may see it and act on it: what the tools of an agent use in the gateway."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from typing import Any, Final

from rwt.access.client_graph import ClientGraph
from rwt_graph import api
from rwt_graph.api import Graph, Sample, ServerGoal, ServiceCall
from rwt_graph.names import resolve
from rwt_graph.nodes.goals import GraphGoal
from rwt_graph.nodes.graph_robot import GraphVerbs
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.errors import InvalidMessage, ProviderNotFound
from rwt_participant.future import Future
from rwt_participant.goals import Goal
from rwt_participant.messages import Message, MessageLike
from rwt_participant.qos import DEFAULT_QOS, QoS
from rwt_participant.rosapi_parameters import RosapiParameters

logger = logging.getLogger(__name__)

_ROSAPI: Final = "/rosapi"

#: Timeout of calls of rosapi, in seconds.
_ANSWER_SECONDS: Final = 5.0

#: Seconds beyond the timeout of a call, which the graph keeps, in which a person may approve it.
_GRACE_SECONDS: Final = 0.5

#: Seconds in which a goal must be accepted, or approved by a person.
_ACCEPT_SECONDS: Final = 30.0


class ClientRobot(GraphVerbs):
    """Robot in this process as one client may see it: every verb passes :class:`ClientGraph`.

    Args:
        name: absolute name of the gateway's node.
        ask_for_approval: asks the person at the agent's program to approve what the gate holds back of this
            client, for so many seconds; returns True if an approval was given. None without a gate.
        on_end: called with the reason if a subscription has ended: the robot gives its topic another type.
    """

    def __init__(
        self,
        graph: Graph,
        client: ClientGraph,
        name: str,
        ask_for_approval: Callable[[float], Awaitable[bool]] | None = None,
        on_end: Callable[[str], None] = lambda _: None,
    ) -> None:
        super().__init__(graph, client, name, None)
        self._on_end = on_end
        self._client = client
        self._ask_for_approval = ask_for_approval
        self.params = RosapiParameters(self._ask)

    def resolve(self, name: str) -> str:
        """Return the absolute form of a name."""
        return resolve(name)  # A client has no node, so no private names.

    async def pass_gate(self, seconds: float = 0.0) -> bool:
        """Request approval of what the gate holds back, for so many seconds; return True if it was given.

        Raises:
            ToolError: the person refuses, or cannot be asked.
        """
        return self._ask_for_approval is not None and await self._ask_for_approval(seconds)

    async def lease_seconds(self, topic: str) -> float | None:
        """Return the timeout of the gate's lease of a topic in seconds; None without a lease."""
        return self._client.lease_seconds(topic)

    def _advertise(self, topic: str, type: MessageType, qos: QoS) -> api.Publisher:
        return _ClientPublisher(self._client, topic, type, qos)

    def _listen(
        self, topic: str, on_sample: Callable[[Sample], None], type: MessageType | None, qos: QoS
    ) -> api.Subscription:
        return _ClientSubscription(self._client, topic, on_sample, type, self._on_end)

    async def _answer(self, service: str, request: MessageLike | None, seconds: float | None) -> Payload:
        answer: Future[Payload] = Future()
        try:
            self._client.call_service(service, lambda type: self._payload(type, request), answer.set, seconds)
        except ProviderNotFound as error:
            raise ProviderNotFound(f"{error}{self._meant(service, self._client.services())}") from None
        await self.pass_gate()
        late = f"{service} has not answered, or the gate has not received an approval,"
        patience = None if seconds is None else seconds + _GRACE_SECONDS
        return await answer.get(patience, late, self.clock.within)

    async def _ask(self, question: str, request: Mapping[str, object]) -> Any:
        return (await self._answer(f"{_ROSAPI}/{question}", request, _ANSWER_SECONDS)).plain()

    def _offer_service(
        self, service: str, type: ServiceType, on_call: Callable[[ServiceCall], None]
    ) -> tuple[Callable[[], object], ...]:
        self._client.advertise_service(service, type.name, lambda _, call: on_call(call))
        return (partial(self._client.withdraw_service, service),)

    def _offer_action(
        self, action: str, type: ActionType, on_goal: Callable[[ServerGoal], None]
    ) -> tuple[Callable[[], object], ...]:
        self._client.advertise_action(action, type.name, lambda _, goal: on_goal(goal))
        return (partial(self._client.withdraw_action, action),)

    async def send_goal(
        self,
        action: str,
        goal: MessageLike | None = None,
        type: str | None = None,
        *,
        on_feedback: Callable[[Message], object] | None = None,
    ) -> Goal:
        """Send a goal, as :meth:`rwt_participant.api.RobotApi.send_goal` does."""
        name, client = self.resolve(action), self._client
        sent = GraphGoal(self.clock, name, on_feedback)
        try:
            sent.send(lambda events: client.send_goal(name, lambda t: self._payload(t.goal, goal), events))
        except ProviderNotFound as error:
            raise ProviderNotFound(f"{error}{self._meant(name, client.actions())}") from None
        try:
            await self.pass_gate()
            late = f"{action} has not accepted the goal, or the gate has not received an approval,"
            await sent.accepted.get(_ACCEPT_SECONDS, late, self.clock.within)
        except BaseException:
            sent.cancel()
            raise
        return sent

    def cancel_goal(self, action: str, goal_id: str) -> None:
        """Cancel a goal, as :meth:`rwt_participant.api.RobotApi.cancel_goal` does."""
        self._client.cancel_goal(action, goal_id)

    def _close(self) -> None:
        super()._close()
        if self._tf is not None:
            self._tf.close()
        self._client.close()


class _ClientSubscription(api.Subscription):
    """Subscription of a client; the time of its callback is charged to the client."""

    def __init__(
        self,
        client: ClientGraph,
        topic: str,
        on_sample: Callable[[Sample], None],
        type: MessageType | None,
        on_end: Callable[[str], None],
    ) -> None:
        self._client = client
        self._on_sample = on_sample
        self._on_end = on_end
        self._fanout = client.subscribe(topic, None if type is None else type.name)
        self._is_open = True
        self.topic = self._fanout.topic
        history = self.history()
        self._fanout.take_samples(self._take, self._end)
        for sample in history:
            self._take(sample)

    @property
    def type(self) -> MessageType:
        return self._fanout.type

    def history(self) -> tuple[Sample, ...]:
        return self._fanout.subscription.history()

    def _take(self, sample: Sample) -> None:
        if not self._is_open:
            return
        monotonic = self._client.clock.monotonic
        began = monotonic()
        try:
            self._on_sample(sample)
        except InvalidMessage as error:
            logger.info("a message of %s was left out: %s", self.topic, error)
        self._client.work.add(monotonic() - began, "pages")

    def _end(self, reason: str) -> None:
        self.close()
        self._on_end(reason)

    def close(self) -> None:
        if self._is_open:
            self._is_open = False
            self._fanout.end_samples(self._take)
            self._client.unsubscribe(self._fanout)


class _ClientPublisher(api.Publisher):
    """Advertisement of a client."""

    def __init__(self, client: ClientGraph, topic: str, type: MessageType, qos: QoS) -> None:
        self._client = client
        self.topic = client.advertise(topic, type.name, self, None if qos == DEFAULT_QOS else qos)
        self.type = type
        self.qos = qos
        self._publisher = client.publisher(topic, type.name, self)

    @property
    def subscriber_count(self) -> int:
        info = self._client.topic(self.topic)
        return 0 if info is None else len(info.subscribers)

    def publish(self, payload: Payload) -> None:
        # Requested again for each message: the client may have another role meanwhile.
        publisher = self._client.publisher(self.topic, self.type.name, self)
        publisher.counts.received += 1
        publisher.counts.received_bytes += payload.size
        publisher.publish(payload)

    def close(self) -> None:
        self._client.unadvertise(self.topic, self)
