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
from collections.abc import Awaitable, Callable, Iterable, Iterator
from contextlib import AsyncExitStack
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar
from uuid import uuid4

import anyio

from rwt_client import RawMessage, RawSubscription, Robot, connect
from rwt_graph import MemoryGraph
from rwt_graph.api import (
    ActionInfo,
    CallObserver,
    ClientGoal,
    EndpointInfo,
    GoalEvents,
    Graph,
    NodeInfo,
    OnReply,
    Participant,
    PendingCall,
    Publisher,
    Registration,
    Sample,
    ServerGoal,
    ServiceCall,
    ServiceInfo,
    Subscription,
    TopicInfo,
)
from rwt_graph.errors import NotRunning
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
    ServiceFailed,
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
        owner: RobotParticipant,
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
        self._owner.opened.pop(self, None)
        if not topic.subscriptions and self._graph.topics_here.get(topic.name) is topic:
            del self._graph.topics_here[topic.name]
            topic.close()


class RobotPublisher(Publisher):
    """Publisher of this process on a topic of the server."""

    def __init__(
        self, graph: RobotGraph, topic: str, type: MessageType, qos: QoS, owner: RobotParticipant
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
        self._owner.opened.pop(self, None)
        if self._tells_here:
            self._tells_here = False
            self._graph.told_here -= Counter((self.topic,))
        self._remote.close()


class RobotRegistration(Registration):
    """Service or action of this process, also offered on the server."""

    def __init__(self, local: Registration, withdraw: Callable[[], None], owner: RobotParticipant) -> None:
        self.name = local.name
        self._local = local
        self._withdraw = withdraw
        self._owner = owner

    def close(self) -> None:
        """Withdraw the offer here and on the server."""
        if self._owner.opened.pop(self, None) is not None:
            self._local.close()
            self._withdraw()


class RobotParticipant(Participant):
    """Node of this process, whose topics are the server's.

    Attributes:
        opened: open publishers, subscriptions and registrations, each with the function that closes it.
    """

    def __init__(self, graph: RobotGraph, name: str) -> None:
        self.name = name
        self.opened: dict[object, Callable[[], None]] = {}
        self._graph = graph
        self._local = graph.local.participant(name)
        self._closed = False

    def _check_open(self) -> None:
        if self._closed:
            raise NotRunning(f"node {self.name} was closed")

    def advertise(self, topic: str, type: MessageType, qos: QoS = DEFAULT_QOS) -> Publisher:
        """Become a publisher of `topic`; the server rejects another type, and logs this."""
        self._check_open()
        publisher = RobotPublisher(self._graph, validate(topic), type, qos, self)
        self.opened[publisher] = publisher.close
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
        subscription = RobotSubscription(graph, known, on_sample, self)
        known.subscriptions = (*known.subscriptions, subscription)
        self.opened[subscription] = subscription.close
        if qos.durability is Durability.TRANSIENT_LOCAL and known.last is not None:
            on_sample(known.last)
        return subscription

    def advertise_service(
        self, service: str, type: ServiceType, on_call: Callable[[ServiceCall], None]
    ) -> Registration:
        """Handle a service here and on the server, unless it is part of an action."""
        local = self._local.advertise_service(service, type, on_call)
        if "/_action/" in local.name:
            return local
        return self._registered(local, partial(self._graph.offer_service, local.name, type))

    def advertise_action(
        self, action: str, type: ActionType, on_goal: Callable[[ServerGoal], None]
    ) -> Registration:
        """Handle an action here and on the server."""
        local = self._local.advertise_action(action, type, on_goal)
        return self._registered(local, partial(self._graph.offer_action, local.name, type))

    def _registered(self, local: Registration, offer: Callable[[], Handle]) -> Registration:
        registration = RobotRegistration(local, self._graph.offers.add(local.name, offer), self)
        self.opened[registration] = registration.close
        return registration

    def call_service(
        self, service: str, request: Payload, on_reply: OnReply, timeout: float | None = None
    ) -> PendingCall:
        """Call a service; those of this process take precedence."""
        self._check_open()
        graph = self._graph
        if graph.local.service(service) is not None:
            return self._local.call_service(service, request, on_reply, timeout)
        call = RobotCall(service, on_reply)
        graph.spawn(partial(graph.call, call, request.detach(), timeout), f"call of {service}")
        return call

    def send_goal(
        self, action: str, goal: Payload, events: GoalEvents, goal_id: str | None = None
    ) -> ClientGoal:
        """Send a goal; actions of this process take precedence."""
        self._check_open()
        graph = self._graph
        if graph.local.action(action) is not None:
            return self._local.send_goal(action, goal, events, goal_id)
        sent = RobotClientGoal(action, goal_id or uuid4().hex, events)
        graph.spawn(partial(graph.send_goal, sent, goal.detach()), f"goal of {action}")
        return sent

    def cancel_goal(self, action: str, goal_id: str) -> None:
        """Request cancellation of a goal of an action of this process; over rosbridge only its sender can."""
        self._local.cancel_goal(action, goal_id)
        if self._graph.local.action(action) is None:
            logger.warning(
                "the goal %s of %s cannot be cancelled over rosbridge: it is somebody else's", goal_id, action
            )

    def cancel_every_goal(self, action: str) -> Iterator[None]:
        """Request cancellation of the goals of an action of this process; see :meth:`cancel_goal`."""
        if self._graph.local.action(action) is None:
            logger.warning(
                "the goals of %s cannot be cancelled over rosbridge: they may be somebody else's", action
            )
        return self._local.cancel_every_goal(action)

    def close(self) -> None:
        """Close everything that this node created, and leave the graph."""
        if not self._closed:
            self._closed = True
            for close in reversed(tuple(self.opened.values())):
                close()
            self._local.close()
            self._graph.left(self)


class Offers:
    """Services and actions of this process on the server: the newest of each name is offered."""

    def __init__(self) -> None:
        self._made: dict[str, list[Callable[[], Handle]]] = {}
        self._offered: dict[str, Handle] = {}

    def add(self, name: str, offer: Callable[[], Handle]) -> Callable[[], None]:
        """Handle a service or action; return a function that withdraws it and offers an older one again."""
        self._made.setdefault(name, []).append(offer)
        self._renew(name)

        def withdraw() -> None:
            made = self._made[name]
            is_newest = made[-1] is offer
            made.remove(offer)
            if is_newest:
                self._renew(name)

        return withdraw

    def _renew(self, name: str) -> None:
        old = self._offered.pop(name, None)
        if old is not None:
            old.close()
        if self._made[name]:
            self._offered[name] = self._made[name][-1]()
        else:
            del self._made[name]


class RobotGraph(Graph):
    """Graph whose topics, services and actions are those of a server in another process.

    It must be entered before nodes join it. Services and actions of this process are also in a graph in
    memory, which answers calls between nodes of the process and those that come from the server.

    Args:
        url: URL of the server for :func:`rwt_client.connect`: ``ws://``, ``unix:///path`` and others.
        registry: interfaces; the standard ones of jazzy by default.
        timeout: timeout of connecting in seconds.

    Attributes:
        robot: connection.
        local: graph in memory with the services and actions of this process.
        offers: services and actions of this process that the server knows.
        topics_here: topics that are subscribed to in this process.
        told_here: number of publishers in this process whose messages are delivered here at once, by topic.
    """

    robot: Robot

    def __init__(self, url: str, registry: Registry | None = None, *, timeout: float = 10.0) -> None:
        self._connecting = connect(url, timeout=timeout, ros_version=2, fetch_types=False)
        self.local = MemoryGraph(registry)
        self.registry, self.distro = self.local.registry, self.local.distro
        self.clock, self.parameters = self.local.clock, self.local.parameters
        self.offers = Offers()
        self.topics_here: dict[str, RobotTopic] = {}
        self.told_here: Counter[str] = Counter()
        self._connection = AsyncExitStack()
        self._participants: dict[RobotParticipant, None] = {}
        # Participant that calls and sends goals for clients of the server; not listed.
        self._for_clients = self.local.participant(_FOR_CLIENTS)
        self._listing = Listing(self)

    async def __aenter__(self) -> Self:
        """Connect, and run on the current event loop.

        Raises:
            BadAddress: the URL is invalid for connecting.
            CannotConnect: the connection failed; the text gives the reason.
        """
        await self.local.__aenter__()
        try:
            self.robot = await self._connection.enter_async_context(self._connecting)
        except BaseException:
            await self.local.__aexit__()
            raise
        self.spawn(self._listing.follow, "listing")
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Stop handlers, close every participant and the connection."""
        for participant in tuple(reversed(self._participants)):
            participant.close()
        try:
            await self._connection.aclose()
        finally:
            await self.local.__aexit__(*exc)

    def participant(self, name: str) -> RobotParticipant:
        """Join as a node with an absolute name."""
        participant = RobotParticipant(self, validate(name))
        self._participants[participant] = None
        return participant

    def left(self, participant: RobotParticipant) -> None:
        """Remove a closed participant."""
        self._participants.pop(participant, None)

    @property
    def running(self) -> bool:
        """True while the graph runs on an event loop."""
        return self.local.running

    def on_graph_thread(self) -> bool:
        """True if the graph may be used from this thread."""
        return self.local.on_graph_thread()

    def run_on_graph(self, call: Callable[[], None]) -> None:
        """Run `call` on the graph's thread, soon and in order; safe from any thread."""
        self.local.run_on_graph(call)

    def spawn(self, task: Callable[[], Awaitable[None]], name: str) -> None:
        """Run a coroutine function as a task of the graph. Raises NotRunning once it was left."""
        self.local.spawn(task, name)

    def observe_calls(self, observer: CallObserver | None) -> bool:
        """Let `observer` observe every call and goal of services and actions of this process."""
        return self.local.observe_calls(observer)

    # Offered on the server

    def offer_service(self, name: str, type: ServiceType) -> Handle:
        """Handle a service of this process on the server."""
        return self.robot.advertise_service(
            name, self.registry.type_name(type), partial(self._answer, name, type)
        )

    async def _answer(self, name: str, type: ServiceType, request: Any) -> Payload:
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

    def offer_action(self, name: str, type: ActionType) -> Handle:
        """Handle an action of this process on the server."""
        return self.robot.advertise_action(
            name, self.registry.type_name(type), partial(self._execute, name, type)
        )

    async def _execute(self, name: str, type: ActionType, goal: ReceivedGoal) -> Payload:
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

    async def call(self, call: RobotCall, request: Payload, seconds: float | None) -> None:
        """Call a service of the server, and end `call` with the answer."""
        name = request.type.name.removesuffix("_Request")
        answer: Payload | CallFailed
        try:
            theirs = await self.robot.types.service(name)
            response = await self.robot.call(call.service, request, name, timeout=seconds)
            answer = self.read(self.registry.service(name).response, theirs.response, response)
        except CallFailed as error:
            answer = error
        except RobotError as error:
            answer = ServiceFailed(str(error))
        call.end(answer)

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

    @property
    def version(self) -> int:
        """Number that grows with every change of the listings."""
        return self.local.version + self._listing.version

    def topics(self) -> tuple[TopicInfo, ...]:
        """Return all topics of the server, sorted by name."""
        return self._listing.topics()

    def topic(self, name: str) -> TopicInfo | None:
        """Return a topic of the server, or None; its endpoints are queried in the background."""
        return self._listing.topic(name)

    def services(self) -> tuple[ServiceInfo, ...]:
        """Return all services of this process and the server, sorted by name."""
        return _merged(self._listing.services(), self.local.services())

    def service(self, name: str) -> ServiceInfo | None:
        """Return a service of this process or the server, or None."""
        return self.local.service(name) or self._listing.service(name)

    def actions(self) -> tuple[ActionInfo, ...]:
        """Return all actions of this process and the server, sorted by name."""
        return _merged(self._listing.actions(), self.local.actions())

    def action(self, name: str) -> ActionInfo | None:
        """Return an action of this process or the server, or None."""
        return self.local.action(name) or self._listing.action(name)

    def nodes(self) -> tuple[NodeInfo, ...]:
        """Return all nodes of the server and this process, sorted by name."""
        own = tuple(each for each in self.local.nodes() if each.name != _FOR_CLIENTS)
        return _merged(self._listing.nodes(), own)


Info = TypeVar("Info", bound=ServiceInfo | ActionInfo | NodeInfo)


def _merged(theirs: Iterable[Info], own: Iterable[Info]) -> tuple[Info, ...]:
    """Return the items of both by name; items of this process take precedence."""
    found = {each.name: each for each in (*theirs, *own)}
    return tuple(sorted(found.values(), key=lambda each: each.name))


class Listing:
    """Listing of the server's rosapi, refreshed while it is in use."""

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

    def service(self, name: str) -> ServiceInfo | None:
        """Return a service of the server, or None."""
        self.asked()
        type = _known(self._graph.registry.service, self._services.get(name, ""))
        return None if type is None else ServiceInfo(name, type, "")

    def services(self) -> list[ServiceInfo]:
        """Return the services of the server with known types."""
        return [info for name in self._services if (info := self.service(name)) is not None]

    def action(self, name: str) -> ActionInfo | None:
        """Return an action of the server, or None."""
        self.asked()
        type = _known(self._graph.registry.action, self._actions.get(name, ""))
        return None if type is None else ActionInfo(name, type, "")

    def actions(self) -> list[ActionInfo]:
        """Return the actions of the server with known types."""
        return [info for name in self._actions if (info := self.action(name)) is not None]

    def nodes(self) -> list[NodeInfo]:
        """Return the nodes of the server, without their topics and services."""
        self.asked()
        return [NodeInfo(name, (), (), (), ()) for name in self._nodes]


def _known(find: Callable[[str], Any], name: str) -> Any:
    try:
        return find(name) if name else None
    except InterfaceError:
        return None


class RobotCall(PendingCall):
    """Call of this process to a service of the server."""

    __slots__ = ("_on_reply", "service")

    def __init__(self, service: str, on_reply: OnReply) -> None:
        self.service = service
        self._on_reply: OnReply | None = on_reply

    def end(self, answer: Payload | CallFailed) -> None:
        """Pass the response to the caller, unless the call was cancelled."""
        on_reply, self._on_reply = self._on_reply, None
        if on_reply is not None:
            on_reply(answer)

    def cancel(self) -> None:
        """Cancel the call: no reply callback is called after this."""
        self._on_reply = None


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
