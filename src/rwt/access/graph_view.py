"""Read-only view of the graph for one role: names in canonical form, listings filtered."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from rwt_graph.api import ActionInfo, Graph, GraphListings, NodeInfo, ServiceInfo, TopicInfo
from rwt_graph.errors import InvalidGraphName
from rwt_graph.names import resolve
from rwt_transports.errors import Refused
from rwt_transports.shared_pool import Holder

if TYPE_CHECKING:
    from collections.abc import Iterable, Set

    from rwt.access.quotas import WorkLimit
    from rwt.access.roles import Act, Role
    from rwt_graph.clock import Clock
    from rwt_interfaces.distro import Distro
    from rwt_interfaces.registry import Registry


Keep = Callable[["Iterable[str]", Callable[[str], None]], Callable[[], None]]
"""Implementation of :meth:`GraphView.while_allowed`."""

STOP: Final = "/gate/stop"
"""Service and topic of the gate that press the emergency stop."""


NOBODY: Final = Holder()
"""Holder of a view that takes no shares of pools."""


class GraphView(GraphListings):
    """View of the graph for one role: the queries of :class:`rwt_graph.api.Graph`, filtered.

    Hidden names are treated as if they did not exist.

    Attributes:
        work: account of the work that the server does for the holder of the view.
        is_admitted: True if the holder may connect; False for the view in which everything is hidden.
        has_pressed_stop: True if the holder is a request that has pressed the emergency stop, so that nothing
            may delay or refuse it.
        holder: client to which shares of pools count.

    Args:
        keep: implementation of :meth:`while_allowed`; None: open responses are refused.
        open_services: services that every role sees and may call, because the gate itself decides who may.
    """

    def __init__(
        self,
        graph: Graph,
        role: Role,
        work: WorkLimit,
        keep: Keep | None = None,
        *,
        open_services: Set[str] = frozenset(),
        holder: Holder = NOBODY,
    ) -> None:
        self.role = role
        self.is_admitted = True
        self.holder = holder
        self._open_services = open_services
        self._keep = keep
        self.work = work
        self.has_pressed_stop = False
        self._graph = graph
        # Names of the visible nodes, and the version of the graph that they were read from.
        self._node_names: frozenset[str] = frozenset()
        self._names_version = -1
        self.distro: Distro = graph.distro
        self.registry: Registry = graph.registry
        self.clock: Clock = graph.clock

    def require(self, act: Act, name: str) -> str:
        """Return the canonical form of `name` if the role allows `act` on it.

        Raises:
            NotAllowed: it does not; the text names the setting that would allow it.
            InvalidGraphName: `name` is not a valid ROS name.
        """
        absolute = resolve(name)
        self.role.require(act, absolute)
        return absolute

    def may_subscribe(self, topic: str) -> bool:
        """Return True if the role may subscribe to `topic`, in any spelling."""
        return self.role.allows("subscribe", canonical(topic))

    def while_allowed(self, topics: Iterable[str], end: Callable[[str], None]) -> Callable[[], None]:
        """Register an open response; see :meth:`rwt_transports.http.routes.Reader.while_allowed`."""
        if self._keep is None:
            raise Refused(403, "nothing that lasts can be begun here")
        return self._keep([canonical(topic) for topic in topics], end)

    @property
    def sees_every_topic(self) -> bool:
        """True if no topic is hidden."""
        return self.role.sees_every_topic

    def topics(self) -> tuple[TopicInfo, ...]:
        """Return the visible topics, sorted by name."""
        return tuple(topic for topic in self._graph.topics() if self.role.sees_topic(topic.name))

    def topic(self, name: str) -> TopicInfo | None:
        """Return a topic; None if it is hidden or does not exist."""
        absolute = canonical(name)
        return self._graph.topic(absolute) if self.role.sees_topic(absolute) else None

    def services(self) -> tuple[ServiceInfo, ...]:
        """Return the visible services, sorted by name."""
        return tuple(service for service in self._graph.services() if self.sees_service(service.name))

    def service(self, name: str) -> ServiceInfo | None:
        """Return a service; None if it is hidden or does not exist."""
        absolute = canonical(name)
        return self._graph.service(absolute) if self.sees_service(absolute) else None

    def sees_service(self, name: str) -> bool:
        """Return True if a service, given by its absolute name, is visible."""
        return self.role.sees_service(name) or name in self._open_services

    def may_call(self, service: str) -> bool:
        """Return True if the role may call a service, given by its absolute name."""
        return self.role.allows("call", service) or service in self._open_services

    def actions(self) -> tuple[ActionInfo, ...]:
        """Return the visible actions, sorted by name."""
        return tuple(action for action in self._graph.actions() if self.role.sees_action(action.name))

    def action(self, name: str) -> ActionInfo | None:
        """Return an action; None if it is hidden or does not exist."""
        absolute = canonical(name)
        return self._graph.action(absolute) if self.role.sees_action(absolute) else None

    def problems(self, name: str) -> tuple[str, ...]:
        """Return why a topic or service of another process cannot be used; nothing about hidden ones."""
        absolute, role = canonical(name), self.role
        is_visible = role.sees_topic(absolute) or role.sees_service(absolute)
        return self._graph.problems.of(absolute) if is_visible else ()

    def hidden(self) -> dict[str, int]:
        """Return how many topics, services and actions are hidden."""
        graph = self._graph
        return {
            "topics": len(graph.topics()) - len(self.topics()),
            "services": len(graph.services()) - len(self.services()),
            "actions": len(graph.actions()) - len(self.actions()),
        }

    def nodes(self) -> tuple[NodeInfo, ...]:
        """Return the nodes with visible topics, services or actions, sorted by name."""
        return tuple(node for node in self._graph.nodes() if self._shows(node))

    def sees_node(self, name: str) -> bool:
        """Return True if a node is visible."""
        version = self._graph.version
        if self._names_version != version:
            self._node_names = frozenset(node.name for node in self.nodes())
            self._names_version = version
        return name in self._node_names

    def _shows(self, node: NodeInfo) -> bool:
        return (
            any(map(self.role.sees_topic, (*node.publishing, *node.subscribing)))
            or any(map(self.sees_service, node.services))
            or any(map(self.role.sees_action, node.actions))
        )


def canonical(name: str) -> str:
    """Return the absolute form of a name, also in `node:parameter`; an invalid name is returned unchanged."""
    node, colon, parameter = name.partition(":")
    try:
        return f"{resolve(node)}{colon}{parameter}"
    except InvalidGraphName:
        return name
