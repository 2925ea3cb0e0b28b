"""Verbs of a robot program on a graph: for nodes, for the recorder, and for a client's view of the graph."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Awaitable, Callable
from concurrent import futures
from typing import TYPE_CHECKING, TypeVar

from rwt_graph import api
from rwt_graph.api import (
    ActionInfo,
    Graph,
    GraphListings,
    Sample,
    ServerGoal,
    ServiceCall,
    ServiceInfo,
    TopicInfo,
)
from rwt_graph.clock import Clock
from rwt_graph.names import namespace_of, node_name, resolve
from rwt_graph.nodes.actionlib import ActionlibServer
from rwt_graph.nodes.endpoints import TopicPublisher, TopicSubscription
from rwt_graph.nodes.goals import AcceptGoal, ActionFunction, GraphGoal
from rwt_graph.nodes.service_handlers import ServiceFunction
from rwt_graph.parameters.client import ParameterClient
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.api import Listed, RobotApi
from rwt_participant.errors import NotFound, ProviderNotFound, TimedOut, UnknownType
from rwt_participant.future import USUAL, Future, Timeout
from rwt_participant.goals import BlockingExecute, Execute, Goal
from rwt_participant.handles import QUEUE_BYTES, Handle
from rwt_participant.messages import (
    Message,
    MessageCallback,
    MessageLike,
    RawCallback,
    RawMessage,
    ServiceHandler,
    check_arguments,
    check_interface,
    to_payload,
    type_of,
)
from rwt_participant.qos import BEST_AVAILABLE, DEFAULT_QOS, LATCHED, QoS
from rwt_participant.spelling import did_you_mean
from rwt_participant.timers import PeriodicTimer

if TYPE_CHECKING:
    from rwt_interfaces.distro import Distro
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.registry import Registry
    from rwt_participant.transforms import Transforms

T = TypeVar("T")


class GraphServer(Handle):
    """Service or action that a program offers in a graph."""

    def __init__(self, graph: Graph, name: str, *withdraw: Callable[[], object]) -> None:
        self.name = name
        self._graph = graph
        self._withdraw = withdraw

    def close(self) -> None:
        self._graph.soon(self._close)

    def _close(self) -> None:
        for withdraw in self._withdraw:
            withdraw()


class GraphVerbs(RobotApi):
    """Verbs of a robot program, on the operations of a graph that a subclass provides.

    Args:
        graph: any backend; its clock, thread and tasks are used.
        listings: topics, services and actions that the program sees.
        timeout: as for :class:`~rwt_graph.nodes.node.Node`.

    Attributes:
        namespace: namespace that relative names are resolved in.
    """

    def __init__(self, graph: Graph, listings: GraphListings, name: str, timeout: float | None) -> None:
        self.graph = graph
        self.name = name
        self.namespace = namespace_of(name)
        self._listings = listings
        self._timeout = timeout
        self._publishers: dict[str, TopicPublisher] = {}
        self._tf: Transforms | None = None
        self._timers: set[PeriodicTimer] = set()

    # Operations that a subclass provides

    @abstractmethod
    def _advertise(self, topic: str, type: MessageType, qos: QoS) -> api.Publisher:
        """As :meth:`rwt_graph.api.Participant.advertise`."""

    @abstractmethod
    def _listen(
        self, topic: str, on_sample: Callable[[Sample], None], type: MessageType | None, qos: QoS
    ) -> api.Subscription:
        """Become a subscriber; see :meth:`rwt_graph.api.Participant.subscribe`."""

    @abstractmethod
    async def _answer(self, service: str, request: MessageLike | None, seconds: float | None) -> Payload:
        """Call a service by its absolute name, and wait for the response."""

    @abstractmethod
    def _offer_service(
        self, service: str, type: ServiceType, on_call: Callable[[ServiceCall], None]
    ) -> tuple[Callable[[], object], ...]:
        """Offer a service, and return what withdraws it; see :class:`rwt_graph.api.Participant`."""

    @abstractmethod
    def _offer_action(
        self, action: str, type: ActionType, on_goal: Callable[[ServerGoal], None]
    ) -> tuple[Callable[[], object], ...]:
        """Offer an action, and return what withdraws it; see :class:`rwt_graph.api.Participant`."""

    # The graph

    @property
    def clock(self) -> Clock:
        return self.graph.clock

    @property
    def registry(self) -> Registry:
        """Interfaces that the graph knows."""
        return self.graph.registry

    @property
    def distro(self) -> Distro:
        """ROS distribution of the graph."""
        return self.graph.distro

    def resolve(self, name: str) -> str:
        """Return the absolute form of a name: relative to the namespace, `~/x` to the node."""
        return resolve(name, self.namespace, self.name)

    def run(self, function: Callable[[], T]) -> T:
        """Run a plain function on the graph's thread, and return or raise what it does."""
        if self.graph.on_graph_thread():
            return function()
        outcome: futures.Future[T] = futures.Future()

        def run() -> None:
            try:
                outcome.set_result(function())
            except Exception as error:
                outcome.set_exception(error)

        self.graph.run_on_graph(run)
        return outcome.result()

    # Listings

    async def topics(self, *, hidden: bool = False) -> tuple[Listed, ...]:
        name_of = self.registry.type_name
        return tuple(
            Listed(each.name, name_of(each.type) if each.type else "", each.publishers, each.subscribers)
            for each in self._listings.topics()
        )

    async def services(self) -> tuple[Listed, ...]:
        name_of = self.registry.type_name
        return tuple(Listed(each.name, name_of(each.type)) for each in self._listings.services())

    async def actions(self) -> tuple[Listed, ...]:
        name_of = self.registry.type_name
        return tuple(Listed(each.name, name_of(each.type)) for each in self._listings.actions())

    async def type_of(self, topic: str) -> MessageType:
        info = self._listings.topic(self.resolve(topic))
        if info is None or info.type is None:
            raise NotFound(f"there is no topic {topic}{self._meant(topic, self._listings.topics())}")
        return info.type

    async def interface(self, name: str) -> MessageType | ServiceType | ActionType:
        for find in (self.registry.message, self.registry.service, self.registry.action):
            try:
                return find(name)
            except UnknownType:
                continue
        raise UnknownType(f"no message, service or action of the name {name} is known")

    def _meant(self, name: str, known: tuple[TopicInfo | ServiceInfo | ActionInfo, ...]) -> str:
        return did_you_mean(self.resolve(name), (each.name for each in known))

    # Topics

    def advertise(
        self, topic: str, type: str, *, qos: QoS | None = None, latch: bool = False
    ) -> TopicPublisher:
        check_arguments("advertise(topic, type)", type)
        name, message = self.resolve(topic), self.registry.message(type)
        wanted = qos or (LATCHED if latch else DEFAULT_QOS)
        return self.run(lambda: TopicPublisher(self.graph, self._advertise(name, message, wanted)))

    def publish(
        self, topic: str, message: MessageLike, type: str | None = None, *, latch: bool = False
    ) -> TopicPublisher:
        if type is not None:
            check_arguments("publish(topic, message, type)", type)
        name = self.resolve(topic)
        publisher = self._publishers.get(name)
        if publisher is None:
            wanted = type or type_of(message, self.registry) or self._type_name(name)
            publisher = self._publishers[name] = self.advertise(name, wanted, latch=latch)
        elif type is not None and self.registry.message(type) is not publisher.type:
            publisher = self.advertise(name, type)  # Raises the TypeConflict.
        publisher.publish(message)
        return publisher

    def _type_name(self, topic: str) -> str:
        info = self._listings.topic(topic)
        if info is None or info.type is None:
            meant = self._meant_topic(topic) or "; name its type if it will come"
            raise NotFound(f"there is no topic {topic} that has a type{meant}")
        return info.type.name

    def _meant_topic(self, topic: str) -> str:
        return self._meant(topic, tuple(each for each in self._listings.topics() if each.publishers))

    def subscribe(
        self,
        topic: str,
        callback: MessageCallback,
        type: str | None = None,
        *,
        qos: QoS | None = None,
        queue_size: int = 10,
        queue_bytes: int = QUEUE_BYTES,
        threaded: bool = False,
    ) -> TopicSubscription:
        check_arguments("subscribe(topic, callback, type)", type, callback)
        if threaded:
            callback = self.graph.handler_threads.coroutine(callback)
        return self._subscribe(topic, type, qos, queue_size, queue_bytes, callback=callback)

    def subscribe_samples(
        self,
        topic: str,
        on_sample: Callable[[Sample], None],
        type: str | None = None,
        *,
        qos: QoS | None = None,
    ) -> TopicSubscription:
        """Call `on_sample`, on the graph's thread, with each undecoded sample; see :meth:`subscribe`."""
        return self._subscribe(topic, type, qos, on_sample=on_sample)

    def subscribe_raw(self, topic: str, callback: RawCallback, type: str | None = None) -> TopicSubscription:
        check_arguments("subscribe_raw(topic, callback, type)", type, callback)

        def take(sample: Sample) -> None:
            payload = sample.payload
            callback(RawMessage(payload.serialised(), sample.stamp_ns, payload.type))

        return self.subscribe_samples(topic, take, type)

    def topic(
        self,
        topic: str,
        type: str | None = None,
        *,
        qos: QoS | None = None,
        queue_size: int = 10,
        queue_bytes: int = QUEUE_BYTES,
    ) -> TopicSubscription:
        check_arguments("topic(topic, type)", type)
        return self._subscribe(topic, type, qos, queue_size, queue_bytes)

    async def once(self, topic: str, type: str | None = None, *, timeout: Timeout = USUAL) -> Message:
        try:
            with self.topic(topic, type) as messages:
                return await messages.get(self._patience(timeout))
        except TimedOut as error:
            raise TimedOut(f"{error}{self._meant_topic(topic)}") from None

    def _subscribe(
        self,
        topic: str,
        type: str | None,
        qos: QoS | None,
        queue_size: int = 1,
        queue_bytes: int = QUEUE_BYTES,
        callback: MessageCallback | None = None,
        on_sample: Callable[[Sample], None] | None = None,
    ) -> TopicSubscription:
        name, wanted = self.resolve(topic), qos or BEST_AVAILABLE
        message = None if type is None else self.registry.message(type)

        def listen(receive: Callable[[Sample], None]) -> api.Subscription:
            return self._listen(name, receive, message, wanted)

        return self.run(
            lambda: TopicSubscription(self.graph, name, listen, callback, on_sample, queue_size, queue_bytes)
        )

    # Services

    def advertise_service(
        self, service: str, type: str, handler: ServiceHandler, *, threaded: bool = False
    ) -> GraphServer:
        check_arguments("advertise_service(service, type, handler)", type, handler)
        if threaded:
            handler = self.graph.handler_threads.coroutine(handler)
        name, interface = self.resolve(service), self.registry.service(type)
        function = ServiceFunction(self.graph, name, interface.response, handler)
        return self.run(
            lambda: GraphServer(self.graph, name, *self._offer_service(name, interface, function))
        )

    async def call(
        self,
        service: str,
        request: MessageLike | None = None,
        type: str | None = None,
        *,
        timeout: Timeout = USUAL,
    ) -> Message:
        check_arguments("call(service, request, type)", type)
        name = self.resolve(service)
        if type is not None:
            stated, info = self.registry.service(type), self._listings.service(name)
            if info is not None:
                check_interface(name, stated, info.type)
        answer = await self._answer(name, request, self._patience(timeout))
        return answer.value()

    def _patience(self, timeout: Timeout) -> float | None:
        return self._timeout if timeout is USUAL else timeout

    def _payload(self, type: MessageType, value: MessageLike | None) -> Payload:
        return to_payload(type, {} if value is None else value, self.clock.time_ns)

    # Actions

    def advertise_action(
        self,
        action: str,
        type: str,
        execute: Execute | BlockingExecute,
        *,
        accept: AcceptGoal | None = None,
        threaded: bool = False,
    ) -> GraphServer:
        """Offer an action, on ROS 1 over topics too (ALB-01); see :meth:`RobotApi.advertise_action`.

        Args:
            accept: function that checks the goal's message first: True accepts, False or a reason rejects.
        """
        check_arguments("advertise_action(action, type, execute)", type, execute)
        if threaded:
            execute = self.graph.handler_threads.coroutine(execute)
        name, interface = self.resolve(action), self.registry.action(type)
        function = ActionFunction(self.graph, name, interface, execute, accept)
        return self.run(lambda: GraphServer(self.graph, name, *self._offer_action(name, interface, function)))

    # Transforms and time

    @property
    def tf(self) -> Transforms:
        if self._tf is None:
            from rwt_participant.transforms import Transforms  # Most nodes look up no transforms.

            clock = self.clock
            self._tf = Transforms(self.subscribe, self.advertise, clock.time_ns, self._timeout, clock.within)
        return self._tf

    async def time_ns(self) -> int:
        return self.clock.time_ns()

    def create_timer(
        self, period: float, callback: Callable[[], Awaitable[None] | None], *, threaded: bool = False
    ) -> PeriodicTimer:
        if threaded:
            callback = self.graph.handler_threads.coroutine(callback)
        timer = PeriodicTimer(self.clock, self.graph, period, callback, self._timers.discard)
        self._timers.add(timer)
        self.run(timer.start)
        return timer

    def close(self) -> None:
        """Leave the graph with everything that this program made there."""
        self.run(self._close)

    def _close(self) -> None:
        for timer in tuple(self._timers):
            timer.cancel()


