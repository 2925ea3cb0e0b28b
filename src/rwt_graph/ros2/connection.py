"""Connection of this process to ROS 2: a context, a node for each participant, and their endpoints."""

from __future__ import annotations

import ctypes
import os
import time
from collections import Counter
from typing import TYPE_CHECKING, Any

from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.qos import QoSProfile

from rwt_graph.errors import Ros2Error
from rwt_graph.names import namespace_of
from rwt_graph.ros2 import qos as profiles
from rwt_graph.ros2.ament import library
from rwt_graph.ros2.take import GID_BYTES, Gid, raw_take
from rwt_graph.ros2.type_supports import message_class
from rwt_graph.ros2.wakeups import Wakeups

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt_graph.memory.graph import MemoryGraph
    from rwt_graph.memory.tables import NodeResources
    from rwt_interfaces.structs import MessageType
    from rwt_participant.qos import QoS


class _PublisherIds:
    """Functions of rcl and the middleware that return the GID of a publisher; `rclpy` has none."""

    def __init__(self) -> None:
        self._rcl = ctypes.CDLL(library("librcl.so"))
        self._rmw = ctypes.CDLL(library(f"lib{_rclpy.rclpy_get_rmw_implementation_identifier()}.so"))
        self._rcl.rcl_publisher_get_rmw_handle.restype = ctypes.c_void_p
        self._rcl.rcl_publisher_get_rmw_handle.argtypes = (ctypes.c_void_p,)
        self._rmw.rmw_get_gid_for_publisher.argtypes = (ctypes.c_void_p, ctypes.c_void_p)

    def gid_of(self, publisher: Any) -> bytes:
        """Return the GID of a publisher."""
        gid = Gid()
        handle = self._rcl.rcl_publisher_get_rmw_handle(publisher.pointer)
        if self._rmw.rmw_get_gid_for_publisher(handle, ctypes.byref(gid)) != 0:
            raise Ros2Error(f"the middleware gives no id for the publisher of {publisher.get_topic_name()}")
        return bytes(gid.data)[:GID_BYTES]


class Connection:
    """Open connection to ROS 2.

    Attributes:
        node: hidden node, whose view of the ROS graph is read.
        wakeups: notifications of the endpoints.
        take: takes the next sample of a subscription, on the graph's thread.
        own_gids: publishers of this process, each with the time of its closing or infinity.
        own_subscriptions: subscriptions of this process by node and topic, likewise.
    """

    def __init__(
        self,
        graph: MemoryGraph,
        domain: int | None,
        on_graph_change: Callable[[], None],
        *,
        use_callbacks: bool,
    ) -> None:
        self._context = Context()
        try:
            self._context.init(args=[], initialize_logging=False, domain_id=domain)
        except RuntimeError as error:
            raise Ros2Error(f"cannot join ROS 2: {error}") from error
        self._nodes: dict[NodeResources, Any] = {}
        self.node = self._make_node(f"/_rwt_graph_{os.getpid()}")
        self.run_on_graph = graph.run_on_graph
        self.own_gids: dict[bytes, float] = {}
        self.own_subscriptions: dict[object, tuple[tuple[str, str], float]] = {}
        self._ids = _PublisherIds()
        self.take = raw_take()
        self.wakeups = Wakeups(graph, self._context, self.node, on_graph_change, use_callbacks=use_callbacks)

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
        """Return the node of a participant, made on first use."""
        node = self._nodes.get(owner)
        if node is None:
            node = self._nodes[owner] = self._make_node(owner.name)
        return node

    def forget_node(self, owner: NodeResources) -> None:
        """Remove the node of a participant that left, after its endpoints."""
        node = self._nodes.pop(owner, None)
        if node is not None:
            node.destroy_when_not_in_use()

    def own_nodes(self) -> Counter[str]:
        """Return the number of nodes of this process, by name."""
        return Counter(owner.name for owner in self._nodes)

    # Endpoints

    def publisher(self, owner: NodeResources, topic: str, type: MessageType, qos: QoS) -> tuple[Any, bytes]:
        """Make a raw publisher; return it with its GID.

        Raises:
            Ros2Error: its type is not installed with ROS 2.
        """
        node = self.node_of(owner)
        publisher = _rclpy.Publisher(node, message_class(type), topic, profiles.to_ros(qos))
        return publisher, self._ids.gid_of(publisher)

    def subscription(self, owner: NodeResources, topic: str, type: MessageType, qos: QoS) -> Any:
        """Make a raw subscription.

        Raises:
            Ros2Error: its type is not installed with ROS 2.
        """
        return _rclpy.Subscription(self.node_of(owner), message_class(type), topic, profiles.to_ros(qos))

    def forget_closed(self, before: float) -> None:
        """Forget endpoints that were closed before a time: the graph read since then does not list them."""
        self.own_gids = {gid: closed for gid, closed in self.own_gids.items() if closed >= before}
        self.own_subscriptions = {
            key: entry for key, entry in self.own_subscriptions.items() if entry[1] >= before
        }

    def close(self) -> None:
        """Leave ROS 2; all endpoints have been closed."""
        self.wakeups.close()
        for owner in tuple(self._nodes):
            self.forget_node(owner)
        self.node.destroy_when_not_in_use()
        self._context.try_shutdown()
        self._context.destroy()


def now() -> float:
    """Return the time by which the closing of endpoints and the readings of the graph are ordered."""
    return time.monotonic()
