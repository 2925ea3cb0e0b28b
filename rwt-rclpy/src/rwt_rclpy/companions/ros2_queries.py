"""`ros2topic.api`, `ros2service.api` and `ros2param.api`: queries of a graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import rwt_rclpy.client_library as rclpy
from rwt_rclpy.companions.rosidl_runtime_py import get_message, get_service
from rwt_rclpy.endpoints.client import Client
from rwt_rclpy.names.validation import topic_or_service_is_hidden
from rwt_rclpy.parameters.parameter import get_parameter_value as get_parameter_value
from rwt_rclpy.parameters.services import service_class

if TYPE_CHECKING:
    from rwt_rclpy.nodes.graph_queries import NamesAndTypes
    from rwt_rclpy.nodes.node import Node

#: Timeout of waiting for a node's parameter services, in seconds.
SERVICES_SECONDS = 5.0


def _shown(found: NamesAndTypes, hidden: bool) -> NamesAndTypes:
    return [each for each in found if hidden or not topic_or_service_is_hidden(each[0])]


def get_topic_names_and_types(*, node: Node, include_hidden_topics: bool = False) -> NamesAndTypes:
    """Return all topics with their types; on request also those with a part that begins with `_`."""
    return _shown(node.get_topic_names_and_types(), include_hidden_topics)


def get_topic_names(*, node: Node, include_hidden_topics: bool = False) -> list[str]:
    """Return the names of :func:`get_topic_names_and_types`."""
    found = get_topic_names_and_types(node=node, include_hidden_topics=include_hidden_topics)
    return [name for name, _ in found]


def get_service_names_and_types(*, node: Node, include_hidden_services: bool = False) -> NamesAndTypes:
    """Return all services with their types; hidden ones on request."""
    return _shown(node.get_service_names_and_types(), include_hidden_services)


def get_service_names(*, node: Node, include_hidden_services: bool = False) -> list[str]:
    """Return the names of :func:`get_service_names_and_types`."""
    found = get_service_names_and_types(node=node, include_hidden_services=include_hidden_services)
    return [name for name, _ in found]


def _wait_for_class(
    node: Node, known: Callable[[], NamesAndTypes], name: str, load: Callable[[str], Any], blocking: bool
) -> Any:
    while True:
        types = dict(known()).get(name, [])
        if len(types) > 1:
            raise RuntimeError(f"{name} has several types, {', '.join(types)}: expected one")
        if types:
            return load(types[0])
        if not blocking or not node.context.ok():
            return None
        rclpy.spin_once(node, timeout_sec=0.1)


def get_msg_class(
    node: Node, topic: str, blocking: bool = False, include_hidden_topics: bool = False
) -> Any | None:
    """Return the class of a topic's messages; None if there is no such topic.

    Args:
        node: node that queries.
        topic: name of the topic.
        blocking: True to wait for the topic.
        include_hidden_topics: True to accept hidden topics.

    Raises:
        RuntimeError: the topic has several types.
    """
    name = node.resolve_topic_name(topic, only_expand=True)
    known = partial(get_topic_names_and_types, node=node, include_hidden_topics=include_hidden_topics)
    return _wait_for_class(node, known, name, get_message, blocking)


def get_service_class(
    node: Node, service: str, blocking: bool = False, include_hidden_services: bool = False
) -> Any | None:
    """Return the class of a service; None if there is no such service. See :func:`get_msg_class`."""
    name = node.resolve_service_name(service, only_expand=True)
    known = partial(get_service_names_and_types, node=node, include_hidden_services=include_hidden_services)
    return _wait_for_class(node, known, name, get_service, blocking)


def _call(node: Node, node_name: str, service: str, **fields: Any) -> Any:
    """Call a parameter service of a node, spinning the calling node.

    Raises:
        RuntimeError: no node offers it within :data:`SERVICES_SECONDS`.
    """
    name = f"/{node_name.removeprefix('/')}/{service}"
    client: Client = node.create_client(service_class(service), name)
    try:
        if not client.wait_for_service(timeout_sec=SERVICES_SECONDS):
            raise RuntimeError(f"{name} is not offered: wait for service timed out")
        future = client.call_async(client.srv_type.Request(**fields))
        rclpy.spin_until_future_complete(node, future)
        return future.result()
    finally:
        node.destroy_client(client)


def call_get_parameters(*, node: Node, node_name: str, parameter_names: Sequence[str]) -> Any:
    """Return a node's response with values of parameters. Raises RuntimeError without the service."""
    return _call(node, node_name, "get_parameters", names=list(parameter_names))


def call_set_parameters(*, node: Node, node_name: str, parameters: Sequence[Any]) -> Any:
    """Return a node's response about setting parameters. Raises RuntimeError without the service."""
    return _call(node, node_name, "set_parameters", parameters=list(parameters))


def call_list_parameters(
    *, node: Node, node_name: str, prefixes: Sequence[str] | None = None, prefix: str | None = None
) -> Any:
    """Return a node's response with names of parameters. Raises RuntimeError without the service."""
    wanted = list(prefixes or ([prefix] if prefix else ()))
    return _call(node, node_name, "list_parameters", prefixes=wanted)


def call_describe_parameters(
    *, node: Node, node_name: str, parameter_names: Sequence[str] | None = None
) -> Any:
    """Return a node's response with descriptors of parameters. Raises RuntimeError without the service."""
    return _call(node, node_name, "describe_parameters", names=list(parameter_names or ()))
