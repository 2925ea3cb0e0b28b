"""Who may do what with one graph: the one object that a server asks, for all of its gateways."""

from __future__ import annotations

import time
from types import MappingProxyType
from typing import TYPE_CHECKING

from rwt_access.admission import Admission
from rwt_access.audit import Audit
from rwt_access.client_graph import ClientGraph
from rwt_access.graph_view import GraphView
from rwt_access.quotas import AddressQuotas, ClientQuotas
from rwt_access.roles import Role
from rwt_access.settings import RoleSettings
from rwt_graph.parameters.services import DISCLOSURES as PARAMETER_DISCLOSURES
from rwt_transports.errors import Refused

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt_access.disclosure import Disclosures
    from rwt_access.settings import AccessSettings
    from rwt_delivery.shared_graph import SharedGraph
    from rwt_graph.api import Graph
    from rwt_protocol.transport import PeerInfo


class Access:
    """The rules of one server.

    Attributes:
        admission: who comes in, and in which role.
        audit: the log of what clients do.
        nobody: a reader that sees nothing of the graph.

    Args:
        graph: the robot.
        settings: what the operator has set.
        disclosures: what services reveal besides those of parameters, by the name of their type; a service
            about the graph without a declaration is refused to restricted roles.
        now: seconds since 1970.

    Raises:
        SettingsError: the secret of rosauth cannot be read.
    """

    def __init__(
        self,
        graph: Graph,
        settings: AccessSettings,
        disclosures: Disclosures = MappingProxyType({}),
        now: Callable[[], float] = time.time,
    ) -> None:
        self._graph = graph
        self.nobody = GraphView(graph, Role("nobody", RoleSettings()))
        self._limits = settings.limits
        self._left_behind: dict[str, AddressQuotas] = {}
        self._disclosures = {**PARAMETER_DISCLOSURES, **disclosures}
        self.audit = Audit()
        self.admission = Admission(settings, now, graph.clock.monotonic, self.audit)

    def client(self, shared: SharedGraph, role: Role, address: str) -> ClientGraph:
        """The graph as a client of that role may see it and act on it.

        Args:
            shared: the part in the graph of the gateway that it came through.
            role: the client's.
            address: the client's; what earlier clients from there have left behind counts as its own.
        """
        if address not in self._left_behind:
            self._left_behind = {name: left for name, left in self._left_behind.items() if not left.is_empty}
        quotas = ClientQuotas(self._limits, self._left_behind.setdefault(address, AddressQuotas()))
        return ClientGraph(shared, role, quotas, self._disclosures)

    def reader(self, info: PeerInfo) -> GraphView:
        """The graph as whoever sent a request without a connection may see it, by the token in the request.

        Raises:
            Refused: the token is not known (401), or none came where one is needed (401).
        """
        role = self.admission.role_of(info)
        if role is None:
            raise Refused(401, "this page is for clients that authenticate by a token (auth.tokens)")
        return GraphView(self._graph, role)
