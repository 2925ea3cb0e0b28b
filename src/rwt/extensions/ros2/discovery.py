"""Discovery: nodes and endpoints of other processes, read from ROS 2's view of the graph."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from rwt.extensions.ros2 import qos as profiles
from rwt.extensions.ros2.connection import Connection, now
from rwt.extensions.ros2.inquiries import Inquiries
from rwt.extensions.ros2.rcl import GID_BYTES
from rwt.extensions.ros2.services import DEFINITION_ADVICE, FoundService
from rwt_graph.backend import RemoteEndpoint
from rwt_graph.names import is_printable, namespace_of

if TYPE_CHECKING:
    from rwt.extensions.ros2.services import Ros2Services
    from rwt.extensions.ros2.topics import Ros2Topics
    from rwt.extensions.ros2.type_supports.described_types import DescribedTypes
    from rwt_graph.backend import DistributedGraph
    from rwt_interfaces.structs import MessageType
    from rwt_participant.qos import QoS

#: Name that ROS 2 reports until it knows the node of an endpoint.
_UNKNOWN_NODE: Final = "_NODE_NAME_UNKNOWN_"


@dataclass(frozen=True, slots=True)
class FoundEndpoint:
    """Publisher or subscription, as ROS 2 reports it.

    Attributes:
        node: absolute name; empty if it is not known yet, or if the program has no ROS node.
        type_hash: `RIHS01_…`; empty if the other program does not announce one, as before Iron.
    """

    gid: bytes
    topic: str
    node: str
    type_name: str
    type_hash: str
    qos: QoS
    publishes: bool


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The ROS graph at one time.

    Attributes:
        time: when the reading began.
        nodes: number of nodes by name, without hidden ones.
    """

    time: float
    nodes: Counter[str]
    endpoints: dict[bytes, FoundEndpoint]
    services: frozenset[FoundService]


class Discovery:
    """Discovery that keeps the tables of a graph in step with ROS 2."""

    def __init__(
        self, graph: DistributedGraph, topics: Ros2Topics, services: Ros2Services, types: DescribedTypes
    ) -> None:
        self._graph = graph
        self._services = services
        self._types = types
        self._inquiries = Inquiries(types, services, graph.registry, graph.clock, self._use_learned)
        self._topics = graph.topic_table
        self._ros_topics = topics
        self._connection: Connection | None = None
        self._nodes: Counter[str] = Counter()
        self._endpoints: dict[bytes, tuple[FoundEndpoint, RemoteEndpoint]] = {}

    def open(self, connection: Connection) -> None:
        """Add what is known, and follow later changes."""
        self._connection = connection
        self._ros_topics.find_publishers = self._find_publishers
        self.apply(read(connection))
        self._inquiries.open(connection.owner)

    def close(self) -> None:
        """Ignore changes from now on."""
        self._connection = None
        self._inquiries.close()

    def on_change(self) -> None:
        """Read the graph, on the thread that waits for its changes."""
        connection = self._connection
        if connection is not None:
            self._graph.run_on_graph(partial(self.apply, read(connection)))

    def apply(self, snapshot: Snapshot) -> None:
        """Adapt the tables, on the graph's thread."""
        connection = self._connection
        if connection is None:
            return
        self._apply_nodes(snapshot.nodes - connection.own_nodes())
        connection.forget_closed(snapshot.time)
        found = {each.gid: each for each in _of_others(connection, snapshot.endpoints.values())}
        self._apply_endpoints(found)
        self._services.follow_nodes(self._nodes)
        own = connection.own_services
        self._services.apply(each for each in snapshot.services if each[:2] not in own)
        self._inquiries.follow()

    def _apply_nodes(self, nodes: Counter[str]) -> None:
        for name in (nodes - self._nodes).elements():
            self._graph.node_joined(name)
        for name in (self._nodes - nodes).elements():
            self._graph.node_left(name)
        self._nodes = nodes

    def _apply_endpoints(self, found: Mapping[bytes, FoundEndpoint]) -> None:
        changed: dict[str, None] = {}
        for gid, each in found.items():
            if gid not in self._endpoints or self._endpoints[gid][0] != each:
                self._add(each)
                changed[each.topic] = None
        for gid in self._endpoints.keys() - found.keys():
            each, endpoint = self._endpoints.pop(gid)
            self._ros_topics.publishers.pop(gid, None)
            self._topics.remote_left(each.topic, endpoint)
            changed[each.topic] = None
        for topic in changed:
            known = self._topics.find(topic)
            if known is None or not (known.remote_publishers or known.remote_subscribers):
                self._graph.problems.forget(topic)
            self._ros_topics.follow(topic)

    def _add(self, found: FoundEndpoint) -> None:
        type = self._types.message(found.type_name, found.type_hash)
        if type is None:
            self._inquiries.ask(found.type_name, found.type_hash, found.node)
            self._report(found.topic, found.type_name, found.type_hash)
        self._join(found, type)

    def _join(self, found: FoundEndpoint, type: MessageType | None) -> None:
        earlier = self._endpoints.get(found.gid)
        endpoint = RemoteEndpoint(found.node, found.type_name, type, found.qos)
        if earlier is not None:
            endpoint.cache = earlier[1].cache
        self._endpoints[found.gid] = (found, endpoint)
        if found.publishes:
            self._ros_topics.publishers[found.gid] = endpoint
        # Joined before the earlier one leaves, so that the topic keeps its type.
        self._topics.remote_joined(found.topic, endpoint, publishes=found.publishes)
        if earlier is not None:
            self._topics.remote_left(found.topic, earlier[1])

    def _use_learned(self) -> None:
        """Use the types that were learned; report those that could not be."""
        for found, endpoint in tuple(self._endpoints.values()):
            if endpoint.type is None:
                type = self._types.message(found.type_name, found.type_hash)
                if type is not None:
                    self._join(found, type)
                    self._ros_topics.follow(found.topic)
                else:
                    self._report(found.topic, found.type_name, found.type_hash)

    def _report(self, name: str, type_name: str, type_hash: str) -> None:
        """Report that a topic or service cannot be used, unless its type is being asked for."""
        reason = self._inquiries.reason(type_name, type_hash)
        if not reason:
            return
        if self._types.known(type_name) is not None:
            what = f"the robot defines {type_name} otherwise than this server ({type_hash})"
        else:
            what = f"its type {type_name} is not known here"
        text = f"{name} cannot be exchanged: {what}, and {reason}; {DEFINITION_ADVICE}"
        self._graph.problems.report(name, text)

    def _find_publishers(self, topic: str) -> None:
        connection = self._connection
        if connection is None:
            return
        for each in _of_others(connection, _publishers(connection, topic)):
            if each.gid not in self._endpoints:
                self._add(each)


