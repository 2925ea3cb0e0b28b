"""What the graph knows of itself, as snapshots."""

from __future__ import annotations

from collections import Counter

from rwt_graph.api import ActionInfo, NodeInfo, ServiceInfo, TopicInfo
from rwt_graph.memory.actions import Actions
from rwt_graph.memory.services import Services
from rwt_graph.memory.topics import Topics


class Introspection:
    """Reads the parts of a memory graph; counts how many participants share each node name."""

    def __init__(self, topics: Topics, services: Services, actions: Actions) -> None:
        self._topics = topics
        self._services = services
        self._actions = actions
        self._nodes: Counter[str] = Counter()

    def joined(self, node: str) -> None:
        """One more participant has that name."""
        self._nodes[node] += 1

    def left(self, node: str) -> None:
        """One participant fewer has that name."""
        self._nodes[node] -= 1
        if not self._nodes[node]:
            del self._nodes[node]

    def topics(self) -> tuple[TopicInfo, ...]:
        """Every topic, sorted by name."""
        return tuple(info for name in self._topics.names() if (info := self._topics.info(name)))

    def services(self) -> tuple[ServiceInfo, ...]:
        """Every service, sorted by name."""
        return tuple(info for name in self._services.names() if (info := self._services.info(name)))

    def actions(self) -> tuple[ActionInfo, ...]:
        """Every action, sorted by name."""
        return tuple(info for name in self._actions.names() if (info := self._actions.info(name)))

    def nodes(self) -> tuple[NodeInfo, ...]:
        """Every node, sorted by name; participants of one name are one node."""
        return tuple(self._node(name) for name in sorted(self._nodes))

    def _node(self, name: str) -> NodeInfo:
        publishing, subscribing = self._topics.of_node(name)
        return NodeInfo(
            name, publishing, subscribing, self._services.of_node(name), self._actions.of_node(name)
        )


__all__ = ["Introspection"]
