"""Services about the running graph: topics, services, actions, nodes, time."""

from __future__ import annotations

import socket
from typing import Any, Final

from rwt.rosapi.service import CONVENTIONS, Answer, Service
from rwt_graph.api import TopicInfo
from rwt_graph.disclosure import NOTHING, AsksAbout, Lists, ListsProviders
from rwt_graph.errors import InvalidGraphName
from rwt_graph.names import resolve
from rwt_graph.nodes.node import Node
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.names import two_part
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.errors import ServiceFailed

#: Suffixes of an actionlib server's topics; all five together are a ROS 1 action (API-12).
_ACTIONLIB = ("cancel", "feedback", "goal", "result", "status")


def topics(node: Node, _: Any) -> Answer:
    """Return every topic with its type (API-02)."""
    topics = [topic for topic in node.graph.topics() if not _is_hidden(topic.name)]
    return {
        "topics": [topic.name for topic in topics],
        "types": [_type_of(node, topic) for topic in topics],
    }


def topics_for_type(node: Node, request: Any) -> Answer:
    """Return the topics of one type, in either spelling of its name."""
    wanted = _two_part(request.type)
    return {
        "topics": [topic.name for topic in node.graph.topics() if _two_part(_type_of(node, topic)) == wanted]
    }


def topics_and_raw_types(node: Node, _: Any) -> Answer:
    """Return every topic with its type and the full text of the definition (API-06)."""
    topics = [topic for topic in node.graph.topics() if topic.type is not None and not _is_hidden(topic.name)]
    return {
        "topics": [topic.name for topic in topics],
        "types": [_type_name(node, topic.type) for topic in topics],
        "typedefs_full_text": [node.graph.registry.full_text(topic.type) for topic in topics if topic.type],
    }


def topic_type(node: Node, request: Any) -> Answer:
    """Return the type of a topic; empty if it does not exist."""
    topic = _topic(node, request.topic)
    return {"type": _type_of(node, topic) if topic else ""}


def publishers(node: Node, request: Any) -> Answer:
    """Return the nodes that publish on a topic."""
    topic = _topic(node, request.topic)
    return {"publishers": sorted({end.node for end in topic.publishers}) if topic else []}


def subscribers(node: Node, request: Any) -> Answer:
    """Return the nodes that subscribe to a topic."""
    topic = _topic(node, request.topic)
    return {"subscribers": sorted({end.node for end in topic.subscribers}) if topic else []}


def services(node: Node, _: Any) -> Answer:
    """Return every service."""
    return {"services": [service.name for service in node.graph.services() if not _is_hidden(service.name)]}


def services_for_type(node: Node, request: Any) -> Answer:
    """Return the services of one type."""
    wanted = _two_part(request.type)
    return {"services": [service.name for service in node.graph.services() if service.type.name == wanted]}


def service_type(node: Node, request: Any) -> Answer:
    """Return the type of a service; empty if it does not exist."""
    service = node.graph.service(_absolute(request.service))
    return {"type": _type_name(node, service.type) if service else ""}


def service_providers(node: Node, request: Any) -> Answer:
    """Return the nodes that provide services of a type; the request names it in the field `service`."""
    wanted = _two_part(request.service)
    found = {service.node for service in node.graph.services() if service.type.name == wanted}
    return {"providers": sorted(found)}


def service_node(node: Node, request: Any) -> Answer:
    """Return the node that provides a service; empty if there is none."""
    service = node.graph.service(_absolute(request.service))
    return {"node": service.node if service else ""}


def service_host(node: Node, request: Any) -> Answer:
    """Return the host of a service; empty if it does not exist."""
    service = node.graph.service(_absolute(request.service))
    return {"host": socket.gethostname() if service else ""}


def nodes(node: Node, _: Any) -> Answer:
    """Return every node, each name once."""
    return {"nodes": sorted({each.name for each in node.graph.nodes()})}


def node_details(node: Node, request: Any) -> Answer:
    """Return the topics and services of a node; an unknown one is empty in ROS 1, fails in ROS 2 (API-14)."""
    name = _absolute(request.node)
    found = [each for each in node.graph.nodes() if each.name == name]
    if not found and CONVENTIONS[node.distro.conventions].fails_for_unknown_nodes:
        raise ServiceFailed(f"node {name} does not exist")
    return {
        "subscribing": sorted({topic for each in found for topic in each.subscribing}),
        "publishing": sorted({topic for each in found for topic in each.publishing}),
        "services": sorted({service for each in found for service in each.services}),
    }


