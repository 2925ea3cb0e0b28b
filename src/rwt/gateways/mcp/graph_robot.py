"""The graph as one client may see it, as the robot that tools use."""

from __future__ import annotations

import json
import logging
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AbstractContextManager
from functools import partial
from typing import TYPE_CHECKING, Any

from rwt.access.client_graph import ClientGraph
from rwt.gateways.mcp.robot import Named, Robot
from rwt_graph.api import ClientGoal, GoalEvents
from rwt_graph.names import resolve
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.api import Parameters
from rwt_participant.errors import (
    CallFailed,
    InvalidMessage,
    NotFound,
    ParameterRejected,
    ProviderNotFound,
    RobotError,
    ServiceFailed,
    UnknownType,
)
from rwt_participant.future import Future
from rwt_participant.goals import Goal, GoalResult, GoalStatus
from rwt_participant.handles import Handle, Publisher
from rwt_participant.messages import Message, MessageCallback, MessageLike, ParameterValue, to_payload
from rwt_participant.spelling import did_you_mean
from rwt_participant.transforms import Transforms

if TYPE_CHECKING:
    from rwt.access.client_graph import ClientPublisher
    from rwt.delivery.fanout import Fanout
    from rwt_graph.api import Sample
    from rwt_interfaces.payload import Payload

logger = logging.getLogger(__name__)

_ROSAPI = "/rosapi"
_ANSWER_SECONDS = 5.0

#: Seconds beyond a call's own time-out, which the graph keeps, in which a person may have said yes.
_GRACE_SECONDS = 0.5

#: Seconds in which a goal is taken, or a person's yes given.
_ACCEPT_SECONDS = 30.0


