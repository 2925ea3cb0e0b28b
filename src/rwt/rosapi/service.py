"""Row of the tables of services in this folder, and differences between the distributions."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Coroutine, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from rwt_graph.disclosure import Disclosure
from rwt_graph.nodes.node import Node
from rwt_interfaces.payload import Payload
from rwt_participant.future import run_until_it_waits
from rwt_participant.messages import ServiceHandler


@dataclass(frozen=True, slots=True, kw_only=True)
class Conventions:
    """rosapi of one distribution.

    Attributes:
        has_version: True if `get_ros_version` is offered. Clients recognise ROS 1 by its absence.
        has_idl_names: True if scalars have the names of IDL (API-04).
        reports_failures: True if responses about parameters have ``successful`` and ``reason``. Otherwise the
            call fails.
        fails_for_unknown_nodes: True if ``node_details`` fails for an unknown node. Otherwise its lists are
            empty (API-14).
    """

    package: str
    has_version: bool
    has_idl_names: bool
    reports_failures: bool
    fails_for_unknown_nodes: bool


CONVENTIONS: Final[Mapping[str, Conventions]] = {
    "jazzy": Conventions(
        package="rosapi_msgs",
        has_version=True,
        has_idl_names=True,
        reports_failures=True,
        fails_for_unknown_nodes=True,
    ),
    "noetic": Conventions(
        package="rosapi",
        has_version=False,
        has_idl_names=False,
        reports_failures=False,
        fails_for_unknown_nodes=False,
    ),
}
"""Conventions by :attr:`~rwt_interfaces.Distro.conventions`."""

Answer = dict[str, object]
"""Fields of a response."""


@dataclass(frozen=True, slots=True)
class Service:
    """Service of rosapi.

    Attributes:
        name: name below ``/rosapi/``.
        type: name of the type, without the distribution's package of rosapi.
        handler: returns the response of the node to a request.
        is_listing: True if the response only depends on the names in the graph: it is cached until they
            change.
        reveals: declaration of what the service reveals. There is no default: a service that reveals nothing
            declares :data:`rwt_graph.disclosure.NOTHING`.
    """

    name: str
    type: str
    handler: Callable[[Node, Any], Answer | Awaitable[Answer]]
    reveals: Disclosure
    is_listing: bool = False

    def serve(self, node: Node) -> ServiceHandler:
        """Return the handler of the service for a node."""
        return self._cached(node) if self.is_listing else partial(_at_once, self.handler, node)

    def _cached(self, node: Node) -> ServiceHandler:
        answer: Payload | None = None
        known = -1

        def handle(request: Any) -> Payload:
            nonlocal answer, known
            graph = node.graph
            if answer is None or graph.version != known:
                known = graph.version
                type = graph.registry.service(f"{CONVENTIONS[graph.distro.conventions].package}/{self.type}")
                answer = Payload.from_value(type.response, self.handler(node, request))
            return answer

        return handle


def _at_once(
    handler: Callable[[Node, Any], Answer | Awaitable[Answer]], node: Node, request: Any
) -> Answer | Awaitable[Answer]:
    """Return the response now if the handler does not wait.

    With a task per request, the requests of many clients would all run in one turn of the event loop.
    """
    answer = handler(node, request)
    return run_until_it_waits(answer) if isinstance(answer, Coroutine) else answer
