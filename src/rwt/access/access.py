"""Who may do what with one graph: the one object that a server asks, for all of its gateways."""

from __future__ import annotations

import time
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

from rwt.access.admission import Admission
from rwt.access.audit import Audit
from rwt.access.client_graph import ClientGraph
from rwt.access.disclosure import setting_parameters
from rwt.access.graph_view import GraphView
from rwt.access.open_responses import OpenResponses
from rwt.access.quotas import AddressQuotas, ClientQuotas, Work, WorkTotals
from rwt.access.roles import Role
from rwt.access.settings import RoleSettings, SettingsError
from rwt_graph.nodes.logs import DISCLOSURES as LOGGER_DISCLOSURES
from rwt_graph.parameters.services import DISCLOSURES as PARAMETER_DISCLOSURES
from rwt_transports.errors import Refused
from rwt_transports.http.routes import is_local
from rwt_transports.limits import network_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.disclosure import Disclosures
    from rwt.access.gate.client_gate import ClientGate
    from rwt.access.gate.gate import Gate
    from rwt.access.settings import AccessSettings
    from rwt.access.settings.gate import GateSettings
    from rwt.delivery.shared_graph import SharedGraph
    from rwt_graph.api import Graph
    from rwt_transports.endpoint import PeerInfo


class Access:
    """The rules of one server.

    Attributes:
        admission: who comes in, and in which role.
        audit: the log of what clients do.
        gate: what their acts have to pass; None where nothing is declared.
        nobody: a reader that sees nothing of the graph.
        work: that all clients have caused.

    Args:
        graph: the robot.
        settings: what the operator has set.
        disclosures: what services reveal besides those of parameters, by the name of their type; a service
            about the graph without a declaration is refused to restricted roles.
        now: seconds since 1970.

    Raises:
        SettingsError: the secret of rosauth cannot be read, the audit's file cannot be written, or a rule of
            the gate does not fit what is in the graph.
    """

    def __init__(
        self,
        graph: Graph,
        settings: AccessSettings,
        disclosures: Disclosures = MappingProxyType({}),
        now: Callable[[], float] = time.time,
    ) -> None:
        self._graph = graph
        self._limits = settings.limits
        self.work = WorkTotals()
        self.nobody = GraphView(graph, Role("nobody", RoleSettings()), self._work(0.0))
        self._addresses: dict[str, AddressQuotas] = {}
        self._disclosures = {**PARAMETER_DISCLOSURES, **LOGGER_DISCLOSURES, **disclosures}
        self._setting_parameters = setting_parameters(self._disclosures)
        self.audit = Audit()
        self.gate = self._gate_of(graph, settings.gate)
        self.admission = Admission(settings, now, graph.clock.monotonic, self.audit)
        self._lasting = OpenResponses(self.admission)
        self._reserved: set[str] = set()

    def _gate_of(self, graph: Graph, settings: GateSettings) -> Gate | None:
        if not settings.rules and settings.audit.file is None:
            return None
        # What only some servers need is imported for them alone.
        from rwt.access.gate.gate import BadRule, Gate
        from rwt.access.gate.node import GateNode

        try:
            gate = Gate(graph, settings, self.audit)
        except BadRule as wrong:
            raise SettingsError(str(wrong)) from None
        except OSError as error:
            raise SettingsError(f"`gate.audit.file`: cannot be written: {error.strerror}") from error
        if settings.rules:
            GateNode(gate, graph)
        return gate

    def reload(self, settings: AccessSettings) -> None:
        """Go by other tokens, roles and origins from now on, and end the answers to requests that they do not
        allow. The clients of gateways are asked by these (:meth:`rwt.access.gateway.Gateway.reload_roles`).

        Raises:
            SettingsError: they cannot be used; then all stays as it was.
        """
        self.admission.reload(settings)
        self._lasting.review()

    def close(self) -> None:
        """Leave the graph, and write what the audit's queue holds."""
        if self.gate is not None:
            self.gate.close()

    def client(self, shared: SharedGraph, role: Role, address: str, name: str = "") -> ClientGraph:
        """The graph as a client of that role may see it and act on it.

        Args:
            shared: the part in the graph of the gateway that it came through.
            role: the client's.
            address: the client's; what earlier clients from there have left behind counts as its own.
            name: what the gate calls it, such as `rosbridge:3`; empty: the gate finds one.
        """
        of_address = self._quotas_of(address)
        work = self._work(self._limits.work_per_second, of_address.work)
        quotas = ClientQuotas(self._limits, of_address, work)
        gate = None if self.gate is None else self._client_gate(self.gate, role, address, name)
        return ClientGraph(
            shared, role, quotas, self._disclosures, self._setting_parameters, gate, self._reserved
        )

    def reserve(self, topic: str) -> None:
        """Let no client publish on a topic, in whatever role, by which the server itself tells something.

        Args:
            topic: absolute name.
        """
        self._reserved.add(topic)

    @staticmethod
    def _client_gate(gate: Gate, role: Role, address: str, name: str) -> ClientGate:
        from rwt.access.gate.client_gate import ClientGate

        return ClientGate(gate, name, role, address)

    def _quotas_of(self, address: str) -> AddressQuotas:
        """What counts for all clients of an address; this machine's own may cause any amount of work, as they
        may have any number of connections."""
        network = network_of(address)
        quotas = self._addresses.get(network)
        if quotas is None:
            self._addresses = {name: left for name, left in self._addresses.items() if not left.is_empty}
            bounded = address and not is_local(address)
            work = self._work(self._limits.work_per_second if bounded else 0.0)
            quotas = self._addresses[network] = AddressQuotas(work)
        return quotas

    def _work(self, rate: float, of_address: Work | None = None) -> Work:
        return Work(rate, self._limits.work_burst, self.work, self._graph.clock.monotonic, of_address)

    def reader(self, info: PeerInfo) -> GraphView:
        """The graph as whoever sent a request without a connection may see it, by the token in the request.

        Raises:
            Refused: the token is not known (401), or none came where one is needed (401).
        """
        role = self.admission.role_of(info)
        if role is None:
            reason = "this page is for clients that authenticate by a token (auth.tokens)"
            raise Refused(401, reason, {"WWW-Authenticate": 'Bearer realm="rosbridge"'})
        return GraphView(
            self._graph, role, self._quotas_of(info.address).work, partial(self._lasting.add, info)
        )
