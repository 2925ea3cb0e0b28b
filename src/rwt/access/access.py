"""Access control of one server, for all of its gateways."""

from __future__ import annotations

import logging
import time
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from rwt.access.admission import Admission
from rwt.access.audit import Audit
from rwt.access.client_graph import ClientGraph, ServerPolicy
from rwt.access.decisions import decisions_of
from rwt.access.disclosure import Disclosures, setting_parameters
from rwt.access.graph_view import NOBODY, GraphView, Keep
from rwt.access.quotas import AddressQuotas, ClientQuotas, WorkLimit, WorkTotals
from rwt.access.roles import Role
from rwt.access.settings import AccessSettings, GateSettings, RoleSettings, SettingsError
from rwt_graph.nodes.logs import DISCLOSURES as LOGGER_DISCLOSURES
from rwt_graph.parameters.services import DISCLOSURES as PARAMETER_DISCLOSURES
from rwt_transports.errors import Refused
from rwt_transports.http.addresses import holder_of, network_of
from rwt_transports.http.routes import is_local
from rwt_transports.shared_pool import Holder

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from rwt.access.gate.client_gate import ClientGate
    from rwt.access.gate.gate import Gate
    from rwt.delivery.shared_graph import SharedGraph
    from rwt_graph.api import Graph
    from rwt_transports.endpoint import PeerInfo

_GONE: Final = "the server's settings have changed, and do not allow this any more"


#: Parts of a `User-Agent` header and their names for people; browsers name older ones behind themselves.
_PROGRAMS: Final = {"Edg": "Edge", "Firefox": "Firefox", "Chrome": "Chrome", "Safari": "Safari"}
_SYSTEMS: Final = {
    "Android": "Android", "iPhone": "iPhone", "iPad": "iPad", "CrOS": "ChromeOS",
    "Windows": "Windows", "Macintosh": "Mac", "Linux": "Linux",
}  # fmt: skip


def device_of(user_agent: str) -> str:
    """Return the program and system that a `User-Agent` header names, such as `Firefox, Android`.

    Only known names are returned: a client cannot show people a text of its own.
    """
    found = (
        next((name for part, name in known.items() if part in user_agent), "")
        for known in (_PROGRAMS, _SYSTEMS)
    )
    return ", ".join(filter(None, found))


class _OpenResponse(NamedTuple):
    """Response that stays open, such as a stream or a peer; it ends if new settings forbid it."""

    info: PeerInfo
    topics: tuple[str, ...]
    end: Callable[[str], None]


