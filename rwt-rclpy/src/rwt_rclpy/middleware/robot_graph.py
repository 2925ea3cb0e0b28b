"""Graph of a server in another process, over rosbridge.

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
from collections.abc import Callable, Iterator, Sequence
from contextlib import AsyncExitStack
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import anyio

from rwt_client import RawMessage, RawSubscription, Robot, connect
from rwt_graph import MemoryGraph
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
from rwt_graph.backend import (
    MemoryActionServer,
    MemoryCall,
    MemoryParticipant,
    MemoryProvider,
    NodeResources,
    RemoteActions,
    RemoteServices,
)
from rwt_graph.names import validate
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.payload import Payload
from rwt_participant.errors import (
    CallFailed,
    CallTimeout,
    GoalAborted,
    GoalCanceled,
    NotFound,
    RobotError,
)
from rwt_participant.goals import Goal, GoalStatus, ReceivedGoal
from rwt_participant.handles import Handle
from rwt_participant.qos import BEST_AVAILABLE, DEFAULT_QOS, Durability, QoS

if TYPE_CHECKING:
    from rwt_interfaces.registry import Registry
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType

logger = logging.getLogger(__name__)

#: Polling interval of the server's listings while they are in use, in seconds.
LOOK_SECONDS: Final = 0.1
#: Time after which unused listings are not polled any more, in seconds.
ASKED_SECONDS: Final = 2.0
#: Suffixes of topics whose messages must not arrive after a response of the same action.
_TOLD_HERE: Final = "/_action/feedback"
_FOR_CLIENTS: Final = "/_server"


class RobotTopic:
    """Topic of the server, for all subscriptions of this process."""

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
            return  # Delivered when it was published; this is its echo.
        now = self._graph.clock.time_ns() if message.stamp_ns is None else message.stamp_ns
        self.deliver(Sample(self.name, Payload.from_cdr(self.type, message.data), now, ""))

    def deliver(self, sample: Sample) -> None:
        """Deliver a message to all subscriptions of this process."""
        self.last = sample.detach()
        for subscription in self.subscriptions:
            try:
                subscription.on_sample(sample)
            except Exception:
                logger.exception("a subscriber of %s failed", self.name)

    def close(self) -> None:
        """Unsubscribe."""
        self._raw.close()


class RobotSubscription(Subscription):
    """Subscription of this process to a topic of the server."""

    def __init__(
        self,
        graph: RobotGraph,
        topic: RobotTopic,
        on_sample: Callable[[Sample], None],
        owner: NodeResources,
    ) -> None:
        self.topic = topic.name
        self.on_sample = on_sample
        self._graph = graph
        self._topic = topic
        self._owner = owner

    @property
    def type(self) -> MessageType | None:
        """Type of the topic."""
        return self._topic.type

    def history(self) -> tuple[Sample, ...]:
        """Return the last received message."""
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
    """Publisher of this process on a topic of the server."""

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
        """Send one message; failures are logged."""
        topic = self._graph.topics_here.get(self.topic) if self._tells_here else None
        if topic is not None:
            topic.deliver(Sample(self.topic, payload, self._graph.clock.time_ns(), self._owner.name))
        try:
            self._remote.publish(payload)
        except RobotError as error:
            logger.warning("a message on %s is lost: %s", self.topic, error)

    @property
    def subscriber_count(self) -> int:
        """Number of subscribers of the topic, as the server last reported it."""
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
    """Node of this process, whose topics are the server's."""

    graph: RobotGraph

    def advertise(self, topic: str, type: MessageType, qos: QoS = DEFAULT_QOS) -> Publisher:
        """Become a publisher of `topic`; the server rejects another type, and logs this."""
        self._check_open()
        publisher = RobotPublisher(self.graph, validate(topic), type, qos, self.owner)
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
        graph, name = self.graph, validate(topic)
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


