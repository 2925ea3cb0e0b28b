"""Queries of a node about its graph."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING

from rwt_participant.qos import QoS, incompatible_policies
from rwt_rclpy.endpoints.qos import profile_of
from rwt_rclpy.endpoints.type_support import service_type
from rwt_rclpy.exceptions import NodeNameNonExistentError, RCLError
from rwt_rclpy.middleware.topic_endpoint_info import (
    TopicEndpointInfo,
    TopicEndpointTypeEnum,
    TypeHash,
    endpoint_gid,
)
from rwt_rclpy.names.validation import wrong_in_node_name

if TYPE_CHECKING:
    from rwt_graph.api import EndpointInfo, NodeInfo, TopicInfo
    from rwt_rclpy.middleware.link import Link

NamesAndTypes = list[tuple[str, list[str]]]


def _dds_type(name: str) -> str:
    package, kind, short = name.split("/")
    return f"{package}::{kind}::dds_::{short}_"


class GraphQueries:
    """Queries of a graph, from any thread."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._graph = link.graph

    def topics(self, *, no_demangle: bool = False) -> NamesAndTypes:
        """Return every topic with its types; with `no_demangle` under DDS's names, as rmw prefixes them."""
        if no_demangle:
            return [(f"rt{name}", [_dds_type(each) for each in types]) for name, types in self.topics()]
        found = ((topic, self._types(topic)) for topic in self._link.run(self._graph.topics))
        return [(topic.name, types) for topic, types in found if types]

    def _types(self, topic: TopicInfo) -> list[str]:
        publishers = self._publishers(topic)
        ends = (*publishers, *topic.subscribers)
        if not ends and topic.publishers:
            return []
        named = dict.fromkeys(end.type for end in ends if end.type)
        if not named and topic.type is not None:
            named = {self._graph.registry.type_name(topic.type): None}
        return list(named)

    def _publishers(self, topic: TopicInfo) -> tuple[EndpointInfo, ...]:
        """Return the publishers of nodes: the graph's own one only names the release to viewers."""
        if topic.name != "/rosout":
            return topic.publishers
        own = self._graph.registry.distro.graph_node
        return tuple(each for each in topic.publishers if each.node != own)

    def services(self) -> NamesAndTypes:
        """Return all services with their types."""
        name = self._graph.registry.type_name
        return [(each.name, [name(each.type)]) for each in self._link.run(self._graph.services)]

    def actions(self) -> list[tuple[str, str, str]]:
        """Return all actions with types and nodes."""
        name = self._graph.registry.type_name
        return [(each.name, name(each.type), each.node) for each in self._link.run(self._graph.actions)]

    def nodes(self) -> list[str]:
        """Return the absolute names of all nodes."""
        return [node.name for node in self._link.run(self._graph.nodes)]

    def _node(self, name: str, namespace: str) -> NodeInfo:
        if (wrong := wrong_in_node_name(name)) is not None:
            raise RCLError(wrong[0])
        full = f"{namespace.rstrip('/')}/{name}"
        for node in self._link.run(self._graph.nodes):
            if node.name == full:
                return node
        raise NodeNameNonExistentError(f"Cannot get names and types: no node {full} is known")

    def published_by(self, name: str, namespace: str, *, no_demangle: bool = False) -> NamesAndTypes:
        """Return the topics that a node publishes. Raises NodeNameNonExistentError."""
        node = self._node(name, namespace)
        return self._of_topics(node.publishing, node.services, "rr", "Reply", no_demangle)

    def subscribed_by(self, name: str, namespace: str, *, no_demangle: bool = False) -> NamesAndTypes:
        """Return the topics that a node subscribes to. Raises NodeNameNonExistentError."""
        node = self._node(name, namespace)
        return self._of_topics(node.subscribing, node.services, "rq", "Request", no_demangle)

    def _of_topics(
        self, names: Iterable[str], services: Iterable[str], prefix: str, suffix: str, no_demangle: bool
    ) -> NamesAndTypes:
        known = dict(self.topics())
        found = [(name, known.get(name, [])) for name in names]
        if not no_demangle:
            return found
        # With DDS's names, the topics of services are listed, too.
        kinds = dict(self.services())
        part = {"Reply": "Response"}.get(suffix, suffix)
        own = [
            (f"{prefix}{each}{suffix}", [f"{kind}_{part}" for kind in kinds.get(each, [])])
            for each in services
        ]
        own += [(f"rt{name}", types) for name, types in found]
        return [(name, [_dds_type(kind) for kind in types]) for name, types in own]

    def services_of(self, name: str, namespace: str) -> NamesAndTypes:
        """Return the services that a node offers. Raises NodeNameNonExistentError."""
        known = dict(self.services())
        return [(each, known.get(each, [])) for each in self._node(name, namespace).services]

    def actions_of(self, name: str, namespace: str) -> NamesAndTypes:
        """Return the actions that a node offers. Raises NodeNameNonExistentError."""
        wanted = self._node(name, namespace).actions
        return [(action, [kind]) for action, kind, _ in self.actions() if action in wanted]

    @property
    def version(self) -> int:
        """Number that grows with every change of the graph."""
        return self._graph.version

    def ends(self, topic: str, *, publishers: bool) -> tuple[EndpointInfo, ...]:
        """Return the publishers or subscriptions of a topic."""
        info = self._link.run(lambda: self._graph.topic(topic))
        if info is None:
            return ()
        return self._publishers(info) if publishers else info.subscribers

    def incompatible(self, topic: str, own: QoS, *, publishers: bool) -> list[tuple[str, ...]]:
        """Return the policies by which endpoints are incompatible with one that has `own`, for each."""
        if not self._graph.dds_rules:
            return []
        ends = self.ends(topic, publishers=publishers)
        pairs = ((end.qos, own) if publishers else (own, end.qos) for end in ends)
        return [found for pair in pairs if (found := incompatible_policies(*pair))]

    def count_services(self, service: str) -> int:
        """Return the number of servers of a service."""
        return self._link.run(lambda: self._graph.count_services(service))

    def count_clients(self, service: str) -> int:
        """Return the number of clients of a service in this process."""
        return sum(client._name == service for client in tuple(self._link.clients))

    def called_by(self, node: str) -> NamesAndTypes:
        """Return the services that the clients of a node of this process call."""
        name = self._graph.registry.type_name
        own = [each for each in tuple(self._link.clients) if each._node._rwt_full_name == node]
        kinds = {each._name: name(service_type(each.srv_type)) for each in own}
        return [(service, [kind]) for service, kind in sorted(kinds.items())]

    def endpoints(self, topic: str, *, publishers: bool) -> list[TopicEndpointInfo]:
        """Return the publishers or subscriptions of a topic."""
        info = self._link.run(lambda: self._graph.topic(topic))
        if info is None:
            return []
        kind = TopicEndpointTypeEnum.PUBLISHER if publishers else TopicEndpointTypeEnum.SUBSCRIPTION
        ends = self._publishers(info) if publishers else info.subscribers
        seen: Counter[str] = Counter()
        found = []
        for end in ends:
            found.append(self._endpoint(info, end, kind, seen[end.node]))
            seen[end.node] += 1
        return found

    def _endpoint(
        self, info: TopicInfo, end: EndpointInfo, kind: TopicEndpointTypeEnum, number: int
    ) -> TopicEndpointInfo:
        namespace, _, name = end.node.rpartition("/")
        digest = TypeHash() if info.type is None else TypeHash.from_text(info.type.rihs01)
        return TopicEndpointInfo(
            node_name=name,
            node_namespace=namespace or "/",
            topic_type=end.type,
            topic_type_hash=digest,
            endpoint_type=kind,
            endpoint_gid=list(endpoint_gid(end.node, info.name, kind, number)),
            qos_profile=profile_of(end.qos),
        )
