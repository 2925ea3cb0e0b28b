"""`ros2node.api`: the nodes of a graph and their endpoints."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from rwt_rclpy.actions import graph
from rwt_rclpy.names.validation import topic_or_service_is_hidden

if TYPE_CHECKING:
    from rwt_rclpy.nodes.graph_queries import NamesAndTypes
    from rwt_rclpy.nodes.node import Node

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


def _infos(found: NamesAndTypes, *, hidden: bool) -> list[TopicInfo]:
    return [TopicInfo(*each) for each in found if hidden or not topic_or_service_is_hidden(each[0])]


def get_publisher_info(*, node: Node, remote_node_name: str, include_hidden: bool = False) -> list[TopicInfo]:
    """Return the topics that a node publishes."""
    remote = parse_node_name(remote_node_name)
    found = node.get_publisher_names_and_types_by_node(remote.name, remote.namespace)
    return _infos(found, hidden=include_hidden)


def get_subscriber_info(
    *, node: Node, remote_node_name: str, include_hidden: bool = False
) -> list[TopicInfo]:
    """Return the topics that a node subscribes to."""
    remote = parse_node_name(remote_node_name)
    found = node.get_subscriber_names_and_types_by_node(remote.name, remote.namespace)
    return _infos(found, hidden=include_hidden)


def get_service_server_info(
    *, node: Node, remote_node_name: str, include_hidden: bool = False
) -> list[TopicInfo]:
    """Return the services that a node offers."""
    remote = parse_node_name(remote_node_name)
    return _infos(
        node.get_service_names_and_types_by_node(remote.name, remote.namespace), hidden=include_hidden
    )


get_service_info = get_service_server_info


def get_service_client_info(
    *, node: Node, remote_node_name: str, include_hidden: bool = False
) -> list[TopicInfo]:
    """Return the services that a node calls."""
    remote = parse_node_name(remote_node_name)
    return _infos(
        node.get_client_names_and_types_by_node(remote.name, remote.namespace), hidden=include_hidden
    )


def get_action_server_info(
    *, node: Node, remote_node_name: str, include_hidden: bool = False
) -> list[TopicInfo]:
    """Return the actions that a node offers."""
    remote = parse_node_name(remote_node_name)
    found = graph.get_action_server_names_and_types_by_node(node, remote.name, remote.namespace)
    return _infos(found, hidden=include_hidden)


def get_action_client_info(
    *, node: Node, remote_node_name: str, include_hidden: bool = False
) -> list[TopicInfo]:
    """Return the actions that a node has clients of."""
    remote = parse_node_name(remote_node_name)
    found = graph.get_action_client_names_and_types_by_node(node, remote.name, remote.namespace)
    return _infos(found, hidden=include_hidden)