class Access:
    """Access control of one server.

    Attributes:
        audit: log of what clients do.
        limits: limits of what one client may have open, send, and be sent.
        gate: gate of the server; None without rules and audit file.
        nobody: view of the graph in which everything is hidden.
        work: totals of the work caused by all clients.

    Args:
        disclosures: declarations of what services reveal, by the name of their type, besides those of
            parameters and loggers. Restricted roles cannot call an undeclared service that reveals the graph.
        now: returns the seconds since 1970.

    Raises:
        SettingsError: the rosauth secret cannot be read, the audit file cannot be written, or a gate rule
            does not fit the graph.
    """

    def __init__(
        self,
        graph: Graph,
        settings: AccessSettings,
        disclosures: Disclosures = MappingProxyType({}),
        now: Callable[[], float] = time.time,
    ) -> None:
        self._graph = graph
        self.limits = settings.limits
        self.work = WorkTotals()
        self.nobody = GraphView(graph, Role("nobody", RoleSettings()), self._work(0.0))
        self.nobody.is_admitted = False
        self._addresses: dict[str, AddressQuotas] = {}
        all_disclosures = {**PARAMETER_DISCLOSURES, **LOGGER_DISCLOSURES, **disclosures}
        self._reserved: set[str] = set()
        self._policy = ServerPolicy(all_disclosures, setting_parameters(all_disclosures), self._reserved)
        self.audit = Audit()
        self.gate = self._gate_of(graph, settings.gate)
        if self.gate is not None:
            graph.may_retain = self.may_latch
        self.admission = Admission(settings, now, graph.clock.monotonic, self.audit)
        self._open_responses: dict[object, _OpenResponse] = {}

    def _gate_of(self, graph: Graph, settings: GateSettings) -> Gate | None:
        if not settings.is_on:
            return None
        # Imported here: servers without a gate do not load it.
        from rwt.access.gate.gate import Gate
        from rwt.access.gate.node import GateNode

        try:
            gate = Gate(graph, settings, self.audit)
        except OSError as error:
            raise SettingsError(f"`gate.audit.file`: cannot be written: {error.strerror}") from error
        if settings.rules:
            GateNode(gate, graph)
        return gate

    def reload(self, settings: AccessSettings) -> None:
        """Replace tokens, roles, origins and gate rules, and end open responses that are no longer allowed.

        Gateways review their own clients (:meth:`rwt.gateways.base.Gateway.reload_roles`).

        Raises:
            SettingsError: the settings are invalid, or require a restart; then nothing changes.
        """
        replace = self.admission.prepare(settings)
        if self.gate is not None:
            self.gate.replace_rules(settings.gate)
        elif settings.gate.is_on:
            raise SettingsError("`gate.rules`: a server without a gate requires a restart for one")
        before = self.admission.changeable()
        replace()
        self._note_changes(before, self.admission.changeable())
        for key, response in tuple(self._open_responses.items()):
            if (reason := self._reason_to_end(response)) and self._open_responses.pop(key, None) is not None:
                response.end(reason)

    def _note_changes(self, before: Mapping[str, object], now: Mapping[str, object]) -> None:
        """Log which roles and credentials a reload has changed, also in the audit of the gate."""
        changed = [key for key in {**before, **now} if before.get(key) != now.get(key)]
        if not changed:
            return
        text = f"access replaced; changed are {', '.join(changed)}"
        self.audit.write(logging.INFO, "%s", text)
        if self.gate is not None:
            self.gate.recorder.note("reload", "reload", "", None, text)

    def close(self) -> None:
        """Leave the graph, and flush the audit file."""
        if self.gate is not None:
            self.gate.close()

    def client(
        self, shared: SharedGraph, role: Role, address: str, name: str = "", user_agent: str = ""
    ) -> ClientGraph:
        """Return the graph as one client may see and use it.

        Args:
            address: network address of the client; resources that earlier clients of the address left behind
                count towards its quotas.
            name: name of the client at the gate, such as `rosbridge:3`, which begins with that of its gateway
                (:mod:`rwt.access.decisions`); empty: a program of this process, named by the gate.
            user_agent: ``User-Agent`` header of the client's program, by which people recognise its device.
        """
        of_address = self._quotas_of(address)
        work = self._work(self.limits.work_per_second, of_address.work)
        quotas = ClientQuotas(self.limits, of_address, work)
        gate: ClientGate | None = None
        if self.gate is not None:
            from rwt.access.gate.client_gate import ClientGate

            gate = ClientGate(self.gate, name, role, address, device_of(user_agent))
        holder = holder_of(address, role.credential)
        return ClientGraph(shared, role, quotas, self._policy, gate, decisions_of(name), holder)

    def may_latch(self, topic: str) -> bool:
        """Return True unless a gate rule forbids latched publishers of a topic."""
        gate = self.gate
        return gate is None or gate.is_observing or gate.latch_rule(topic) is None

    def is_stop_due(self, role: Role) -> bool:
        """True if clients of a role can press the emergency stop now."""
        return self.gate is not None and self.gate.is_stop_due(role.name)

    def reserve(self, topic: str) -> None:
        """Reserve a topic for the server: no client can publish on it, whatever its role.

        Args:
            topic: absolute name of the topic.
        """
        self._reserved.add(topic)

    def _quotas_of(self, address: str) -> AddressQuotas:
        """Return the quotas shared by all clients of an address.

        Clients on this machine have no limit on work, just as they have none on connections.
        """
        network = network_of(address)
        quotas = self._addresses.get(network)
        if quotas is None:
            self._addresses = {name: left for name, left in self._addresses.items() if not left.is_empty}
            bounded = address and not is_local(address)
            work = self._work(self.limits.work_per_second if bounded else 0.0)
            quotas = self._addresses[network] = AddressQuotas(work)
        return quotas

    def _work(self, rate: float, of_address: WorkLimit | None = None) -> WorkLimit:
        return WorkLimit(rate, self.limits.work_burst, self.work, self._graph.clock.monotonic, of_address)

    def reader(self, info: PeerInfo) -> GraphView:
        """Return the view of the graph for the sender of an HTTP request, by the token in the request.

        Raises:
            Refused: the token is unknown, or a token is required (401).
        """
        role = self.admission.role_of(info)
        if role is None:
            reason = "this page is for clients that authenticate by a token (auth.tokens)"
            self.admission.log_refusal("token", info, reason, logging.INFO)
            raise Refused(401, reason, {"WWW-Authenticate": 'Bearer realm="rosbridge"'})
        work = self._quotas_of(info.address).work
        holder = holder_of(info.address, role.credential)
        return self.view(role, work, partial(self._while_allowed, info), holder)

    def view(
        self, role: Role, work: WorkLimit, keep: Keep | None = None, holder: Holder = NOBODY
    ) -> GraphView:
        """Return the view of the graph for a role, see :class:`~rwt.access.graph_view.GraphView`."""
        open_services = frozenset[str]() if self.gate is None else self.gate.open_services
        return GraphView(self._graph, role, work, keep, open_services=open_services, holder=holder)

    def _while_allowed(
        self, info: PeerInfo, topics: Iterable[str], end: Callable[[str], None]
    ) -> Callable[[], None]:
        """Register an open response, as :meth:`rwt_transports.http.routes.Reader.while_allowed` does."""
        response = _OpenResponse(info, tuple(topics), end)
        if reason := self._reason_to_end(response):
            self.admission.log_refusal("role", info, reason)
            raise Refused(403, reason)
        key = object()
        self._open_responses[key] = response

        def ended() -> None:
            self._open_responses.pop(key, None)

        return ended

    def _reason_to_end(self, response: _OpenResponse) -> str:
        """Return why a response has to end; empty if it may stay open."""
        try:
            role = self.admission.role_of(response.info)
        except Refused as refused:
            return refused.reason
        if role is None:
            return _GONE
        refused_topics = (topic for topic in response.topics if not role.allows("subscribe", topic))
        topic = next(refused_topics, None)
        return "" if topic is None else f"{_GONE}: role {role.name!r} may not subscribe to {topic}"
