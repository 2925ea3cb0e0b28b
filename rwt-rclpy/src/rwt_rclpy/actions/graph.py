"""`rclpy.action.graph`: listings of actions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_rclpy.exceptions import NodeNameNonExistentError

if TYPE_CHECKING:
    from rwt_rclpy.nodes.graph_queries import NamesAndTypes
    from rwt_rclpy.nodes.node import Node


def get_action_names_and_types(node: Node) -> NamesAndTypes:
    """Return all offered actions with their types."""
    with node.handle:
        return [(name, [kind]) for name, kind, _ in node._rwt_queries.actions()]


def get_action_server_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """Return the actions that a node offers. Raises NodeNameNonExistentError."""
    with node.handle:
        return node._rwt_queries.actions_of(remote_node_name, remote_node_namespace)


def get_action_client_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """Return the actions that a node has clients of, from its subscriptions to feedback.

    Raises:
        NodeNameNonExistentError: no such node.
    """
    full = f"{remote_node_namespace.rstrip('/')}/{remote_node_name}"
    if not remote_node_name or full not in node.get_fully_qualified_node_names():
        raise NodeNameNonExistentError(f"no node {full} is known")
    found: NamesAndTypes = []
    for topic, kinds in node.get_subscriber_names_and_types_by_node(remote_node_name, remote_node_namespace):
        name = topic.removesuffix("/_action/feedback")
        if name != topic:
            found.append((name, [kind.removesuffix("_FeedbackMessage") for kind in kinds]))
    return sorted(found)