class GraphRobot(Robot):
    """A robot in this process, as one client may see it: each verb is one of :class:`ClientGraph`, so roles,
    quotas and whatever else stands there hold.

    Args:
        graph: the client's.
        ask_for_leave: see :meth:`pass_gate`; None where no gate is.
    """

    def __init__(
        self, graph: ClientGraph, ask_for_leave: Callable[[float], Awaitable[bool]] | None = None
    ) -> None:
        self._graph = graph
        self._ask_for_leave = ask_for_leave
        self._tf: Transforms | None = None
        self.params = RosapiParameters(self._ask)

    @property
    def tf(self) -> Transforms:  # noqa: D102 - inherited
        if self._tf is None:
            clock = self._graph.clock
            self._tf = Transforms(self.subscribe, self._latched, clock.time_ns, None, clock.within)
        return self._tf

    def close(self) -> None:
        """Let go of what is held of the graph, besides what handles hold; the client leaves it."""
        if self._tf is not None:
            self._tf.close()
        self._graph.close()

    def _latched(self, topic: str, type: str, /, *, latch: bool = False) -> Publisher:
        return self.advertise(topic, type)

    async def topics(self) -> tuple[Named, ...]:  # noqa: D102 - inherited
        name_of = self._graph.registry.type_name
        return tuple(
            Named(
                each.name,
                name_of(each.type) if each.type else "",
                len(each.publishers),
                len(each.subscribers),
            )
            for each in self._graph.topics()
        )

    async def services(self) -> tuple[Named, ...]:  # noqa: D102 - inherited
        name_of = self._graph.registry.type_name
        return tuple(Named(each.name, name_of(each.type)) for each in self._graph.services())

    async def actions(self) -> tuple[Named, ...]:  # noqa: D102 - inherited
        name_of = self._graph.registry.type_name
        return tuple(Named(each.name, name_of(each.type)) for each in self._graph.actions())

    async def type_of(self, topic: str) -> MessageType:  # noqa: D102 - inherited
        info = self._graph.topic(topic)
        if info is None or info.type is None:
            meant = did_you_mean(resolve(topic), (each.name for each in self._graph.topics()))
            raise NotFound(f"there is no topic {topic}{meant}")
        return info.type

    async def interface(self, name: str) -> MessageType | ServiceType | ActionType:  # noqa: D102 - inherited
        registry = self._graph.registry
        for find in (registry.message, registry.service, registry.action):
            try:
                return find(name)
            except UnknownType:
                continue
        raise UnknownType(f"no message, service or action of the name {name} is known")

    def subscribe(self, topic: str, callback: MessageCallback, type: str) -> Handle:  # noqa: D102 - inherited
        return _Subscription(self._graph, topic, callback, type)

    def advertise(self, topic: str, type: str) -> Publisher:  # noqa: D102 - inherited
        return _Publisher(self._graph, topic, type)

    async def call(self, service: str, request: MessageLike, seconds: float) -> Message:  # noqa: D102 - inherited
        return (await self._answer(service, request, seconds)).value()

    async def _answer(self, service: str, request: MessageLike, seconds: float) -> Payload:
        answer: Future[Payload] = Future()
        clock = self._graph.clock
        try:
            self._graph.call_service(
                service,
                lambda type: to_payload(type.request, request, clock.time_ns),
                answer.set,
                seconds,
            )
        except ProviderNotFound as error:
            meant = did_you_mean(resolve(service), (each.name for each in self._graph.services()))
            raise ProviderNotFound(f"{error}{meant}") from None
        await self.pass_gate()
        late = f"{service} has not answered, or nobody has given the yes that the gate wants,"
        return await answer.get(seconds + _GRACE_SECONDS, late, clock.within)

    async def _ask(self, question: str, request: Mapping[str, object]) -> dict[str, Any]:
        answer = await self._answer(f"{_ROSAPI}/{question}", request, _ANSWER_SECONDS)
        plain = answer.plain()
        return plain if isinstance(plain, dict) else {}

    async def send_goal(  # noqa: D102 - inherited
        self, action: str, goal: MessageLike, on_feedback: Callable[[Message], object]
    ) -> Goal:
        sent = _SentGoal(resolve(action), on_feedback, self._graph)
        try:
            sent.send(goal)
        except ProviderNotFound as error:
            meant = did_you_mean(resolve(action), (each.name for each in self._graph.actions()))
            raise ProviderNotFound(f"{error}{meant}") from None
        try:
            await self.pass_gate()
            late = (
                f"{action} has not taken the goal, or nobody has given the yes that the robot's gate wants,"
            )
            await sent.accepted.get(_ACCEPT_SECONDS, late, self._graph.clock.within)
        except BaseException:
            sent.cancel()
            raise
        return sent

    def cancel_goal(self, goal: Goal) -> None:  # noqa: D102 - inherited
        self._graph.cancel_goal(goal.action, goal.id)

    async def pass_gate(self, seconds: float = 0.0) -> bool:  # noqa: D102 - inherited
        return self._ask_for_leave is not None and await self._ask_for_leave(seconds)

    async def take_lease(self, topic: str) -> float | None:  # noqa: D102 - inherited
        # The first message takes it, or is refused where it is made.
        return self._graph.lease_seconds(topic)

    async def time_ns(self) -> int:  # noqa: D102 - inherited
        return self._graph.clock.time_ns()

    def monotonic(self) -> float:  # noqa: D102 - inherited
        return self._graph.clock.monotonic()

    async def sleep(self, seconds: float) -> None:  # noqa: D102 - inherited
        await self._graph.clock.sleep(seconds)

    def within(self, seconds: float | None) -> AbstractContextManager[object]:  # noqa: D102 - inherited
        return self._graph.clock.within(seconds)


class _Subscription(Handle):
    """One subscription of a client; its work is the client's."""

    def __init__(self, graph: ClientGraph, topic: str, callback: MessageCallback, type: str) -> None:
        self._graph = graph
        self._callback = callback
        self._fanout: Fanout | None = graph.subscribe(topic, type)
        self.name = self._fanout.topic
        history = self._fanout.subscription.history()
        self._stream = self._fanout.take_samples(self._take)
        for sample in history:
            self._take(sample)

    def _take(self, sample: Sample) -> None:
        if self._fanout is None:
            return
        monotonic = self._graph.clock.monotonic
        began = monotonic()
        try:
            message = sample.payload.value()
        except InvalidMessage as error:
            logger.info("a message of %s was left out: %s", self.name, error)
        else:
            self._callback(message)
        self._graph.work.add(monotonic() - began, "pages")

    def close(self) -> None:
        fanout, self._fanout = self._fanout, None
        if fanout is not None:
            fanout.end_samples(self._stream)
            self._graph.unsubscribe(fanout)


