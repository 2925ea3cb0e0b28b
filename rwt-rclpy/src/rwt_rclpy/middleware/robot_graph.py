"""The graph of a server in another process, over rosbridge: what nodes here do is done there.

Messages of topics go to the server and come back from it, also those between nodes of this process, so that
each is delivered once. Services and actions of this process are served here at once and offered there; others
are called there. Feedback of an action of this process is delivered here at once, too, as its results are,
which would overtake it: a client wants none after the result. What is listed is asked of the server's rosapi,
as long as somebody asks here.

Four things rosbridge has no way to say: which node of this process does something (the server knows one
client), the quality of service of others' endpoints (the default is assumed), which goal ids are in use, and
that a goal of somebody else be cancelled.
"""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AsyncExitStack
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Self
from uuid import uuid4

import anyio

from rwt_client.connection import connect
from rwt_graph.api import (
    ActionInfo,
    ClientGoal,
    EndpointInfo,
    GoalEvents,
    NodeInfo,
    OnReply,
    PendingCall,
    Publisher,
    Sample,
    ServiceInfo,
    Subscription,
    TopicInfo,
)
from rwt_graph.memory.graph import MemoryGraph, MemoryParticipant
from rwt_graph.memory.node_resources import NodeResources
from rwt_graph.memory.services import MemoryCall, MemoryProvider
from rwt_graph.names import validate
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, CallTimeout, GoalAborted, GoalCanceled, NotFound, RobotError
from rwt_participant.goals import Goal, GoalStatus, ReceivedGoal
from rwt_participant.qos import BEST_AVAILABLE, DEFAULT_QOS, Durability, QoS

if TYPE_CHECKING:
    from rwt_client.endpoints.raw_subscription import RawMessage, RawSubscription
    from rwt_client.robot import Robot
    from rwt_graph.memory.actions import MemoryActionServer
    from rwt_interfaces.registry import Registry
    from rwt_interfaces.structs import MessageType

logger = logging.getLogger(__name__)

#: Seconds between two looks at what the server lists, while somebody asks.
LOOK_SECONDS: Final = 0.1
#: Seconds after which nobody is taken to ask any more.
ASKED_SECONDS: Final = 2.0
#: How the names of topics end whose messages must not come after what a service of the same action answers.
_TOLD_HERE: Final = "/_action/feedback"


class RobotTopic:
    """One topic of the server, for all that subscribe to it here."""

    def __init__(self, graph: RobotGraph, name: str, type: MessageType) -> None:
        self.name = name
        self.type = type
        self.subscriptions: tuple[RobotSubscription, ...] = ()
        self.last: Sample | None = None
        self._graph = graph
        self._raw: RawSubscription = graph.robot.subscribe_raw(
            name, self._receive, graph.registry.type_name(type)
        )

    def _receive(self, message: RawMessage) -> None:
        if self.name in self._graph.told_here:
            return  # Delivered when it was published; this is the echo.
        now = self._graph.clock.time_ns() if message.stamp_ns is None else message.stamp_ns
        self.deliver(Sample(self.name, Payload.from_cdr(self.type, message.data), now, ""))

    def deliver(self, sample: Sample) -> None:
        """Hand a message to all that subscribe here."""
        self.last = sample.detach()
        for subscription in self.subscriptions:
            try:
                subscription.on_sample(sample)
            except Exception:
                logger.exception("a subscriber of %s failed", self.name)

    def close(self) -> None:
        """Subscribe no more."""
        self._raw.close()


class RobotSubscription(Subscription):
    """A subscription of this process to a topic of the server."""

    def __init__(
        self, graph: RobotGraph, topic: RobotTopic, on_sample: Callable[[Sample], None], owner: NodeResources
    ) -> None:
        self.topic = topic.name
        self.on_sample = on_sample
        self._graph = graph
        self._topic = topic
        self._owner = owner

    @property
    def type(self) -> MessageType | None:
        """The topic's type."""
        return self._topic.type

    def history(self) -> tuple[Sample, ...]:
        """The last message that has come."""
        return () if self._topic.last is None else (self._topic.last,)

    def close(self) -> None:
        """Leave the topic."""
        topic = self._topic
        topic.subscriptions = tuple(each for each in topic.subscriptions if each is not self)
        self._owner.drop(self)
        if not topic.subscriptions and self._graph.topics_here.get(topic.name) is topic:
            del self._graph.topics_here[topic.name]
            topic.close()


