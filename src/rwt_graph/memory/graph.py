"""Graph in one process: tables of topics, services and actions, nodes, and an event loop."""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import wraps
from typing import Self, TypeVar

from rwt_graph.api import (
    ActionInfo,
    CallObserver,
    ClientGoal,
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
from rwt_graph.clock import Clock, SimulatedClock, WallClock
from rwt_graph.errors import NotRunning
from rwt_graph.memory.actions import Actions, MemoryActionServer, cancel_service
from rwt_graph.memory.runtime import Runtime
from rwt_graph.memory.services import Services
from rwt_graph.memory.tables import Changes, NodeResources
from rwt_graph.memory.topics import Topics
from rwt_graph.names import validate
from rwt_graph.nodes.node import Node
from rwt_graph.parameters.tree import ParameterTree
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.qos import BEST_AVAILABLE, DEFAULT_QOS, QoS

T = TypeVar("T")


class MemoryParticipant(Participant):
    """Node of a graph; owns what it created until it is closed."""

    def __init__(self, graph: MemoryGraph, name: str, *, private: bool = False) -> None:
        self.name = name
        self.graph = graph
        self.owner = NodeResources(name, private=private)
        self._closed = False

    def _check_open(self) -> None:
        if self._closed:
            raise NotRunning(f"node {self.name} was closed")

    def advertise(
        self,
        topic: str,
        type: MessageType,
        qos: QoS = DEFAULT_QOS,
    ) -> Publisher:
        self._check_open()
        return self.graph.topic_table.advertise(validate(topic), type, qos, self.owner)

    def subscribe(
        self,
        topic: str,
        on_sample: Callable[[Sample], None],
        type: MessageType | None = None,
        qos: QoS = BEST_AVAILABLE,
    ) -> Subscription:
        self._check_open()
        return self.graph.topic_table.subscribe(validate(topic), on_sample, type, qos, self.owner)

    def advertise_service(
        self,
        service: str,
        type: ServiceType,
        on_call: Callable[[ServiceCall], None],
    ) -> Registration:
        self._check_open()
        return self.graph.service_table.advertise(validate(service), type, self.owner, on_call)

    def call_service(
        self, service: str, request: Payload, on_reply: OnReply, timeout: float | None = None
    ) -> PendingCall:
        self._check_open()
        return self.graph.service_table.call(service, request, on_reply, timeout, self.owner)

    def advertise_action(
        self,
        action: str,
        type: ActionType,
        on_goal: Callable[[ServerGoal], None],
    ) -> Registration:
        self._check_open()
        graph = self.graph
        server = graph.action_table.advertise(validate(action), type, self.owner, on_goal)
        if graph.distro.action_transport == "services":
            try:
                server.on_close = graph.offer_action_services(self, server)
            except BaseException:
                server.close()
                raise
        return server

    def send_goal(
        self, action: str, goal: Payload, events: GoalEvents, goal_id: str | None = None
    ) -> ClientGoal:
        self._check_open()
        return self.graph.action_table.send(action, goal, events, goal_id, self.owner)

    def cancel_goal(self, action: str, goal_id: str) -> None:
        self.graph.action_table.cancel(action, goal_id, self.owner)

    def cancel_every_goal(self, action: str) -> Iterator[None]:
        return self.graph.action_table.cancel_every(action, self.owner)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self.owner.release_all()
            self.graph.left(self)


def _cached(make: Callable[[MemoryGraph], T]) -> Callable[[MemoryGraph], T]:
    """Return a method that calls `make` on the first request after a change, and keeps what it returned."""
    attribute = f"_cached_{make.__name__}"

    @wraps(make)
    def listing(graph: MemoryGraph) -> T:
        count = graph.changes.count
        cached: tuple[int, T] | None = getattr(graph, attribute, None)
        if cached is None or cached[0] != count:
            cached = (count, make(graph))
            setattr(graph, attribute, cached)
        return cached[1]

    return listing


class MemoryGraph(Runtime, Graph):
    """Graph with all nodes in this process.

    Args:
        registry: interfaces and distribution; the standard ones of jazzy by default.
        clock: the wall clock by default.
        dds_rules: match QoS, and call every service of a name, as DDS does. By default all endpoints of a
            topic are connected, and the newest service of a name answers.
    """

    def __init__(
        self, registry: Registry | None = None, clock: Clock | None = None, *, dds_rules: bool = False
    ) -> None:
        self.registry = registry = registry or Registry()
        self.distro = registry.distro
        super().__init__(clock or WallClock())
        self.parameters = ParameterTree()
        if self.distro.master_version is not None:
            # As ROS 1's core sets them; line ends are those of its commands.
            self.parameters.set("/rosdistro", f"{self.distro.name}\n")
            self.parameters.set("/rosversion", f"{self.distro.master_version}\n")
            self.parameters.set("/run_id", str(uuid.uuid1()))
        self.changes = changes = Changes()
        self.dds_rules = dds_rules
        self.topic_table = Topics(registry, self.clock, changes, dds_rules=dds_rules)
        self.service_table = Services(self.clock, changes, dds_rules=dds_rules)
        self.action_table = Actions(changes)
        self._nodes: Counter[str] = Counter()
        self._participants: dict[MemoryParticipant, None] = {}
        # Topics of the graph itself. Viewers derive the ROS version from the type of `/rosout`, so it must
        # exist before any node logs.
        self._system = MemoryParticipant(self, self.distro.graph_node, private=True)
        self._system.advertise("/rosout", registry.message(self.distro.rosout_type))
        if isinstance(self.clock, SimulatedClock):
            self._clock_topic = self._system.advertise("/clock", registry.message("rosgraph_msgs/Clock"))
            self.clock.listeners.append(self._publish_clock)

    def _publish_clock(self, now_ns: int) -> None:
        time = {"clock": self.distro.time(now_ns)}
        self._clock_topic.publish(Payload.from_value(self._clock_topic.type, time))

    def participant(self, name: str, *, for_clients: bool = False) -> MemoryParticipant:
        participant = self.make_participant(validate(name))
        participant.owner.for_clients = for_clients
        self._participants[participant] = None
        self.node_joined(name)
        return participant

    def make_participant(self, name: str) -> MemoryParticipant:
        """Return a new participant; overridden by graphs whose nodes do more."""
        return MemoryParticipant(self, name)

    def left(self, participant: MemoryParticipant) -> None:
        if participant in self._participants:
            del self._participants[participant]
            self.node_left(participant.name)

    def node_joined(self, name: str) -> None:
        """Count a new participant of that name, in this process or another."""
        self._nodes[name] += 1
        self.changes.note()

    def node_left(self, name: str) -> None:
        self._nodes[name] -= 1
        self.changes.note()
        if not self._nodes[name]:
            del self._nodes[name]

    def reserve(self, names: Iterable[str]) -> None:
        names = tuple(names)
        self.service_table.reserve(names)
        self.topic_table.reserve(names)

    def is_reserved(self, name: str) -> bool:
        return name in self.topic_table.reserved

    def offer_action_services(
        self, participant: MemoryParticipant, server: MemoryActionServer
    ) -> Callable[[], None]:
        """Offer the services and topics of an action on ROS 2; returns a function that withdraws them."""
        cancel = self.registry.service("action_msgs/CancelGoal")
        name = f"{server.name}/_action/cancel_goal"
        return participant.advertise_service(name, cancel, cancel_service(server, cancel)).close

    def node(self, name: str, namespace: str = "/") -> Node:
        """Return a new :class:`~rwt_graph.nodes.node.Node` of this graph."""
        return Node(self, name, namespace)

    @property
    def version(self) -> int:
        return self.changes.count

    @_cached
    def topics(self) -> tuple[TopicInfo, ...]:
        return _infos(self.topic_table.names(), self.topic_table.info)

    def topic(self, name: str) -> TopicInfo | None:
        return self.topic_table.info(name)

    @_cached
    def services(self) -> tuple[ServiceInfo, ...]:
        return _infos(self.service_table.names(), self.service_table.info)

    def service(self, name: str) -> ServiceInfo | None:
        return self.service_table.info(name)

    def count_services(self, name: str) -> int:
        provider = self.service_table.current.get(name)
        others = [] if provider is None else self.service_table.others(provider)
        return super().count_services(name) + len(others)

    @_cached
    def actions(self) -> tuple[ActionInfo, ...]:
        return _infos(self.action_table.names(), self.action_table.info)

    def action(self, name: str) -> ActionInfo | None:
        return self.action_table.info(name)

    @_cached
    def nodes(self) -> tuple[NodeInfo, ...]:
        topics = self.topic_table.all()
        kinds = [
            _by_node((end.node, topic.name) for topic in topics for end in topic.all_publishers),
            _by_node((end.node, topic.name) for topic in topics for end in topic.all_subscribers),
            _by_node(self.service_table.by_node()),
            _by_node(self.action_table.by_node()),
        ]
        return tuple(
            NodeInfo(name, *(tuple(sorted(set(of.get(name, ())))) for of in kinds))
            for name in sorted(self._nodes)
        )

    def topic_names(self) -> Sequence[str]:
        return tuple(topic.name for topic in self.topic_table.all())

    def action_names(self) -> Sequence[str]:
        return self.action_table.names()

    def observe_calls(self, observer: CallObserver | None) -> bool:
        self.service_table.observer = observer
        self.action_table.observer = observer
        return True

    async def __aenter__(self) -> Self:
        await self._start()
        try:
            await self._join()
        except BaseException:
            await self.__aexit__()
            raise
        return self

    async def _join(self) -> None:
        """Connect to other processes; overridden by graphs that span several."""

    async def __aexit__(self, *exc: object) -> None:
        await self._stop(self._close_participants)

    def _close_participants(self) -> None:
        for participant in tuple(reversed(self._participants)):
            participant.close()
        if isinstance(self.clock, SimulatedClock) and self._publish_clock in self.clock.listeners:
            self.clock.listeners.remove(self._publish_clock)
        self._system.close()


def _infos(names: Iterable[str], find: Callable[[str], T | None]) -> tuple[T, ...]:
    return tuple(info for name in names if (info := find(name)))


def _by_node(pairs: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for node, name in pairs:
        found.setdefault(node, []).append(name)
    return found