class _Publisher(Publisher):
    """One advertisement of a client."""

    def __init__(self, graph: ClientGraph, topic: str, type: str) -> None:
        self._graph = graph
        self.name = graph.advertise(topic, type, self)
        self._publisher: ClientPublisher = graph.publisher(topic, type, self)

    def publish(self, message: MessageLike) -> None:
        payload = to_payload(self._publisher.type, message, self._graph.clock.time_ns)
        # Asked for each time: meanwhile the role may have become another.
        self._publisher = self._graph.publisher(self.name, self._publisher.type.name, self)
        self._publisher.counts.received += 1
        self._publisher.counts.received_bytes += payload.size
        self._publisher.publish(payload)

    def close(self) -> None:
        self._graph.unadvertise(self.name, self)


class _SentGoal(Goal):
    """A goal of a client, which goes on when the client has left."""

    def __init__(self, action: str, on_feedback: Callable[[Message], object], graph: ClientGraph) -> None:
        super().__init__(action, "", on_feedback, graph.clock.within)
        self._graph = graph
        self._goal: ClientGoal | None = None
        self.accepted: Future[None] = Future()

    def send(self, goal: MessageLike) -> None:
        """Send it; raises what :meth:`ClientGraph.send_goal` does."""
        now = self._graph.clock.time_ns
        events = GoalEvents(self._on_result, self._on_feedback_payload, partial(self.accepted.set, None))
        self._goal = self._graph.send_goal(self.action, lambda type: to_payload(type.goal, goal, now), events)
        self.id = self._goal.id

    @property
    def status(self) -> GoalStatus:
        """The last state that the server reported."""
        return self._status if self.done or self._goal is None else self._goal.status

    def cancel(self) -> None:
        """Ask the server to cancel; a goal that waits for a yes is not sent."""
        if self._goal is not None and not self.done:
            self._goal.cancel()

    def _on_feedback_payload(self, feedback: Payload) -> None:
        try:
            message = feedback.value()
        except InvalidMessage as error:
            logger.info("feedback of %s was left out: %s", self.action, error)
        else:
            self.take_feedback(message)

    def _on_result(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        reason = "" if self._goal is None else self._goal.reason
        if isinstance(outcome, CallFailed):
            self.end(outcome, reason)
            self.accepted.set(outcome)
            return
        try:
            self.end(GoalResult(status, outcome.value()), reason)
        except InvalidMessage as error:
            self.end(error, reason)
        self.accepted.set(None)


class RosapiParameters(Parameters):
    """The parameters of all nodes, by the services of rosapi, which show of them what the role may see.

    Args:
        ask: asks one of its services, by the last part of the name.
    """

    def __init__(self, ask: Callable[[str, Mapping[str, object]], Any]) -> None:
        self._ask = ask

    async def get(self, name: str, default: ParameterValue = None) -> ParameterValue:  # noqa: D102 - inherited
        try:
            answer = await self._asked("get_param", NotFound, name=name)
        except ProviderNotFound:
            raise
        except NotFound as error:
            if default is not None:
                return default
            raise NotFound(f"{error}{await self._meant(name)}") from None
        value: ParameterValue = json.loads(answer.get("value") or "null")
        if value is None and default is None:
            raise NotFound(f"there is no parameter {name}{await self._meant(name)}")
        return default if value is None else value

    async def set(self, name: str, value: ParameterValue) -> None:  # noqa: D102 - inherited
        await self._asked("set_param", ParameterRejected, name=name, value=json.dumps(value))

    async def has(self, name: str) -> bool:  # noqa: D102 - inherited
        return bool((await self._asked("has_param", ServiceFailed, name=name)).get("exists"))

    async def delete(self, name: str) -> None:  # noqa: D102 - inherited
        await self._asked("delete_param", ParameterRejected, name=name)

    async def names(self) -> tuple[str, ...]:  # noqa: D102 - inherited
        return tuple(map(str, (await self._asked("get_param_names", ServiceFailed)).get("names", ())))

    async def _meant(self, name: str) -> str:
        return did_you_mean(name, await self.names())

    async def _asked(self, question: str, refused: type[RobotError], **args: object) -> dict[str, Any]:
        try:
            answer: dict[str, Any] = await self._ask(question, args)
        except ServiceFailed as error:
            raise refused(str(error)) from None
        if answer.get("successful") is False:
            reason = str(answer.get("reason") or f"{question} of {args.get('name', '')} was refused")
            raise refused(reason)
        return answer