class RobotPublisher(Publisher):
    """A publisher of this process on a topic of the server."""

    def __init__(
        self, graph: RobotGraph, topic: str, type: MessageType, qos: QoS, owner: NodeResources
    ) -> None:
        self.topic = topic
        self.type = type
        self.qos = qos
        self._graph = graph
        self._owner = owner
        latch = qos.durability is Durability.TRANSIENT_LOCAL
        self._remote = graph.robot.advertise(topic, graph.registry.type_name(type), latch=latch, qos=qos)
        self._tells_here = topic.endswith(_TOLD_HERE)
        if self._tells_here:
            graph.told_here[topic] += 1

    def publish(self, payload: Payload) -> None:
        """Send one message; one that cannot be sent is logged."""
        topic = self._graph.topics_here.get(self.topic) if self._tells_here else None
        if topic is not None:
            topic.deliver(Sample(self.topic, payload, self._graph.clock.time_ns(), self._owner.name))
        try:
            self._remote.publish(payload)
        except RobotError as error:
            logger.warning("a message on %s is lost: %s", self.topic, error)

    @property
    def subscriber_count(self) -> int:
        """How many nodes subscribe to the topic, as the server said last."""
        info = self._graph.topic(self.topic)
        return 0 if info is None else len(info.subscribers)

    def close(self) -> None:
        """Leave the topic."""
        self._owner.drop(self)
        if self._tells_here:
            self._tells_here = False
            self._graph.told_here -= Counter((self.topic,))
        self._remote.close()


class RobotParticipant(MemoryParticipant):
    """A node of this process, whose topics are the server's."""

    _graph: RobotGraph

    def advertise(self, topic: str, type: MessageType, qos: QoS = DEFAULT_QOS) -> Publisher:
        """Become a publisher of `topic`; the server refuses another type, and its log says so."""
        self._check_open()
        publisher = RobotPublisher(self._graph, validate(topic), type, qos, self.owner)
        self.owner.add(publisher, publisher.close)
        return publisher

    def subscribe(
        self,
        topic: str,
        on_sample: Callable[[Sample], None],
        type: MessageType | None = None,
        qos: QoS = BEST_AVAILABLE,
    ) -> Subscription:
        """Become a subscriber of `topic`. Raises NotFound without a type while the topic is not listed."""
        self._check_open()
        graph, name = self._graph, validate(topic)
        info = graph.topic(name) if type is None else None
        wanted = type if info is None else info.type
        if wanted is None:
            raise NotFound(f"the server does not list {name}: give the type of its messages")
        known = graph.topics_here.get(name)
        if known is None:
            known = graph.topics_here[name] = RobotTopic(graph, name, wanted)
        subscription = RobotSubscription(graph, known, on_sample, self.owner)
        known.subscriptions = (*known.subscriptions, subscription)
        self.owner.add(subscription, subscription.close)
        if qos.durability is Durability.TRANSIENT_LOCAL and known.last is not None:
            on_sample(known.last)
        return subscription


