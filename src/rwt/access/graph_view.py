"""What one role sees of a graph: every name canonical before it is matched, every listing filtered."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_graph.errors import InvalidGraphName
from rwt_graph.names import resolve
from rwt_transports.errors import Refused

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rwt.access.quotas import Work
    from rwt.access.roles import Act, Role
    from rwt_graph.api import ActionInfo, Graph, NodeInfo, ServiceInfo, TopicInfo
    from rwt_graph.clock import Clock
    from rwt_interfaces.distro import Distro
    from rwt_interfaces.registry import Registry


class GraphView:
    """A graph as its readers may see it; the questions of :class:`rwt_graph.api.Graph`, by role.

    What is hidden is answered as if it were not there.

    Attributes:
        role: what decides.
        work: that the server does for whoever has this view.
        distro: of the graph.
        registry: the interfaces that the graph knows.
        clock: of the graph.

    Args:
        graph: the robot.
        role: see above.
        work: see above.
        keep: does what :meth:`while_allowed` says; None: nothing is ever begun for whoever has this view.
    """

    def __init__(
        self,
        graph: Graph,
        role: Role,
        work: Work,
        keep: Callable[[Iterable[str], Callable[[str], None]], Callable[[], None]] | None = None,
    ) -> None:
        self.role = role
        self._keep = keep
        self.work = work
        self._graph = graph
        self._node_names: frozenset[str] = frozenset()
        self._named_at = -1
        self.distro: Distro = graph.distro
        self.registry: Registry = graph.registry
        self.clock: Clock = graph.clock

    def require(self, act: Act, name: str) -> str:
        """The canonical form of `name`, with which the role may do `act`.

        Raises:
            NotAllowed: it may not; the text names the setting that would allow it.
            InvalidGraphName: not a name that ROS allows.
        """
        absolute = resolve(name)
        self.role.require(act, absolute)
        return absolute

    def may_subscribe(self, topic: str) -> bool:
        """Whether the role may subscribe to `topic`, in any spelling."""
        return self.role.allows("subscribe", canonical(topic))

    def while_allowed(self, topics: Iterable[str], end: Callable[[str], None]) -> Callable[[], None]:
        """Begin an answer that lasts; see :meth:`rwt_transports.http.routes.Reader.while_allowed`."""
        if self._keep is None:
            raise Refused(403, "nothing that lasts can be begun here")
        return self._keep([canonical(topic) for topic in topics], end)

    @property
    def sees_every_topic(self) -> bool:
        """Whether no topic is hidden."""
        return self.role.sees_every_topic

    def topics(self) -> tuple[TopicInfo, ...]:
        """The topics that are shown, sorted by name."""
        return tuple(topic for topic in self._graph.topics() if self.role.sees_topic(topic.name))

    def topic(self, name: str) -> TopicInfo | None:
        """One topic, None where it is hidden or does not exist."""
        absolute = canonical(name)
        return self._graph.topic(absolute) if self.role.sees_topic(absolute) else None

    def services(self) -> tuple[ServiceInfo, ...]:
        """The services that are shown, sorted by name."""
        return tuple(service for service in self._graph.services() if self.sees_service(service.name))

    def service(self, name: str) -> ServiceInfo | None:
        """One service, None where it is hidden or does not exist."""
        absolute = canonical(name)
        return self._graph.service(absolute) if self.sees_service(absolute) else None

    def sees_service(self, name: str) -> bool:
        """Whether a service is shown, by its absolute name."""
        return self.role.sees_service(name)

    def actions(self) -> tuple[ActionInfo, ...]:
        """The actions that are shown, sorted by name."""
        return tuple(action for action in self._graph.actions() if self.role.sees_action(action.name))

    def action(self, name: str) -> ActionInfo | None:
        """One action, None where it is hidden or does not exist."""
        absolute = canonical(name)
        return self._graph.action(absolute) if self.role.sees_action(absolute) else None

    def nodes(self) -> tuple[NodeInfo, ...]:
        """The nodes that take part in something that is shown, sorted by name."""
        return tuple(node for node in self._graph.nodes() if self._shows(node))

    def sees_parameter(self, name: str) -> bool:
        """Whether a parameter is shown, by its full name: `/node:name`, or `/name` of the global tree."""
        return self.role.sees_parameter(canonical(name))

    def sees_node(self, name: str) -> bool:
        """Whether a node is shown."""
        version = self._graph.version
        if self._named_at != version:
            self._node_names = frozenset(node.name for node in self.nodes())
            self._named_at = version
        return name in self._node_names

    def _shows(self, node: NodeInfo) -> bool:
        return (
            any(map(self.role.sees_topic, (*node.publishing, *node.subscribing)))
            or any(map(self.sees_service, node.services))
            or any(map(self.role.sees_action, node.actions))
        )


def canonical(name: str) -> str:
    """The absolute form of a name, of a parameter's node too; what cannot be one names nothing, and stays."""
    node, colon, parameter = name.partition(":")
    try:
        return f"{resolve(node)}{colon}{parameter}"
    except InvalidGraphName:
        return name
