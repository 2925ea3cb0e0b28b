"""Bridge of two graphs of one process, such as those of two ROS 1 masters, or of ROS 1 and ROS 2."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import Any, Final, TypeAlias

import anyio

from rwt_graph.api import Graph, Participant, Registration, Sample, ServiceCall, ServiceInfo, TopicInfo
from rwt_graph.errors import TypeConflict
from rwt_graph.names import is_for_clients
from rwt_interfaces.errors import InterfaceError, InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import MessageType, ServiceType
from rwt_participant.errors import CallFailed
from rwt_participant.qos import Durability, QoS

logger = logging.getLogger(__name__)

#: Name of the bridge's node in both graphs. Nodes whose names begin with it are bridges, too: what they
#: publish is not relayed again.
NODE: Final = "/rwt_bridge"

#: Name of the bridge's node for what clients of servers publish and offer; see :func:`is_for_clients`.
FOR_CLIENTS: Final = "/rwt_bridge_of_clients"

#: Seconds between two looks at the listings.
_LOOK_SECONDS: Final = 0.2

#: Topics of each graph itself.
_LOCAL_TOPICS: Final = frozenset(("/rosout", "/rosout_agg", "/parameter_events"))

#: Packages whose services concern one node, or one server.
_LOCAL_SERVICES: Final = frozenset(
    ("rcl_interfaces", "roscpp", "rosapi", "rosapi_msgs", "type_description_interfaces")
)

#: Samples that a latched topic retains, as several publishers may have one each.
_LATCHED: Final = QoS(depth=100, durability=Durability.TRANSIENT_LOCAL)

Convert: TypeAlias = Callable[[Payload], Payload]


class GraphBridge:
    """Relay of topics and services between two graphs.

    A topic is relayed while the other graph has subscribers; each of its names is the same there. Within one
    distribution, serialised messages are passed on; between two, they are converted field by field. Services
    are offered in the other graph unless a node offers the same name there. Parameters and actions of ROS 2
    are not relayed; actions of ROS 1 are topics.

    Example:
        >>> async with Ros1Graph(master="ros1://a") as first, Ros1Graph(master="ros1://b") as second:
        ...     GraphBridge(first, second).open()
    """

    def __init__(self, first: Graph, second: Graph) -> None:
        self._first, self._second = first, second
        self._directions: tuple[_Direction, ...] = ()

    def open(self) -> None:
        """Relay until :meth:`close`, or until the graphs are left. Both run on this event loop."""
        first, second = _Nodes(self._first), _Nodes(self._second)
        self._directions = _Direction(first, second), _Direction(second, first)
        self._second.observers.add(self._pass_on)
        self._second.problems.observers.add(self._first.problems.report)
        self._second.may_retain = lambda topic: self._first.may_retain(topic)
        self._first.spawn(self._run, "bridge of two graphs")

    def _pass_on(self, text: str, is_connected: bool) -> None:
        for observer in tuple(self._first.observers):
            observer(text, is_connected)

    async def _run(self) -> None:
        seen: tuple[int, ...] = ()
        while self._directions:
            versions = self._first.version, self._second.version
            if versions != seen:
                seen = versions
                for direction in self._directions:
                    direction.update()
            await anyio.sleep(_LOOK_SECONDS)

    def close(self) -> None:
        """Relay no more, and leave both graphs."""
        self._second.observers.discard(self._pass_on)
        self._second.problems.observers.discard(self._first.problems.report)
        for direction in self._directions:
            direction.close()
        self._directions = ()


class _Nodes:
    """Nodes of the bridge in one graph.

    What only clients of a server publish or offer in one graph, the robot displaces in the other, too.
    """

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self._of_robot = graph.participant(NODE)
        self._of_clients = graph.participant(FOR_CLIENTS, for_clients=True)

    def for_those(self, *, are_clients: bool) -> Participant:
        """Return the node that relays for clients, or for the robot."""
        return self._of_clients if are_clients else self._of_robot

    def close(self) -> None:
        """Leave the graph. Idempotent."""
        self._of_clients.close()
        self._of_robot.close()


class _Direction:
    """Relay from one graph to the other."""

    def __init__(self, source: _Nodes, target: _Nodes) -> None:
        self._source, self._source_nodes = source.graph, source
        self._target, self._target_nodes = target.graph, target
        self._topics: dict[str, _TopicRelay] = {}
        self._services: dict[str, tuple[ServiceType, Registration]] = {}
        self._reported: set[str] = set()

    def update(self) -> None:
        """Adapt the relays to the listings."""
        self._update_topics()
        self._update_services()

    def _update_topics(self) -> None:
        wanted = {each.name: each for each in self._source.topics() if self._is_relayed(each)}
        for name, relay in tuple(self._topics.items()):
            info = wanted.get(name)
            if info is None or not relay.fits(info):
                relay.close()
                del self._topics[name]
        for name, info in wanted.items():
            if name not in self._topics:
                self._attempt(f"topic {name}", partial(self._add_topic, info))
        for name, relay in self._topics.items():
            there = self._target.topic(name)
            relay.follow(
                is_wanted=there is not None and any(not _is_bridge(e.node) for e in there.subscribers)
            )

    def _is_relayed(self, info: TopicInfo) -> bool:
        return (
            info.type is not None
            and info.name not in _LOCAL_TOPICS
            and not _is_hidden(info.name)
            and not self._target.is_reserved(info.name)
            and any(not _is_bridge(each.node) for each in info.publishers)
        )

    def _add_topic(self, info: TopicInfo) -> None:
        assert info.type is not None
        self._topics[info.name] = _TopicRelay(info, info.type, self._source_nodes, self._target_nodes)

    def _update_services(self) -> None:
        wanted = {each.name: each for each in self._source.services() if self._is_offered(each)}
        for name, (type, registration) in tuple(self._services.items()):
            if name not in wanted or wanted[name].type is not type:
                registration.close()
                del self._services[name]
        for name, info in wanted.items():
            if name not in self._services:
                self._attempt(f"service {name}", partial(self._add_service, info))

    def _is_offered(self, info: ServiceInfo) -> bool:
        if _is_bridge(info.node) or _is_hidden(info.name) or self._source.is_reserved(info.name):
            return False
        if info.type.name.split("/")[0] in _LOCAL_SERVICES:
            return False
        there = self._target.service(info.name)
        if there is None or _is_bridge(there.node):
            return True
        return is_for_clients(there.node) and not is_for_clients(info.node)

    def _add_service(self, info: ServiceInfo) -> None:
        source, target = info.type, info.type
        if self._source.distro is not self._target.distro:
            target = self._target.registry.service(info.type.name)
        are_clients = is_for_clients(info.node)
        relay = _ServiceRelay(
            self._source_nodes.for_those(are_clients=are_clients),
            _converter(target.request, source.request),
            _converter(source.response, target.response),
        )
        node = self._target_nodes.for_those(are_clients=are_clients)
        self._services[info.name] = (source, node.advertise_service(info.name, target, relay.on_call))

    def _attempt(self, what: str, add: Callable[[], None]) -> None:
        try:
            add()
        except (InterfaceError, TypeConflict) as error:
            text = f"{what} is not relayed to the other graph: {error}"
            if text not in self._reported:
                self._reported.add(text)
                logger.warning("%s", text)

    def close(self) -> None:
        """Leave both graphs."""
        for relay in self._topics.values():
            relay.close()
        for _, registration in self._services.values():
            registration.close()
        self._topics.clear()
        self._services.clear()
        self._source_nodes.close()
        self._target_nodes.close()


class _TopicRelay:
    """Publisher in one graph of what is received in the other."""

    def __init__(
        self,
        info: TopicInfo,
        type: MessageType,
        source: _Nodes,
        target: _Nodes,
    ) -> None:
        self._name = info.name
        self._type = type
        self._is_latched = _is_latched(info)
        self._are_clients = _is_of_clients(info)
        graph = target.graph
        there = type if type.registry.distro is graph.distro else graph.registry.message(type.name)
        self._convert = _converter(type, there)
        self._node = source.for_those(are_clients=self._are_clients)
        node = target.for_those(are_clients=self._are_clients)
        self._publisher = node.advertise(info.name, there, _LATCHED if self._is_latched else QoS())
        self._subscription: Any = None
        self._is_reported = False

    def fits(self, info: TopicInfo) -> bool:
        """Return False if the topic has another type now, is latched and was not, or other publishers."""
        return (
            info.type is self._type
            and self._is_latched == _is_latched(info)
            and self._are_clients == _is_of_clients(info)
            and not self._publisher.is_closed
        )

    def follow(self, *, is_wanted: bool) -> None:
        """Subscribe while there are subscribers; to a latched topic for good, as its samples are retained."""
        if is_wanted and self._subscription is None:
            self._subscription = self._node.subscribe(self._name, self._on_sample, self._type)
        elif not is_wanted and self._subscription is not None and not self._is_latched:
            self._subscription.close()
            self._subscription = None

    def _on_sample(self, sample: Sample) -> None:
        if _is_bridge(sample.node):
            return
        try:
            self._publisher.publish(self._convert(sample.payload))
        except InvalidMessage as error:
            if not self._is_reported:
                self._is_reported = True
                logger.warning("messages of %s are not relayed to the other graph: %s", self._name, error)

    def close(self) -> None:
        """Leave both topics."""
        self._publisher.close()
        if self._subscription is not None:
            self._subscription.close()


class _ServiceRelay:
    """Provider in one graph that calls a service of the other."""

    def __init__(self, node: Participant, to_source: Convert, to_target: Convert) -> None:
        self._node = node
        self._to_source = to_source
        self._to_target = to_target

    def on_call(self, call: ServiceCall) -> None:
        """Pass a call on."""
        try:
            request = self._to_source(call.request)
        except InvalidMessage as error:
            call.fail(str(error))
            return
        pending = self._node.call_service(call.service, request, partial(self._on_reply, call))
        if not call.done:
            call.on_end = pending.cancel

    def _on_reply(self, call: ServiceCall, answer: Payload | CallFailed) -> None:
        if isinstance(answer, CallFailed):
            call.fail(str(answer))
            return
        try:
            call.reply(self._to_target(answer))
        except InvalidMessage as error:
            call.fail(str(error))


def _is_bridge(node: str) -> bool:
    return node.startswith(NODE)


def _is_hidden(name: str) -> bool:
    """Return True for the topics and services of actions on ROS 2."""
    return "/_" in name


def _is_of_clients(info: TopicInfo) -> bool:
    """Return True if only clients of servers publish on a topic."""
    return all(is_for_clients(each.node) for each in info.publishers if not _is_bridge(each.node))


def _is_latched(info: TopicInfo) -> bool:
    others = (each for each in info.publishers if not _is_bridge(each.node))
    return any(each.qos.durability is Durability.TRANSIENT_LOCAL for each in others)


def _converter(source: MessageType, target: MessageType) -> Convert:
    """Return a function that gives a message of one distribution the form of another."""
    if source is target:
        return lambda payload: payload
    fields = {slot.name.lower(): slot.attribute for slot in target.slots}
    names = {slot.attribute: fields.get(slot.name.lower(), slot.attribute) for slot in source.slots}
    if all(here == there for here, there in names.items()):
        return lambda payload: Payload.from_value(target, payload.value())

    def renamed(payload: Payload) -> Payload:
        # CameraInfo has D, K, R and P in ROS 1, and d, k, r and p in ROS 2.
        message = payload.value()
        return Payload.from_value(target, {there: getattr(message, here) for here, there in names.items()})

    return renamed