class RobotGraph(MemoryGraph):
    """A graph whose topics, services and actions are those of a server in another process.

    It must be entered before nodes join it.

    Args:
        url: of the server, as :func:`rwt_client.connect` takes it: ``ws://``, ``unix:///path`` and others.
        registry: the interfaces; the standard ones of jazzy by default.
        timeout: seconds to connect in.

    Attributes:
        robot: the connection.
        topics_here: the topics that are subscribed to in this process.
        told_here: how many publishers here deliver to them at once, by the name of the topic.
    """

    robot: Robot

    def __init__(self, url: str, registry: Registry | None = None, *, timeout: float = 10.0) -> None:
        self.url = url
        self.topics_here: dict[str, RobotTopic] = {}
        self.told_here: Counter[str] = Counter()
        self._timeout = timeout
        self._connection = AsyncExitStack()
        self._caller = NodeResources("/_server", private=True)
        super().__init__(registry)
        self._listing = Listing(self)
        self.service_table.remote = RobotServices(self)
        self.action_table.remote = RobotActions(self)

    async def __aenter__(self) -> Self:
        """Connect, and run on the current event loop.

        Raises:
            BadAddress: the URL is not one to connect to.
            CannotConnect: there is no connection; says why.
        """
        await super().__aenter__()
        try:
            self.robot = await self._connection.enter_async_context(
                connect(self.url, timeout=self._timeout, ros_version=2, fetch_types=False)
            )
        except BaseException:
            await super().__aexit__()
            raise
        self.spawn(self._listing.follow, "listing")
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Stop handlers, close every participant and the connection."""
        self._close_participants()
        try:
            await self._connection.aclose()
        finally:
            await super().__aexit__(*exc)

    def make_participant(self, name: str) -> MemoryParticipant:
        """A node whose topics are the server's."""
        return RobotParticipant(self, name)

    def offer_action_services(
        self, participant: MemoryParticipant, server: MemoryActionServer
    ) -> Callable[[], None]:
        """Offer an action of this process on the server; returns what withdraws it."""
        offered = self.robot.advertise_action(
            server.name, self.registry.type_name(server.type), partial(self._execute, server)
        )
        return offered.close

    async def _execute(self, server: MemoryActionServer, goal: ReceivedGoal) -> Payload:
        """Have a goal of a client of the server worked on here."""
        ended = anyio.Event()
        outcome: list[tuple[GoalStatus, Payload | CallFailed]] = []

        def on_result(status: GoalStatus, result: Payload | CallFailed) -> None:
            outcome.append((status, result))
            ended.set()

        def on_feedback(feedback: Payload) -> None:
            goal.publish_feedback(feedback)

        theirs = await self.robot.types.action(self.registry.type_name(server.type))
        payload = self.read(server.type.goal, theirs.goal, goal.request)
        events = GoalEvents(on_result, on_feedback)
        sent = self.action_table.send_here(server, payload, events, uuid4().hex, self._caller)
        async with anyio.create_task_group() as group:

            async def cancel() -> None:
                await goal.cancel_event.wait()
                sent.cancel()

            group.start_soon(cancel)
            await ended.wait()
            group.cancel_scope.cancel()
        status, result = outcome[0]
        if isinstance(result, CallFailed):
            raise result
        if status is GoalStatus.CANCELED:
            raise GoalCanceled(result)
        if status is GoalStatus.ABORTED:
            raise GoalAborted(result)
        return result

    def read(self, ours: MessageType, theirs: MessageType, message: Any) -> Payload:
        """A message of the connection's class of a type as a payload of the class here of the same type."""
        return Payload.from_cdr(ours, theirs.serialise(message))

    # What is listed

    @property
    def version(self) -> int:
        """Grows with every change of what is listed."""
        return super().version + self._listing.version

    def topics(self) -> tuple[TopicInfo, ...]:
        """Every topic of the server, sorted by name."""
        return self._listing.topics()

    def topic(self, name: str) -> TopicInfo | None:
        """One topic of the server, or None; who takes part in it is known a moment after it is asked."""
        return self._listing.topic(name)

    def nodes(self) -> tuple[NodeInfo, ...]:
        """The nodes of the server and of this process, sorted by name."""
        own = {each.name: each for each in super().nodes()}
        found = {**self._listing.nodes(), **own}
        return tuple(found[name] for name in sorted(found))


