"""`ros2node.api`: the nodes of a graph and their endpoints."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from rwt_rclpy.actions import graph
from rwt_rclpy.names.validation import topic_or_service_is_hidden
from rwt_rclpy.nodes.node import Node

if TYPE_CHECKING:
    from rwt_rclpy.nodes.graph_queries import NamesAndTypes

HIDDEN_NODE_PREFIX = "_"


class NodeName(NamedTuple):
    """Name, namespace and absolute name of a node."""

    name: str
    namespace: str
    full_name: str


class TopicInfo(NamedTuple):
    """Topic, service or action with its types."""

    name: str
    types: list[str]


def get_absolute_node_name(node_name: str) -> str | None:
    """Return a name with a leading slash; None for None."""
    if not node_name:
        return None
    return node_name if node_name.startswith("/") else f"/{node_name}"


def parse_node_name(node_name: str) -> NodeName:
    """Split the absolute name of a node."""
    full = get_absolute_node_name(node_name) or "/"
    namespace, _, name = full.rpartition("/")
    return NodeName(name, namespace or "/", full)


def get_node_names(*, node: Any, include_hidden_nodes: bool = False) -> list[NodeName]:
    """Return all nodes, by default without those whose name begins with an underscore."""
    return [
        parse_node_name(full)
        for full in node.get_fully_qualified_node_names()
        if include_hidden_nodes or not full.rpartition("/")[2].startswith(HIDDEN_NODE_PREFIX)
    ]


def _query(ask: Callable[[Node, str, str], NamesAndTypes], what: str) -> Callable[..., list[TopicInfo]]:
    """Return a function that queries a node about another one."""

    def infos(*, node: Node, remote_node_name: str, include_hidden: bool = False) -> list[TopicInfo]:
        remote = parse_node_name(remote_node_name)
        found = ask(node, remote.name, remote.namespace)
        return [
            TopicInfo(*each) for each in found if include_hidden or not topic_or_service_is_hidden(each[0])
        ]

    infos.__doc__ = f"Return the {what}."
    return infos


get_publisher_info = _query(Node.get_publisher_names_and_types_by_node, "topics that a node publishes")
get_subscriber_info = _query(Node.get_subscriber_names_and_types_by_node, "topics that a node subscribes to")
get_service_server_info = _query(Node.get_service_names_and_types_by_node, "services that a node offers")
get_service_info = get_service_server_info
get_service_client_info = _query(Node.get_client_names_and_types_by_node, "services that a node calls")
get_action_server_info = _query(graph.get_action_server_names_and_types_by_node, "actions that a node offers")
get_action_client_info = _query(
    graph.get_action_client_names_and_types_by_node, "actions that a node has clients of"
)
