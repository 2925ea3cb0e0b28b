"""The API of robot programs: typed messages, coroutines and plain functions, safe from every thread.

A node is written on the contract of :mod:`rwt_graph.api` alone, so it works on every backend::

    graph = MemoryGraph()
    node = Node(graph, "talker")
    chatter = node.advertise("chatter", "std_msgs/String")
    async with graph:
        chatter.publish({"data": "hello"})

Threads: once the graph runs, every method that is not a coroutine may be called from any thread. Those that
return something wait for the graph's thread; `publish` does not. A coroutine is awaited on the graph's event
loop; from another thread, :meth:`Node.run_blocking` runs one there and waits for it.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from typing import TYPE_CHECKING, Protocol, TypeVar

from rwt_graph.api import Graph, Sample
from rwt_graph.clock import Clock, SimulatedClock
from rwt_graph.errors import NotRunning
from rwt_graph.names import namespace_of, node_name, resolve
from rwt_graph.nodes import service_handlers
from rwt_graph.nodes.actionlib import ActionlibServer
from rwt_graph.nodes.endpoints import TopicPublisher, TopicSubscription
from rwt_graph.nodes.goals import AcceptGoal, ActionFunction, SentGoal
from rwt_graph.nodes.logs import NodeLog, rosout_qos
from rwt_graph.nodes.service_handlers import ServiceFunction
from rwt_graph.parameters.client import ParameterClient
from rwt_graph.parameters.node_parameters import NodeParameters, NodeStore, TreeStore
from rwt_graph.parameters.services import EVENTS_QOS, ParameterEvents, ParameterServices
from rwt_participant.api import RobotApi
from rwt_participant.blocking import (
    BlockingHandle,
    BlockingPublisher,
    BlockingSubscription,
    BlockingTransforms,
    BlockingVerbs,
    holds,
    waits,
)
from rwt_participant.errors import NotFound, ProviderNotFound, TimedOut, WrongThread
from rwt_participant.future import USUAL, Timeout
from rwt_participant.goals import Execute, Goal
from rwt_participant.handles import QUEUE_BYTES, Handle
from rwt_participant.messages import (
    Message,
    MessageCallback,
    MessageLike,
    ParameterValue,
    ServiceHandler,
    to_payload,
    type_of,
)
from rwt_participant.qos import BEST_AVAILABLE, DEFAULT_QOS, LATCHED, QoS
from rwt_participant.spelling import did_you_mean
from rwt_participant.timers import PeriodicTimer
from rwt_participant.transforms import Transforms

if TYPE_CHECKING:
    from rwt_interfaces.distro import Distro
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.registry import Registry

T = TypeVar("T")


class Closable(Protocol):
    """A part of what a node offers."""

    def close(self) -> None:
        """Let go."""
        ...


class _Server(Handle):
    """Something that a node offers by name.

    Attributes:
        name: absolute name.
    """

    def __init__(self, graph: Graph, name: str, *parts: Closable) -> None:
        self.name = name
        self._graph = graph
        self._parts = parts

    def close(self) -> None:
        """Withdraw it, from any thread; calls and goals in flight end with :exc:`ProviderGone`."""
        if self._graph.on_graph_thread():
            self._close()
        else:
            self._graph.run_on_graph(self._close)

    def _close(self) -> None:
        for part in self._parts:
            part.close()


class ServiceServer(_Server):
    """A service that a node offers."""


class ActionServer(_Server):
    """An action that a node offers."""


class Node(RobotApi):
    """One participant of the graph.

    Args:
        graph: any backend.
        name: the node's own name (`talker`), or its absolute one.
        namespace: what relative names are relative to.
        timeout: what every question waits by default, in seconds of the graph's clock; None, as in ROS, as
            long as it takes.

    Attributes:
        name: absolute name.
        log: writes to `/rosout` and Python's logging.
        parameters: the node's own, which it declares.
        params: those of all nodes.

    Raises:
        InvalidGraphName: the name or the namespace is not one that ROS allows.
    """

    def __init__(
        self, graph: Graph, name: str, namespace: str = "/", *, timeout: float | None = None
    ) -> None:
        self.graph = graph
        self._timeout = timeout
        self._publishers: dict[str, TopicPublisher] = {}
        self._tf: Transforms | None = None
        self.name = node_name(name, namespace)
        self.namespace = namespace_of(self.name)
        self._participant = self.run(lambda: graph.participant(self.name))
        self._timers: set[PeriodicTimer] = set()
        rosout = self.advertise("/rosout", graph.distro.rosout_type, qos=rosout_qos(graph.distro))
        self.log = NodeLog(self.name, graph.distro, rosout)
        self.parameters = self._make_parameters()
        if graph.distro.nodes_have_loggers:
            self.advertise_service("~/get_loggers", "roscpp/GetLoggers", self.log.loggers)
            self.advertise_service("~/set_logger_level", "roscpp/SetLoggerLevel", self.log.set_level)
        self.params = ParameterClient(graph, self.namespace, self.name, self._call_within)

    def _make_parameters(self) -> NodeParameters:
        if not self.distro.parameters_belong_to_nodes:
            tree = TreeStore(self.graph.parameters, self.name)
            return NodeParameters(self.name, tree, True, self.run)
        publisher = self.advertise("/parameter_events", "rcl_interfaces/ParameterEvent", qos=EVENTS_QOS)
        events = ParameterEvents(self.name, self.distro, publisher)
        parameters = NodeParameters(self.name, NodeStore(events.stored), False, self.run)
        for name, interface, handler in ParameterServices(parameters).handlers():
            self.advertise_service(f"~/{name}", interface, handler)
        parameters.declare(
            "use_sim_time",
            isinstance(self.clock, SimulatedClock),
            description="whether the node is told to go by /clock; it goes by the clock of its graph",
            on_change=self._on_use_sim_time,
        )
        return parameters

    def _on_use_sim_time(self, value: ParameterValue) -> None:
        """Warn where a node is told of another time than all nodes of its graph have."""
        simulated = isinstance(self.clock, SimulatedClock)
        if value != simulated:
            said, kind = ("true", "real") if value else ("false", "simulated")
            text = f"use_sim_time is {said} now; the time is still that of the graph, which is {kind}"
            self.log.warning(text)

    @property
    def clock(self) -> Clock:
        """ROS time, steady time and timers."""
        return self.graph.clock

    @property
    def registry(self) -> Registry:
        """The interfaces that the graph knows."""
        return self.graph.registry

    @property
    def distro(self) -> Distro:
        """The ROS distribution that the graph speaks."""
        return self.graph.distro

    def resolve(self, name: str) -> str:
        """The absolute form of a name: relative to the namespace, `~/x` to the node."""
        return resolve(name, self.namespace, self.name)

    # Topics

    def advertise(  # noqa: D102 - inherited
        self, topic: str, type: str, *, qos: QoS | None = None, latch: bool = False
    ) -> TopicPublisher:
        name, message = self.resolve(topic), self.registry.message(type)
        wanted = qos or (LATCHED if latch else DEFAULT_QOS)
        return self.run(
            lambda: TopicPublisher(self.graph, self._participant.advertise(name, message, wanted))
        )

    def publish(  # noqa: D102 - inherited
        self, topic: str, message: MessageLike, type: str | None = None, *, latch: bool = False
    ) -> TopicPublisher:
        name = self.resolve(topic)
        publisher = self._publishers.get(name)
        if publisher is None:
            wanted = type or type_of(message, self.registry) or self._type_of(name)
            publisher = self._publishers[name] = self.advertise(name, wanted, latch=latch)
        elif type is not None and self.registry.message(type) is not publisher.type:
            publisher = self.advertise(name, type)  # Raises what is wrong with it.
        publisher.publish(message)
        return publisher

    def _type_of(self, topic: str) -> str:
        info = self.graph.topic(topic)
        if info is None or info.type is None:
            meant = self._meant_topic(topic) or "; name its type if it will come"
            raise NotFound(f"there is no topic {topic} that has a type{meant}")
        return info.type.name

    def _meant_topic(self, topic: str) -> str:
        """`; did you mean X?` with a topic that somebody publishes; empty if `topic` is one."""
        return did_you_mean(topic, (each.name for each in self.graph.topics() if each.publishers))

    def subscribe(  # noqa: D102 - inherited
        self,
        topic: str,
        callback: MessageCallback,
        type: str | None = None,
        *,
        qos: QoS | None = None,
        queue_size: int = 10,
        queue_bytes: int = QUEUE_BYTES,
    ) -> TopicSubscription:
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

    def topic(  # noqa: D102 - inherited
        self,
        topic: str,
        type: str | None = None,
        *,
        qos: QoS | None = None,
        queue_size: int = 10,
        queue_bytes: int = QUEUE_BYTES,
    ) -> TopicSubscription:
        return self._subscribe(topic, type, qos, queue_size, queue_bytes)

    async def once(self, topic: str, type: str | None = None, *, timeout: Timeout = USUAL) -> Message:  # noqa: D102 - inherited
        try:
            with self.topic(topic, type) as messages:
                return await messages.get(self._patience(timeout))
        except TimedOut as error:
            raise TimedOut(f"{error}{self._meant_topic(self.resolve(topic))}") from None

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
        return self.run(
            lambda: TopicSubscription(
                self.graph,
                self._participant,
                name,
                callback,
                on_sample,
                message,
                wanted,
                queue_size,
                queue_bytes,
            )
        )

    # Services

    def advertise_service(  # noqa: D102 - inherited
        self,
        service: str,
        type: str,
        handler: ServiceHandler,
    ) -> ServiceServer:
        name, interface = self.resolve(service), self.registry.service(type)
        function = ServiceFunction(self.graph, name, interface.response, handler)
        return self.run(
            lambda: ServiceServer(
                self.graph, name, self._participant.advertise_service(name, interface, function)
            )
        )

    async def call(  # noqa: D102 - inherited
        self,
        service: str,
        request: MessageLike | None = None,
        type: str | None = None,
        *,
        timeout: Timeout = USUAL,
    ) -> Message:
        if type is not None:
            self.registry.service(type)
        name = self.resolve(service)
        payload = self._request(name, request)
        answer = await service_handlers.call(self._participant, name, payload, self._patience(timeout))
        return answer.value()

    async def _call_within(self, service: str, request: MessageLike, seconds: float) -> Message:
        return await self.call(service, request, timeout=seconds)

    def _patience(self, timeout: Timeout) -> float | None:
        return self._timeout if timeout is USUAL else timeout

    def _request(self, name: str, request: MessageLike | None) -> Payload:
        info = self.graph.service(name)
        if info is None:
            meant = did_you_mean(name, (service.name for service in self.graph.services()))
            raise ProviderNotFound(f"Service {name} does not exist{meant}")
        return to_payload(info.type.request, {} if request is None else request, self.clock.time_ns)

    # Actions

    def advertise_action(
        self,
        action: str,
        type: str,
        execute: Execute,
        *,
        accept: AcceptGoal | None = None,
    ) -> ActionServer:
        """Offer an action, on ROS 1 over topics too (ALB-01); see :meth:`RobotApi.advertise_action`.

        Args:
            accept: looks at the goal's message first: True accepts, False or a reason rejects.
        """
        name, interface = self.resolve(action), self.registry.action(type)
        function = ActionFunction(self.graph, name, interface, execute, accept)

        def advertise() -> ActionServer:
            registration = self._participant.advertise_action(name, interface, function)
            if self.distro.action_transport == "services":
                return ActionServer(self.graph, name, registration)
            topics = ActionlibServer(self.graph, self._participant, name, interface, self.create_timer)
            return ActionServer(self.graph, name, registration, topics)

        return self.run(advertise)

    def serve_over_topics(self, action: str, type: str) -> ActionServer:
        """Offer an action of this node over the topics of ROS 1 besides (ALB-01), for clients of actionlib.

        On ROS 1 :meth:`advertise_action` does so by itself. There the status always goes out; here it does
        while there are goals.

        Args:
            action: one that this node offers; when it is withdrawn, goals that come are left unanswered.
            type: what the action is called over topics; its fields are those of the action's own type.

        Raises:
            UnknownType: no such action is known.
            InvalidGraphName: not a name that ROS allows.
        """
        name, interface = self.resolve(action), self.registry.action(type)

        def serve() -> ActionServer:
            topics = ActionlibServer(
                self.graph, self._participant, name, interface, self.create_timer, idle_status=False
            )
            return ActionServer(self.graph, name, topics)

        return self.run(serve)

    async def send_goal(
        self,
        action: str,
        goal: MessageLike | None = None,
        type: str | None = None,
        *,
        on_feedback: Callable[[Message], object] | None = None,
        goal_id: str | None = None,
    ) -> Goal:
        """Send a goal, and wait until the server has taken it; see :meth:`RobotApi.send_goal`.

        Args:
            goal_id: 32 lower-case hex digits; made here by default.
        """
        if type is not None:
            self.registry.action(type)
        name = self.resolve(action)
        info = self.graph.action(name)
        if info is None:
            meant = did_you_mean(name, (action.name for action in self.graph.actions()))
            raise ProviderNotFound(f"Action {name} does not exist{meant}")
        payload = to_payload(info.type.goal, {} if goal is None else goal, self.clock.time_ns)
        sent = SentGoal(self.clock, name, on_feedback)
        await sent.send(self._participant, payload, goal_id)
        return sent

    def cancel_goal(self, action: str, goal_id: str) -> None:
        """Ask to cancel a goal that anybody sent, by its id; an unknown one is no error."""
        name = self.resolve(action)
        self.run(lambda: self._participant.cancel_goal(name, goal_id))

    # Transforms and time

    @property
    def tf(self) -> Transforms:  # noqa: D102 - inherited
        if self._tf is None:
            clock = self.clock
            self._tf = Transforms(self.subscribe, self.advertise, clock.time_ns, self._timeout, clock.within)
        return self._tf

    async def time_ns(self) -> int:  # noqa: D102 - inherited
        return self.clock.time_ns()

    def create_timer(  # noqa: D102 - inherited
        self, period: float, callback: Callable[[], Awaitable[None] | None]
    ) -> PeriodicTimer:
        timer = PeriodicTimer(self.clock, _TimerLoop(self.graph), period, callback, self._timers.discard)
        self._timers.add(timer)
        self.run(timer.start)
        return timer

    # Threads

    @property
    def blocking(self) -> BlockingNode:
        """The same node for other threads: its verbs wait for their answers."""
        return BlockingNode(self)

    def run_blocking(self, function: Callable[[], Awaitable[T]]) -> T:
        """Run a coroutine function on the graph's event loop, and wait for what it returns.

        For threads: `node.run_blocking(lambda: node.params.get("/robot:speed"))`.

        Raises:
            WrongThread: called on the graph's own thread, which would wait for itself.
            NotRunning: the graph is not on an event loop, or was left meanwhile.
        """
        if not self.graph.running:
            raise NotRunning("a blocking call needs a running graph: enter it with 'async with graph'")
        if self.graph.on_graph_thread():
            raise WrongThread(
                "a blocking call on the graph's own thread would wait for itself: await it instead"
            )
        outcome: Future[T] = Future()

        async def run() -> None:
            try:
                result = await function()
            except Exception as error:
                outcome.set_exception(error)
            except BaseException:
                outcome.set_exception(NotRunning("the graph was left during a blocking call"))
                raise
            else:
                outcome.set_result(result)

        def begin() -> None:
            try:
                self.graph.spawn(run, f"blocking call of {self.name}")
            except NotRunning as error:
                outcome.set_exception(error)

        self.graph.run_on_graph(begin)
        return outcome.result()

    def run(self, function: Callable[[], T]) -> T:
        """What a plain function returns that is run on the graph's thread; what it raises is raised here."""
        if self.graph.on_graph_thread():
            return function()
        outcome: Future[T] = Future()

        def run() -> None:
            try:
                outcome.set_result(function())
            except Exception as error:
                outcome.set_exception(error)

        self.graph.run_on_graph(run)
        return outcome.result()

    # Leaving

    def close(self) -> None:
        """Leave the graph with everything that this node made."""
        self.run(self._close)

    def _close(self) -> None:
        for timer in tuple(self._timers):
            timer.cancel()
        self.parameters.close()
        self._participant.close()

    def __enter__(self) -> Node:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class _TimerLoop:
    """The loop of a graph, for timers; satisfies :class:`rwt_participant.timers.TimerLoop`."""

    def __init__(self, graph: Graph) -> None:
        self.spawn = graph.spawn
        self._graph = graph

    def soon(self, call: Callable[[], None]) -> None:
        """Run a plain function on the graph's thread: at once there, soon from elsewhere."""
        if self._graph.on_graph_thread():
            call()
        else:
            self._graph.run_on_graph(call)


class _GraphThread:
    """The thread of a graph; satisfies :class:`rwt_participant.blocking.LoopThread`."""

    def __init__(self, node: Node) -> None:
        self.run = node.run
        self.wait = node.run_blocking
        self._graph = node.graph

    @property
    def here(self) -> bool:
        """Whether this is the graph's thread, or no loop runs it."""
        return self._graph.on_graph_thread()


class BlockingNode(BlockingVerbs[Node]):
    """A node for other threads than its graph's: its verbs wait; see :class:`Node`, whose verbs these are.

    Attributes:
        node: the node itself, with everything that is not here.
        tf: where the frames are.
    """

    def __init__(self, node: Node) -> None:
        super().__init__(_GraphThread(node), node)
        self.node = node
        self.tf = BlockingTransforms(self._loop, node.tf)

    advertise = holds(Node.advertise, BlockingPublisher)
    publish = holds(Node.publish, BlockingPublisher)
    subscribe = holds(Node.subscribe, BlockingHandle)
    topic = holds(Node.topic, BlockingSubscription)
    once = waits(Node.once)
    call = waits(Node.call)
    advertise_action = holds(Node.advertise_action, BlockingHandle)