class Listing:
    """What the server's rosapi lists, looked at while somebody asks."""

    def __init__(self, graph: RobotGraph) -> None:
        self.version = 0
        self._graph = graph
        self._asked_at = float("-inf")
        self._awake = anyio.Event()
        self._topics: dict[str, str] = {}
        self._ends: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {}
        self._services: dict[str, str] = {}
        self._actions: dict[str, str] = {}
        self._nodes: tuple[str, ...] = ()

    def asked(self) -> None:
        """Somebody wants to know: look now and for a while."""
        self._asked_at = time.monotonic()
        self._awake.set()

    async def follow(self) -> None:
        """Look again and again, while somebody asks."""
        while True:
            if time.monotonic() - self._asked_at > ASKED_SECONDS:
                self._awake = anyio.Event()
                await self._awake.wait()
            try:
                await self._look()
            except (RobotError, CallTimeout) as error:
                logger.debug("the server does not list what it has: %s", error)
            await anyio.sleep(LOOK_SECONDS)

    async def _look(self) -> None:
        api = self._graph.robot.api
        before = (self._topics, self._services, self._actions, self._nodes)
        self._topics = {each.name: each.type for each in await api.topics()}
        services = await api.services()
        self._services = {name: self._services.get(name) or await api.service_type(name) for name in services}
        actions = await api.action_servers()
        self._actions = {name: self._actions.get(name) or await self._action_type(name) for name in actions}
        self._nodes = await api.nodes()
        for name in tuple(self._ends):
            self._ends[name] = (await api.publishers(name), await api.subscribers(name))
        if before != (self._topics, self._services, self._actions, self._nodes):
            self.version += 1

    async def _action_type(self, name: str) -> str:
        try:
            return await self._graph.robot.api.action_type(name)
        except CallFailed:
            return ""  # A rosapi that does not know of actions' types.

    def topics(self) -> tuple[TopicInfo, ...]:
        """Every topic."""
        self.asked()
        return tuple(self._info(name) for name in sorted(self._topics))

    def topic(self, name: str) -> TopicInfo | None:
        """One topic, or None."""
        self.asked()
        self._ends.setdefault(name, ((), ()))
        return self._info(name) if name in self._topics else None

    def _info(self, name: str) -> TopicInfo:
        written = self._topics[name]
        publishers, subscribers = self._ends.get(name, ((), ()))
        return TopicInfo(
            name,
            _known(self._graph.registry.message, written),
            tuple(EndpointInfo(node, written, DEFAULT_QOS) for node in publishers),
            tuple(EndpointInfo(node, written, DEFAULT_QOS) for node in subscribers),
        )

    def service(self, name: str) -> ServiceInfo | None:
        """One service of the server, or None."""
        self.asked()
        type = _known(self._graph.registry.service, self._services.get(name, ""))
        return None if type is None else ServiceInfo(name, type, "")

    def service_names(self) -> set[str]:
        """Every service of the server whose type is known here."""
        self.asked()
        known = self._graph.registry.service
        return {name for name, type in self._services.items() if _known(known, type) is not None}

    def action(self, name: str) -> ActionInfo | None:
        """One action of the server, or None."""
        self.asked()
        type = _known(self._graph.registry.action, self._actions.get(name, ""))
        return None if type is None else ActionInfo(name, type, "")

    def action_names(self) -> set[str]:
        """Every action of the server whose type is known here."""
        self.asked()
        known = self._graph.registry.action
        return {name for name, type in self._actions.items() if _known(known, type) is not None}

    def nodes(self) -> dict[str, NodeInfo]:
        """The nodes of the server; what each takes part in is not asked."""
        self.asked()
        return {name: NodeInfo(name, (), (), (), ()) for name in self._nodes}


def _known(find: Callable[[str], Any], name: str) -> Any:
    try:
        return find(name) if name else None
    except InterfaceError:
        return None


class RobotServices:
    """Offers the services of this process on the server, and calls the server's; see `RemoteServices`."""

    def __init__(self, graph: RobotGraph) -> None:
        self._graph = graph
        self._offered: dict[MemoryProvider, Any] = {}

    def offered(self, provider: MemoryProvider) -> None:
        """Offer a service on the server, unless it is part of an action, which is offered as a whole."""
        if provider.owner.private or "/_action/" in provider.name:
            return
        graph = self._graph
        self._offered[provider] = graph.robot.advertise_service(
            provider.name, graph.registry.type_name(provider.type), partial(self._answer, provider)
        )

    async def _answer(self, provider: MemoryProvider, request: Any) -> Payload:
        answered = anyio.Event()
        answers: list[Payload | CallFailed] = []

        def on_reply(answer: Payload | CallFailed) -> None:
            answers.append(answer.detach() if isinstance(answer, Payload) else answer)
            answered.set()

        graph = self._graph
        theirs = await graph.robot.types.service(graph.registry.type_name(provider.type))
        payload = graph.read(provider.type.request, theirs.request, request)
        call = MemoryCall(provider.name, payload, on_reply)
        provider.on_call(call)
        await answered.wait()
        if isinstance(answers[0], CallFailed):
            raise answers[0]
        return answers[0]

    def withdrawn(self, provider: MemoryProvider) -> None:
        """Withdraw a service from the server."""
        server = self._offered.pop(provider, None)
        if server is not None:
            server.close()

    def info(self, name: str) -> ServiceInfo | None:
        """One service of the server, or None."""
        return self._graph._listing.service(name)

    def names(self) -> set[str]:
        """The names of the server's services."""
        return self._graph._listing.service_names()

    def by_node(self) -> Iterator[tuple[str, str]]:
        """Nothing: whose services they are is not asked."""
        return iter(())

    def call(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: NodeResources
    ) -> PendingCall:
        """Call a service of the server."""
        call = MemoryCall(name, request, on_reply)
        detached = request.detach()
        self._graph.spawn(partial(self._call, call, detached, timeout), f"call of {name}")
        return call

    async def _call(self, call: MemoryCall, request: Payload, seconds: float | None) -> None:
        graph = self._graph
        name = request.type.name.removesuffix("_Request")
        try:
            theirs = await graph.robot.types.service(name)
            answer = await graph.robot.call(call.service, request, name, timeout=seconds)
        except CallFailed as error:
            call.end_with(error)
        except RobotError as error:
            call.fail(str(error))
        else:
            call.reply(graph.read(graph.registry.service(name).response, theirs.response, answer))


