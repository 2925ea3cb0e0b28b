"""Connection of this process to ROS 2: a context, a node for each participant, and their endpoints."""

from __future__ import annotations

import ctypes
import logging
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.qos import QoSProfile

from rwt.extensions.ros2 import qos as profiles
from rwt.extensions.ros2.rcl import GID_BYTES, Gid, check, raw_take, rcl, rmw, share_arenas
from rwt.extensions.ros2.type_supports.calls import RawClient, RawService
from rwt.extensions.ros2.type_supports.installed import NotInstalled
from rwt.extensions.ros2.type_supports.selection import type_supports
from rwt.extensions.ros2.wakeups import Wakeups
from rwt_graph.backend import DistributedGraph, NodeResources
from rwt_graph.errors import Ros2Error
from rwt_graph.names import namespace_of
from rwt_interfaces.structs import MessageType, ServiceType
from rwt_participant.qos import QoS

logger = logging.getLogger(__name__)

#: Profile of services and clients; the depth is only this side's.
_CALLS = QoS(depth=1000)


#: Last domain whose ports are below 65536.
_LAST_DOMAIN = 232


def _gid_of(publisher: Any) -> bytes:
    gid = Gid()
    handle = rcl().rcl_publisher_get_rmw_handle(publisher.pointer)
    result = rmw().rmw_get_gid_for_publisher(handle, ctypes.byref(gid))
    check(result, f"the publisher of {publisher.get_topic_name()} has no id")
    return bytes(gid.data)[:GID_BYTES]


@contextmanager
def _rejection() -> Iterator[None]:
    """Raise Ros2Error if ROS 2 rejects an endpoint, as it does two types of one name."""
    try:
        yield
    except _rclpy.RCLError as error:
        raise Ros2Error(str(error)) from error