class RobotServices(RemoteServices):
    """Services of the server, on which those of this process are offered, except parts of actions.

    Attributes:
        types: types by name, as the server lists them.
    """

    def __init__(self, graph: RobotGraph) -> None:
        self.types: dict[str, str] = {}
        self._graph = graph
        self._offered: dict[MemoryProvider, Handle] = {}

    def offered(self, provider: MemoryProvider) -> None:
        """Offer a service of this process on the server."""
        if "/_action/" not in provider.name:
            answer = partial(self._graph.answer, provider.name, provider.type)
            name = self._graph.registry.type_name(provider.type)
            self._offered[provider] = self._graph.robot.advertise_service(provider.name, name, answer)

    def withdrawn(self, provider: MemoryProvider) -> None:
        """Withdraw a service on the server."""
        offered = self._offered.pop(provider, None)
        if offered is not None:
            offered.close()

    def names(self) -> set[str]:
        """Return the names of the server's services."""
        return set(self.types)

    def by_node(self) -> Iterator[tuple[str, str]]:
        """Yield nothing: nodes of the server are listed without their services."""
        return iter(())

    def info(self, name: str) -> ServiceInfo | None:
        """Return a service of the server; None if it or its type is unknown."""
        self._graph.listing.asked()
        type = _known(self._graph.registry.service, self.types.get(name, ""))
        return None if type is None else ServiceInfo(name, type, "")

    def call(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: NodeResources
    ) -> PendingCall:
        """Call a service of the server."""
        call = MemoryCall(name, request.detach(), on_reply)
        self._graph.spawn(partial(self._graph.call, call, timeout), f"call of {name}")
        return call


class RobotActions(RemoteActions):
    """Actions of the server, on which the newest one of this process with each name is offered.

    Attributes:
        types: types by name, as the server lists them.
    """

    def __init__(self, graph: RobotGraph) -> None:
        self.types: dict[str, str] = {}
        self._graph = graph
        self._offered: dict[str, tuple[MemoryActionServer, Handle]] = {}

    def renew(self, name: str) -> None:
        """Offer the current action of a name, and withdraw another one."""
        graph, present = self._graph, self._offered.get(name)
        current = graph.action_table.current.get(name)
        if present is not None and present[0] is current:
            return
        if present is not None:
            present[1].close()
            del self._offered[name]
        if current is not None:
            execute = partial(graph.execute, name, current.type)
            handle = graph.robot.advertise_action(name, graph.registry.type_name(current.type), execute)
            self._offered[name] = current, handle

    def names(self) -> set[str]:
        """Return the names of the server's actions."""
        return set(self.types)

    def by_node(self) -> Iterator[tuple[str, str]]:
        """Yield nothing: nodes of the server are listed without their actions."""
        return iter(())

    def info(self, name: str) -> ActionInfo | None:
        """Return an action of the server; None if it or its type is unknown."""
        self._graph.listing.asked()
        type = _known(self._graph.registry.action, self.types.get(name, ""))
        return None if type is None else ActionInfo(name, type, "")

    def send(
        self, action: str, payload: Payload, events: GoalEvents, goal_id: str, client: NodeResources
    ) -> ClientGoal:
        """Send a goal to the server."""
        sent = RobotClientGoal(action, goal_id, events)
        self._graph.spawn(partial(self._graph.send_goal, sent, payload.detach()), f"goal of {action}")
        return sent

    def cancel(self, action: str, goal_id: str, client: NodeResources) -> None:
        """Log that this is not possible: over rosbridge only the sender of a goal can cancel it."""
        logger.warning(
            "the goal %s of %s cannot be cancelled over rosbridge: it is somebody else's", goal_id, action
        )

    def cancel_every(self, action: str, client: NodeResources) -> None:
        """Log that this is not possible; see :meth:`cancel`."""
        logger.warning(
            "the goals of %s cannot be cancelled over rosbridge: they may be somebody else's", action
        )


