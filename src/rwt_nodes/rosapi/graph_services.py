"""What is in the graph now: topics, services, actions, nodes, time."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING, Any

from rwt_graph.errors import InvalidGraphName, ServiceFailed
from rwt_graph.names import resolve
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.names import two_part

if TYPE_CHECKING:
    from rwt_graph.api import Graph, TopicInfo
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType

Answer = dict[str, object]

#: What an actionlib server's topics end in; all five together make an action of ROS 1 (API-12).
_ACTIONLIB = ("cancel", "feedback", "goal", "result", "status")


class GraphServices:
    """Handlers of the services that ask about the running graph."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph

    def topics(self, _: Any) -> Answer:
        """Every topic and its type (API-02)."""
        topics = [topic for topic in self._graph.topics() if not is_hidden(topic.name)]
        return {
            "topics": [topic.name for topic in topics],
            "types": [self._type_name(topic.type) for topic in topics],
        }

    def topics_for_type(self, request: Any) -> Answer:
        """The topics of one type, in either spelling of its name."""
        wanted = _two_part(request.type)
        return {
            "topics": [
                topic.name for topic in self._graph.topics() if topic.type and topic.type.name == wanted
            ]
        }

    def topics_and_raw_types(self, _: Any) -> Answer:
        """Every topic with its type and the full text of the definition (API-06)."""
        topics = [
            topic for topic in self._graph.topics() if topic.type is not None and not is_hidden(topic.name)
        ]
        return {
            "topics": [topic.name for topic in topics],
            "types": [self._type_name(topic.type) for topic in topics],
            "typedefs_full_text": [
                self._graph.registry.full_text(topic.type) for topic in topics if topic.type
            ],
        }

    def topic_type(self, request: Any) -> Answer:
        """The type of a topic; empty if there is no such topic."""
        topic = self._topic(request.topic)
        return {"type": self._type_name(topic.type) if topic else ""}

    def publishers(self, request: Any) -> Answer:
        """The nodes that publish on a topic."""
        topic = self._topic(request.topic)
        return {"publishers": sorted({end.node for end in topic.publishers}) if topic else []}

    def subscribers(self, request: Any) -> Answer:
        """The nodes that subscribe to a topic."""
        topic = self._topic(request.topic)
        return {"subscribers": sorted({end.node for end in topic.subscribers}) if topic else []}

    def services(self, _: Any) -> Answer:
        """Every service."""
        return {
            "services": [service.name for service in self._graph.services() if not is_hidden(service.name)]
        }

    def services_for_type(self, request: Any) -> Answer:
        """The services of one type."""
        wanted = _two_part(request.type)
        return {
            "services": [service.name for service in self._graph.services() if service.type.name == wanted]
        }

    def service_type(self, request: Any) -> Answer:
        """The type of a service; empty if there is no such service."""
        service = self._graph.service(_absolute(request.service))
        return {"type": self._type_name(service.type) if service else ""}

    def service_providers(self, request: Any) -> Answer:
        """The nodes that offer services of a type; the field of the request is named for the service."""
        wanted = _two_part(request.service)
        name = _absolute(request.service)
        return {
            "providers": sorted(
                {
                    service.node
                    for service in self._graph.services()
                    if wanted == service.type.name or name == service.name
                }
            )
        }

    def service_node(self, request: Any) -> Answer:
        """The node that offers a service; empty if there is none."""
        service = self._graph.service(_absolute(request.service))
        return {"node": service.node if service else ""}

    def service_host(self, request: Any) -> Answer:
        """The host on which a service runs; empty if there is no such service."""
        service = self._graph.service(_absolute(request.service))
        return {"host": socket.gethostname() if service else ""}

    def nodes(self, _: Any) -> Answer:
        """Every node, each name once."""
        return {"nodes": sorted({node.name for node in self._graph.nodes()})}

    def node_details(self, request: Any) -> Answer:
        """What a node takes part in; of an unknown node ROS 1 says nothing, and ROS 2 fails (API-14)."""
        name = _absolute(request.node)
        nodes = [node for node in self._graph.nodes() if node.name == name]
        if not nodes and self._graph.distro.rosapi_fails_for_unknown_nodes:
            raise ServiceFailed(f"node {name} does not exist")
        return {
            "subscribing": sorted({topic for node in nodes for topic in node.subscribing}),
            "publishing": sorted({topic for node in nodes for topic in node.publishing}),
            "services": sorted({service for node in nodes for service in node.services}),
        }

    def action_servers(self, _: Any) -> Answer:
        """Every action, and every set of topics that is one in ROS 1 (API-12)."""
        topics = {topic.name for topic in self._graph.topics()}
        prefixes = {name.removesuffix("/goal") for name in topics if name.endswith("/goal")}
        over_topics = {
            prefix for prefix in prefixes if all(f"{prefix}/{end}" in topics for end in _ACTIONLIB)
        }
        return {"action_servers": sorted(over_topics | {action.name for action in self._graph.actions()})}

    def action_type(self, request: Any) -> Answer:
        """The type of an action; empty if there is no such action."""
        name = _absolute(request.action)
        action = self._graph.action(name)
        if action is not None:
            return {"type": self._type_name(action.type)}
        goal = self._graph.topic(f"{name}/goal")
        suffix = "ActionGoal"
        known = goal is not None and goal.type is not None and goal.type.name.endswith(suffix)
        return {"type": goal.type.name.removesuffix(suffix) if goal and goal.type and known else ""}

    def get_time(self, _: Any) -> Answer:
        """ROS time now (API-11)."""
        seconds, nanoseconds = divmod(self._graph.clock.time_ns(), 1_000_000_000)
        whole, part = self._graph.distro.time_fields
        return {"time": {whole: seconds, part: nanoseconds}}

    def get_ros_version(self, _: Any) -> Answer:
        """The version of ROS and the distribution whose names are spoken here."""
        return {"version": self._graph.distro.ros_version, "distro": self._graph.distro.name}

    def _topic(self, name: str) -> TopicInfo | None:
        return self._graph.topic(_absolute(name))

    def _type_name(self, type: MessageType | ServiceType | ActionType | None) -> str:
        return "" if type is None else self._graph.registry.type_name(type)


def is_hidden(name: str) -> bool:
    """Whether ROS 2 leaves the name out of lists: a part of it begins with an underscore (API-02)."""
    return "/_" in name


def _absolute(name: str) -> str:
    """The absolute name, or what was given if it cannot be one, which then names nothing."""
    try:
        return resolve(name)
    except InvalidGraphName:
        return name


def _two_part(name: str) -> str:
    """The two-part type name, or what was given if it cannot be one, which then names nothing."""
    try:
        return two_part(name)
    except InterfaceError:
        return name