class GraphRobot(GraphVerbs):
    """Participant of a graph with every verb of a robot program.

    A :class:`~rwt_graph.nodes.node.Node`, with the same arguments, without what every node of ROS offers:
    log, parameters, services.

    Raises:
        InvalidGraphName: ROS does not allow the name or the namespace.
    """

    def __init__(
        self, graph: Graph, name: str, namespace: str = "/", *, timeout: float | None = None
    ) -> None:
        super().__init__(graph, graph, node_name(name, namespace), timeout)
        self._participant = self.run(lambda: graph.participant(self.name))
        # A graph of ROS 2 may remap it.
        self.name = self._participant.name
        self.namespace = namespace_of(self.name)
        self.params = ParameterClient(graph, self.namespace, self.name, self.call)

    def _advertise(self, topic: str, type: MessageType, qos: QoS) -> api.Publisher:
        return self._participant.advertise(topic, type, qos)

    def _listen(
        self, topic: str, on_sample: Callable[[Sample], None], type: MessageType | None, qos: QoS
    ) -> api.Subscription:
        return self._participant.subscribe(topic, on_sample, type, qos)

    async def _answer(self, service: str, request: MessageLike | None, seconds: float | None) -> Payload:
        info = self.graph.service(service)
        if info is None:
            meant = self._meant(service, self.graph.services())
            raise ProviderNotFound(f"Service {service} does not exist{meant}")
        payload = self._payload(info.type.request, request)
        answer: Future[Payload] = Future()
        pending = self._participant.call_service(service, payload, answer.set, seconds)
        try:
            return await answer.wait()
        finally:
            pending.cancel()

    def _offer_service(
        self, service: str, type: ServiceType, on_call: Callable[[ServiceCall], None]
    ) -> tuple[Callable[[], object], ...]:
        return (self._participant.advertise_service(service, type, on_call).close,)

    def _offer_action(
        self, action: str, type: ActionType, on_goal: Callable[[ServerGoal], None]
    ) -> tuple[Callable[[], object], ...]:
        registration = self._participant.advertise_action(action, type, on_goal)
        if self.distro.action_transport == "services":
            return (registration.close,)
        topics = ActionlibServer(self.graph, self._participant, action, type, self.create_timer)
        return (registration.close, topics.close)

    async def send_goal(
        self,
        action: str,
        goal: MessageLike | None = None,
        type: str | None = None,
        *,
        on_feedback: Callable[[Message], object] | None = None,
        goal_id: str | None = None,
    ) -> Goal:
        """Send a goal, and wait until the server has accepted it; see :meth:`RobotApi.send_goal`.

        Args:
            goal_id: 32 lower-case hex digits; generated by default.
        """
        check_arguments("send_goal(action, goal, type)", type)
        stated = None if type is None else self.registry.action(type)
        name = self.resolve(action)
        info = self.graph.action(name)
        if info is None:
            meant = self._meant(name, self.graph.actions())
            raise ProviderNotFound(f"Action {name} does not exist{meant}")
        if stated is not None:
            check_interface(name, stated, info.type)
        payload = self._payload(info.type.goal, goal)
        sent = GraphGoal(self.clock, name, on_feedback)
        sent.send(lambda events: self._participant.send_goal(name, payload, events, goal_id))
        await sent.accepted.wait()
        return sent

    def cancel_goal(self, action: str, goal_id: str) -> None:
        name = self.resolve(action)
        self.run(lambda: self._participant.cancel_goal(name, goal_id))

    def _close(self) -> None:
        super()._close()
        self._participant.close()