class RobotGraph(MemoryGraph):
    """Graph whose topics, services and actions are those of a server in another process.

    It must be entered before nodes join it. Services and actions of this process answer calls between its
    nodes, and those that come from the server.

    Args:
        url: URL of the server for :func:`rwt_client.connect`: ``ws://``, ``unix:///path`` and others.
        registry: interfaces; the standard ones of jazzy by default.
        timeout: timeout of connecting in seconds.

    Attributes:
        robot: connection.
        listing: what the server has.
        topics_here: topics that are subscribed to in this process.
        told_here: number of publishers in this process whose messages are delivered here at once, by topic.
    """

    robot: Robot

    def __init__(self, url: str, registry: Registry | None = None, *, timeout: float = 10.0) -> None:
        super().__init__(registry)
        self._connecting = connect(url, timeout=timeout, ros_version=2, fetch_types=False)
        self._connection = AsyncExitStack()
        self._actions = RobotActions(self)
        self.action_table.remote = self._actions
        self.service_table.remote = services = RobotServices(self)
        self.listing = Listing(self, services, self._actions)
        self.topics_here: dict[str, RobotTopic] = {}
        self.told_here: Counter[str] = Counter()
        # Participant that calls and sends goals for clients of the server; not listed.
        self._for_clients = MemoryParticipant(self, _FOR_CLIENTS, private=True)

    async def _join(self) -> None:
        """Connect.

        Raises:
            BadAddress: the URL is invalid for connecting.
            CannotConnect: the connection failed; the text gives the reason.
        """
        self.robot = await self._connection.enter_async_context(self._connecting)
        self.spawn(self.listing.follow, "listing")

    async def __aexit__(self, *exc: object) -> None:
        """Close every participant and the connection, and stop handlers."""
        self._close_participants()
        try:
            await self._connection.aclose()
        finally:
            await super().__aexit__(*exc)

    def make_participant(self, name: str) -> RobotParticipant:
        """Return a new node, whose topics are the server's."""
        return RobotParticipant(self, name)

    # Offered on the server

    def offer_action_services(
        self, participant: MemoryParticipant, server: MemoryActionServer
    ) -> Callable[[], None]:
        """Offer an action on the server, too."""
        withdraw = super().offer_action_services(participant, server)
        self._actions.renew(server.name)

        def close() -> None:
            withdraw()
            self._actions.renew(server.name)

        return close

    async def answer(self, name: str, type: ServiceType, request: Any) -> Payload:
        """Answer a call of a client of the server."""
        answered = anyio.Event()
        answers: list[Payload | CallFailed] = []

        def on_reply(answer: Payload | CallFailed) -> None:
            answers.append(answer.detach() if isinstance(answer, Payload) else answer)
            answered.set()

        theirs = await self.robot.types.service(self.registry.type_name(type))
        payload = self.read(type.request, theirs.request, request)
        self._for_clients.call_service(name, payload, on_reply)
        await answered.wait()
        if isinstance(answers[0], CallFailed):
            raise answers[0]
        return answers[0]

    async def execute(self, name: str, type: ActionType, goal: ReceivedGoal) -> Payload:
        """Run a goal of a client of the server in this process."""
        ended = anyio.Event()
        outcome: list[tuple[GoalStatus, Payload | CallFailed]] = []

        def on_result(status: GoalStatus, result: Payload | CallFailed) -> None:
            outcome.append((status, result))
            ended.set()

        def on_feedback(feedback: Payload) -> None:
            goal.publish_feedback(feedback)

        theirs = await self.robot.types.action(self.registry.type_name(type))
        payload = self.read(type.goal, theirs.goal, goal.request)
        sent = self._for_clients.send_goal(name, payload, GoalEvents(on_result, on_feedback))
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

    # Called on the server

    async def call(self, call: MemoryCall, seconds: float | None) -> None:
        """Call a service of the server, and end `call` with the answer."""
        name = call.request.type.name.removesuffix("_Request")
        try:
            theirs = await self.robot.types.service(name)
            response = await self.robot.call(call.service, call.request, name, timeout=seconds)
            call.reply(self.read(self.registry.service(name).response, theirs.response, response))
        except CallFailed as error:
            call.end_with(error)
        except RobotError as error:
            call.fail(str(error))

    async def send_goal(self, goal: RobotClientGoal, payload: Payload) -> None:
        """Send a goal to an action of the server, and wait for its result."""
        name = payload.type.name.removesuffix("_Goal")
        type = self.registry.action(name)

        def on_feedback(message: Any) -> None:
            if goal.events is not None and goal.events.on_feedback is not None:
                goal.events.on_feedback(self.read(type.feedback, theirs.feedback, message))

        outcome: Payload | CallFailed
        status = GoalStatus.ABORTED
        try:
            theirs = await self.robot.types.action(name)
            sent = await self.robot.send_goal(goal.action, payload, name, on_feedback=on_feedback)
            goal.take(sent)
            if goal.events is not None and goal.events.on_accepted is not None:
                goal.events.on_accepted()
            status, result = await sent.result()
            outcome = self.read(type.result, theirs.result, result)
        except CallFailed as error:
            outcome = error
        except RobotError as error:
            outcome = CallFailed(str(error))
        if goal.events is not None:
            goal.events.on_result(status, outcome)

    def read(self, ours: MessageType, theirs: MessageType, message: Any) -> Payload:
        """Convert a message of the connection's class to a payload of this graph's class of the type."""
        return Payload.from_cdr(ours, theirs.serialise(message))

    # Listings

    def topics(self) -> tuple[TopicInfo, ...]:
        """Return all topics of the server, sorted by name."""
        return self.listing.topics()

    def topic(self, name: str) -> TopicInfo | None:
        """Return a topic of the server, or None; its endpoints are queried in the background."""
        return self.listing.topic(name)

    def topic_names(self) -> Sequence[str]:
        """Return the names of all topics of the server."""
        return tuple(topic.name for topic in self.topics())

    def services(self) -> tuple[ServiceInfo, ...]:
        """Return all services of this process and the server, sorted by name."""
        self.listing.asked()
        return super().services()

    def actions(self) -> tuple[ActionInfo, ...]:
        """Return all actions of this process and the server, sorted by name."""
        self.listing.asked()
        return super().actions()

    def nodes(self) -> tuple[NodeInfo, ...]:
        """Return all nodes of the server and this process, sorted by name."""
        found = {each.name: each for each in (*self.listing.nodes(), *super().nodes())}
        return tuple(found[name] for name in sorted(found))