class RobotClientGoal(ClientGoal):
    """A goal of this process for an action of the server."""

    def __init__(self, action: str, goal_id: str) -> None:
        self.id = goal_id
        self.action = action
        self.sent: Goal | None = None
        self.events: GoalEvents | None = None
        self._cancelled = False

    @property
    def status(self) -> GoalStatus:
        """The last state that was heard of."""
        return GoalStatus.UNKNOWN if self.sent is None else self.sent.status

    @property
    def reason(self) -> str:
        """Why the server ended the goal as it did."""
        return "" if self.sent is None else self.sent.reason

    def take(self, sent: Goal) -> None:
        """The goal was sent; a cancel that came early follows it."""
        self.sent = sent
        if self._cancelled:
            sent.cancel()

    def cancel(self) -> None:
        """Ask the server to cancel."""
        self._cancelled = True
        if self.sent is not None and not self.sent.done:
            self.sent.cancel()

    def abandon(self) -> None:
        """Drop the goal's callbacks; it goes on."""
        self.events = None


class RobotActions:
    """Sends goals to the server's actions; see `RemoteActions`."""

    def __init__(self, graph: RobotGraph) -> None:
        self._graph = graph

    def info(self, name: str) -> ActionInfo | None:
        """One action of the server, or None."""
        return self._graph._listing.action(name)

    def names(self) -> set[str]:
        """The names of the server's actions."""
        return self._graph._listing.action_names()

    def by_node(self) -> Iterator[tuple[str, str]]:
        """Nothing: whose actions they are is not asked."""
        return iter(())

    def send(
        self, action: str, payload: Payload, events: GoalEvents, goal_id: str, client: NodeResources
    ) -> ClientGoal:
        """Send a goal to the server."""
        goal = RobotClientGoal(action, goal_id)
        goal.events = events
        self._graph.spawn(partial(self._send, goal, payload.detach()), f"goal of {action}")
        return goal

    async def _send(self, goal: RobotClientGoal, payload: Payload) -> None:
        graph = self._graph
        name = payload.type.name.removesuffix("_Goal")
        type = graph.registry.action(name)

        def on_feedback(message: Any) -> None:
            if goal.events is not None and goal.events.on_feedback is not None:
                goal.events.on_feedback(graph.read(type.feedback, theirs.feedback, message))

        outcome: Payload | CallFailed
        status = GoalStatus.ABORTED
        try:
            theirs = await graph.robot.types.action(name)
            sent = await graph.robot.send_goal(goal.action, payload, name, on_feedback=on_feedback)
            goal.take(sent)
            if goal.events is not None and goal.events.on_accepted is not None:
                goal.events.on_accepted()
            status, result = await sent.result()
            outcome = graph.read(type.result, theirs.result, result)
        except CallFailed as error:
            outcome = error
        except RobotError as error:
            outcome = CallFailed(str(error))
        if goal.events is not None:
            goal.events.on_result(status, outcome)

    def cancel(self, action: str, goal_id: str, client: NodeResources) -> None:
        """Nothing: rosbridge cancels the goals of its own clients alone, through their handles."""
        logger.warning(
            "the goal %s of %s cannot be cancelled over rosbridge: it is somebody else's", goal_id, action
        )

    def cancel_every(self, action: str, client: NodeResources) -> None:
        """Nothing, as for :meth:`cancel`."""
        logger.warning(
            "the goals of %s cannot be cancelled over rosbridge: they may be somebody else's", action
        )