def action_servers(node: Node, _: Any) -> Answer:
    """Return every action, including those that are sets of topics in ROS 1 (API-12)."""
    topics = {topic.name for topic in node.graph.topics()}
    prefixes = {name.removesuffix("/goal") for name in topics if name.endswith("/goal")}
    over_topics = {prefix for prefix in prefixes if all(f"{prefix}/{end}" in topics for end in _ACTIONLIB)}
    return {"action_servers": sorted(over_topics | {action.name for action in node.graph.actions()})}


def action_type(node: Node, request: Any) -> Answer:
    """Return the type of an action; empty if it does not exist."""
    name = _absolute(request.action)
    action = node.graph.action(name)
    if action is not None:
        return {"type": _type_name(node, action.type)}
    goal = node.graph.topic(f"{name}/goal")
    suffix = "ActionGoal"
    known = goal is not None and goal.type is not None and goal.type.name.endswith(suffix)
    return {"type": goal.type.name.removesuffix(suffix) if goal and goal.type and known else ""}


def get_time(node: Node, _: Any) -> Answer:
    """Return the ROS time (API-11)."""
    return {"time": node.graph.distro.time(node.graph.clock.time_ns())}


def get_ros_version(node: Node, _: Any) -> Answer:
    """Return the version of ROS and the distribution of the graph."""
    return {"version": node.graph.distro.ros_version, "distro": node.graph.distro.name}


def _topic(node: Node, name: str) -> TopicInfo | None:
    return node.graph.topic(_absolute(name))


def _type_of(node: Node, topic: TopicInfo) -> str:
    """Return the name of a topic's type; other processes may use a type that is not known here."""
    if topic.type is not None:
        return _type_name(node, topic.type)
    return next((end.type for end in (*topic.publishers, *topic.subscribers) if end.type), "")


def _type_name(node: Node, type: MessageType | ServiceType | ActionType | None) -> str:
    return "" if type is None else node.graph.registry.type_name(type)


def _is_hidden(name: str) -> bool:
    """Return True if ROS 2 does not list a name: a part of it begins with an underscore (API-02)."""
    return "/_" in name


def _absolute(name: str) -> str:
    """Return the absolute name; an invalid name is returned unchanged."""
    try:
        return resolve(name)
    except InvalidGraphName:
        return name


def _two_part(name: str) -> str:
    """Return the two-part name of a type; an invalid name is returned unchanged."""
    try:
        return two_part(name)
    except InterfaceError:
        return name


# Clients that see a topic or a service may see its nodes: their names in responses need no rule.
SERVICES: Final = (
    Service("topics", "Topics", topics, (Lists("topic", ("topics", "types")),), is_listing=True),
    Service("topics_for_type", "TopicsForType", topics_for_type, (Lists("topic", ("topics",)),)),
    Service(
        "topics_and_raw_types",
        "TopicsAndRawTypes",
        topics_and_raw_types,
        (Lists("topic", ("topics", "types", "typedefs_full_text")),),
        is_listing=True,
    ),
    Service("topic_type", "TopicType", topic_type, (AsksAbout("topic", "topic"),)),
    Service("publishers", "Publishers", publishers, (AsksAbout("topic", "topic"),)),
    Service("subscribers", "Subscribers", subscribers, (AsksAbout("topic", "topic"),)),
    Service("services", "Services", services, (Lists("service", ("services",)),), is_listing=True),
    Service("services_for_type", "ServicesForType", services_for_type, (Lists("service", ("services",)),)),
    Service("service_type", "ServiceType", service_type, (AsksAbout("service", "service"),)),
    Service(
        "service_providers", "ServiceProviders", service_providers, (ListsProviders("service", "providers"),)
    ),
    Service("service_node", "ServiceNode", service_node, (AsksAbout("service", "service"),)),
    Service("service_host", "ServiceHost", service_host, (AsksAbout("service", "service"),)),
    Service("nodes", "Nodes", nodes, (Lists("node", ("nodes",)),), is_listing=True),
    Service(
        "node_details",
        "NodeDetails",
        node_details,
        (
            AsksAbout("node", "node"),
            Lists("topic", ("subscribing",)),
            Lists("topic", ("publishing",)),
            Lists("service", ("services",)),
        ),
    ),
    Service(
        "action_servers",
        "GetActionServers",
        action_servers,
        (Lists("action", ("action_servers",)),),
        is_listing=True,
    ),
    Service("action_type", "ActionType", action_type, (AsksAbout("action", "action"),)),
    Service("get_time", "GetTime", get_time, NOTHING),
)

# Clients recognise ROS 1 by the absence of this service.
VERSION: Final = Service("get_ros_version", "GetROSVersion", get_ros_version, NOTHING)