class Listing:
    """Listing of the server's rosapi, refreshed while it is in use."""

    def __init__(self, graph: RobotGraph, services: RobotServices, actions: RobotActions) -> None:
        self._graph = graph
        self._services = services
        self._actions = actions
        self._asked_at = float("-inf")
        self._awake = anyio.Event()
        self._topics: dict[str, str] = {}
        self._ends: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {}
        self._nodes: tuple[str, ...] = ()

    def asked(self) -> None:
        """Poll now, and for a time."""
        self._asked_at = time.monotonic()
        self._awake.set()

    async def follow(self) -> None:
        """Poll while the listings are in use."""
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
        services, actions = self._services.types, self._actions.types
        before = (self._topics, services, actions, self._nodes)
        self._topics = {each.name: each.type for each in await api.topics()}
        self._services.types = {
            name: services.get(name) or await api.service_type(name) for name in await api.services()
        }
        self._actions.types = {
            name: actions.get(name) or await self._action_type(name) for name in await api.action_servers()
        }
        self._nodes = await api.nodes()
        for name in tuple(self._ends):
            self._ends[name] = (await api.publishers(name), await api.subscribers(name))
        if before != (self._topics, self._services.types, self._actions.types, self._nodes):
            self._graph.changes.note()

    async def _action_type(self, name: str) -> str:
        try:
            return await self._graph.robot.api.action_type(name)
        except CallFailed:
            return ""  # This rosapi does not report types of actions.

    def topics(self) -> tuple[TopicInfo, ...]:
        """Return all topics."""
        self.asked()
        return tuple(self._info(name) for name in sorted(self._topics))

    def topic(self, name: str) -> TopicInfo | None:
        """Return a topic, or None."""
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

    def nodes(self) -> list[NodeInfo]:
        """Return the nodes of the server, without their topics and services."""
        self.asked()
        return [NodeInfo(name, (), (), (), ()) for name in self._nodes]


def _known(find: Callable[[str], Any], name: str) -> Any:
    try:
        return find(name) if name else None
    except InterfaceError:
        return None


class RobotClientGoal(ClientGoal):
    """Goal of this process for an action of the server."""

    def __init__(self, action: str, goal_id: str, events: GoalEvents) -> None:
        self.id = goal_id
        self.action = action
        self.sent: Goal | None = None
        self.events: GoalEvents | None = events
        self._cancelled = False

    @property
    def status(self) -> GoalStatus:
        """Last state that the server reported."""
        return GoalStatus.UNKNOWN if self.sent is None else self.sent.status

    @property
    def reason(self) -> str:
        """Reason that the server gave for the end of the goal."""
        return "" if self.sent is None else self.sent.reason

    def take(self, sent: Goal) -> None:
        """Store the sent goal, and cancel it if this was requested earlier."""
        self.sent = sent
        if self._cancelled:
            sent.cancel()

    def cancel(self) -> None:
        """Request cancellation."""
        self._cancelled = True
        if self.sent is not None and not self.sent.done:
            self.sent.cancel()

    def abandon(self) -> None:
        """Drop the goal's callbacks; the goal continues."""
        self.events = None