class Connection:
    """Open connection to ROS 2.

    Attributes:
        node: hidden node, whose view of the ROS graph is read; `owner` are its resources.
        service_hashes: type hashes of requests and responses of services in other processes, by node, name
            and type. Used on the thread that reads the ROS graph.
        wakeups: notifications of the endpoints.
        take: takes the next sample of a subscription, on the graph's thread.
        own_gids: publishers of this process, each with the time of its closing or infinity.
        own_subscriptions: subscriptions of this process by node and topic, likewise.
        own_services: services of this process by node and name, likewise.
    """

    def __init__(
        self,
        graph: DistributedGraph,
        domain: int | None,
        on_graph_change: Callable[[], None],
        *,
        use_callbacks: bool,
    ) -> None:
        share_arenas()
        self._context = Context()
        try:
            self._context.init(args=[], initialize_logging=False, domain_id=domain)
        except RuntimeError as error:
            raise Ros2Error(f"cannot join ROS 2: {error}") from error
        self._check_domain()
        # Nodes by name, each with its participants.
        self._nodes: dict[str, tuple[Any, set[NodeResources]]] = {}
        self.owner = NodeResources(f"/_rwt_graph_{os.getpid()}", private=True)
        self.node = self.node_of(self.owner)
        self.service_hashes: dict[tuple[str, str, str], tuple[str, str]] = {}
        self._types = type_supports()
        self.run_on_graph = graph.run_on_graph
        self.own_gids: dict[bytes, float] = {}
        self.own_subscriptions: dict[object, tuple[tuple[str, str], float]] = {}
        self.own_services: dict[tuple[str, str], float] = {}
        self._missing: set[str] = set()
        self.take = raw_take()
        self.wakeups = Wakeups(graph, self._context, self.node, on_graph_change, use_callbacks=use_callbacks)

    def _check_domain(self) -> None:
        """Raise Ros2Error for a domain without ports: Fast DDS would end the process."""
        uses_ports = "zenoh" not in _rclpy.rclpy_get_rmw_implementation_identifier()
        if uses_ports and self.domain > _LAST_DOMAIN:
            domain = self.domain
            self._context.try_shutdown()
            self._context.destroy()
            raise Ros2Error(
                f"cannot join ROS 2: ROS_DOMAIN_ID is {domain}, and DDS has ports for the domains 0 to "
                f"{_LAST_DOMAIN}: set the robot's own number, from 0 to 101 on most systems"
            )

    @property
    def domain(self) -> int:
        """ROS_DOMAIN_ID of the graph."""
        return int(self._context.get_domain_id())

    def _make_node(self, name: str) -> Any:
        arguments = (name.rpartition("/")[2], namespace_of(name), self._context.handle, None, False, False)
        try:
            return _rclpy.Node(*arguments, QoSProfile(depth=1000).get_c_qos_profile())
        except TypeError:
            return _rclpy.Node(*arguments)  # Before Kilted, `/rosout` has a fixed profile.

    # Nodes

    def node_of(self, owner: NodeResources) -> Any:
        """Return the node of a participant, made on first use.

        Participants with the same name share it: ROS 2 warns of two nodes with one name.
        """
        found = self._nodes.get(owner.name)
        if found is None:
            found = self._nodes[owner.name] = (self._make_node(owner.name), set())
        node, participants = found
        participants.add(owner)
        return node

    def forget_node(self, owner: NodeResources) -> None:
        """Remove the node of a participant that left, after its endpoints, unless others share it."""
        node, participants = self._nodes.get(owner.name, (None, set()))
        participants.discard(owner)
        if node is not None and not participants:
            del self._nodes[owner.name]
            node.destroy_when_not_in_use()

    def own_nodes(self) -> Counter[str]:
        """Return the number of nodes of this process, by name."""
        return Counter(self._nodes.keys())

    # Endpoints

    def publisher(self, owner: NodeResources, topic: str, type: MessageType, qos: QoS) -> tuple[Any, bytes]:
        """Make a raw publisher; return it with its GID.

        Raises:
            Ros2Error: ROS 2 rejects it.
        """
        node = self.node_of(owner)
        with _rejection():
            publisher = _rclpy.Publisher(node, self._types.message(type), topic, profiles.to_ros(qos))
        return publisher, _gid_of(publisher)

    def subscription(self, owner: NodeResources, topic: str, type: MessageType, qos: QoS) -> Any:
        """Make a raw subscription.

        Raises:
            Ros2Error: ROS 2 rejects it.
        """
        made = self._types.message(type)
        with _rejection():
            return _rclpy.Subscription(self.node_of(owner), made, topic, profiles.to_ros(qos))

    def service(self, owner: NodeResources, name: str, type: ServiceType) -> RawService:
        """Make a raw service.

        Raises:
            Ros2Error: ROS 2 rejects it.
        """
        made, forms = self._types.service(type)
        with _rejection():
            endpoint = _rclpy.Service(self.node_of(owner), made, name, profiles.to_ros(_CALLS))
        return RawService(endpoint, name, forms)

    def client(self, owner: NodeResources, name: str, type: ServiceType) -> RawClient:
        """Make a raw client of a service.

        Raises:
            Ros2Error: ROS 2 rejects it.
        """
        made, forms = self._types.service(type)
        with _rejection():
            endpoint = _rclpy.Client(self.node_of(owner), made, name, profiles.to_ros(_CALLS))
        return RawClient(endpoint, name, forms)

    def note_missing(self, name: str, error: NotInstalled) -> None:
        """Log that a topic or service is not exchanged with ROS 2; once for each package that it lacks."""
        if error.package not in self._missing:
            self._missing.add(error.package)
            others = f"{name}, with all others of {error.package},"
            logger.info("%s is only for clients of this server: %s", others, error)

    def forget_closed(self, before: float) -> None:
        """Forget endpoints that were closed before a time: the graph read since then does not list them."""
        self.own_gids = {gid: closed for gid, closed in self.own_gids.items() if closed >= before}
        self.own_subscriptions = {
            key: entry for key, entry in self.own_subscriptions.items() if entry[1] >= before
        }
        self.own_services = {key: closed for key, closed in self.own_services.items() if closed >= before}

    def close(self) -> None:
        """Leave ROS 2; all endpoints have been closed."""
        self.wakeups.close()
        for node, _ in self._nodes.values():
            node.destroy_when_not_in_use()
        self._nodes.clear()
        self._context.try_shutdown()
        self._context.destroy()


def now() -> float:
    """Return the time by which the closing of endpoints and the readings of the graph are ordered."""
    return time.monotonic()