def read(connection: Connection) -> Snapshot:
    """Read the ROS graph; safe from any thread."""
    began = now()
    all_names = connection.node.get_node_names_and_namespaces()
    names = list(filter(is_printable, (_absolute(name, namespace) for name, namespace in all_names)))
    endpoints: dict[bytes, FoundEndpoint] = {}
    for topic, _ in _rclpy.rclpy_get_topic_names_and_types(connection.node, False):
        if not is_printable(topic):
            continue
        for each in (*_publishers(connection, topic), *_subscriptions(connection, topic)):
            endpoints[each.gid] = each
    nodes = Counter(name for name in names if not _is_hidden(name))
    services = frozenset(each for name in {*names} for each in _services(connection, name))
    connection.service_hashes = {each[:3]: each[3:] for each in services}
    return Snapshot(began, nodes, endpoints, services)


def _services(connection: Connection, node: str) -> Iterator[FoundService]:
    try:
        found = _rclpy.rclpy_get_service_names_and_types_by_node(
            connection.node, node.rpartition("/")[2], namespace_of(node)
        )
    except _rclpy.NodeNameNonExistentError:
        return  # Left while the graph is read.
    for service, types in found:
        if not is_printable(service):
            continue
        for type_name in types:
            hashes = connection.service_hashes.get((node, service, type_name))
            if hashes is None:
                hashes = _service_hashes(connection, node, service)
            yield FoundService(node, service, type_name, *hashes)


def _service_hashes(connection: Connection, node: str, service: str) -> tuple[str, str]:
    """Return the type hashes of requests and responses, from the topics of DDS; empty if they have none."""
    requests = _rclpy.rclpy_get_subscriptions_info_by_topic(connection.node, f"rq{service}Request", True)
    responses = _rclpy.rclpy_get_publishers_info_by_topic(connection.node, f"rr{service}Reply", True)
    request, response = (
        next((_hash_text(info["topic_type_hash"]) for info in infos if _node_of(info) == node), "")
        for infos in (requests, responses)
    )
    return request, response


def _publishers(connection: Connection, topic: str) -> Iterator[FoundEndpoint]:
    infos = _rclpy.rclpy_get_publishers_info_by_topic(connection.node, topic, False)
    return _found(topic, infos, publishes=True)


def _subscriptions(connection: Connection, topic: str) -> Iterator[FoundEndpoint]:
    infos = _rclpy.rclpy_get_subscriptions_info_by_topic(connection.node, topic, False)
    return _found(topic, infos, publishes=False)


def _found(topic: str, infos: Iterable[Mapping[str, Any]], *, publishes: bool) -> Iterator[FoundEndpoint]:
    for info in infos:
        if not is_printable(f"/{info['topic_type']}"):
            continue
        yield FoundEndpoint(
            bytes(info["endpoint_gid"])[:GID_BYTES],
            topic,
            _node_of(info),
            info["topic_type"],
            _hash_text(info["topic_type_hash"]),
            profiles.from_ros(info["qos_profile"]),
            publishes,
        )


def _node_of(info: Mapping[str, Any]) -> str:
    is_known = info["node_name"] != _UNKNOWN_NODE
    return _absolute(info["node_name"], info["node_namespace"]) if is_known else ""


def _hash_text(type_hash: Mapping[str, Any]) -> str:
    version: int = type_hash["version"]
    return f"RIHS{version:02}_{type_hash['value'].hex()}" if version == 1 else ""


def _absolute(name: str, namespace: str) -> str:
    return f"{namespace.rstrip('/')}/{name}"


def _is_hidden(node: str) -> bool:
    return node.rpartition("/")[2].startswith("_")


def _of_others(connection: Connection, found: Iterable[FoundEndpoint]) -> Iterator[FoundEndpoint]:
    """Yield the endpoints of other processes."""
    own = Counter(names for names, _ in connection.own_subscriptions.values())
    for each in found:
        names = (each.node, each.topic)
        if each.publishes:
            if each.gid in connection.own_gids:
                continue
        elif own[names]:
            own[names] -= 1
            continue
        yield each
