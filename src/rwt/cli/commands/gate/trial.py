"""One request against a configuration: access control of a server, with a robot that takes everything."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from typing import Final, cast

from rwt.access.access import Access
from rwt.access.client_graph import ClientGraph
from rwt.access.errors import AccessError, GateRefused
from rwt.access.gate.rules import is_gated
from rwt.access.graph_view import canonical
from rwt.access.roles import Act, Role
from rwt.access.settings import AuditSettings, SettingsError
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.composition.graphs import make_registry
from rwt.declarations import NodeContext, NodePart
from rwt.delivery.shared_graph import SharedGraph
from rwt.rosapi import DISCLOSURES
from rwt.settings import Settings
from rwt_graph import MemoryGraph, SimulatedClock
from rwt_graph.api import GoalEvents, Sample, ServerGoal, ServiceCall
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import CallFailed, RobotError
from rwt_transports.endpoint import PeerInfo
from rwt_transports.errors import Refused

_ADDRESS: Final = "127.0.0.1"

#: Setting at the end of an error of a role: `(roles.viewer.publish)`.
_SETTING: Final = re.compile(r"\(([\w.-]+)\)$")

_ROLE_ACTS: Final = ("subscribe", "get_param", "provide")


@dataclass(slots=True)
class Outcome:
    """Decision about a request.

    Attributes:
        decision: `allowed`, `changed`, `needs approval` or `denied`.
        rule: key of the setting that decided; empty if none did.
        role: role of the client; empty without one.
        credential: name of its token.
        rules: keys of the gate rules that were checked.
        sent: what the robot received, as JSON, if it was changed.
    """

    decision: str
    text: str = ""
    rule: str = ""
    role: str = ""
    credential: str = ""
    rules: list[str] = field(default_factory=list)
    sent: str = ""


class Trial:
    """Access control of a server without clients, in a graph whose robot accepts every request.

    A request is sent for real, through the :class:`rwt.access.client_graph.ClientGraph` of a client; the
    robot records what it receives.

    Args:
        settings: settings of the server; its audit is not written.

    Raises:
        CommandError: a server would not start with these settings.
    """

    def __init__(self, settings: Settings) -> None:
        # Default audit settings write no file.
        gate = settings.gate.model_copy(update={"audit": AuditSettings()})
        self._settings = settings.model_copy(update={"gate": gate})
        self._received: list[bytes] = []
        try:
            self._graph = MemoryGraph(make_registry(self._settings), SimulatedClock(0))
            # Requests to the demo robot's topics, services and actions need no --type.
            for each, own in self._settings.active("node"):
                if isinstance(each.part, NodePart) and each.part.in_trials:
                    each.part.make(NodeContext(self._graph, self._settings.limits), own)
            self._access = Access(self._graph, self._settings, DISCLOSURES)
        except SettingsError as error:
            raise CommandError(str(error), CALLED_WRONGLY) from error
        self._robot = self._graph.participant("/robot")

    def role_of(self, token: str | None, name: str | None) -> Role | None:
        """Return the role of a client; None if a client without credentials is refused.

        Args:
            token: name of a token, or the token; None for a client without.
            name: name of a role, instead.

        Raises:
            CommandError: there is no such token or role.
        """
        admission = self._access.admission
        if name is not None:
            if name not in admission.roles:
                raise CommandError(
                    f"no role {name!r}; known are {', '.join(admission.roles)}", CALLED_WRONGLY
                )
            return admission.roles[name]
        if token is None:
            return admission.default_role
        known = self._settings.auth.tokens.get(token)
        if known is not None:
            return admission.roles[known.role].given_by(token)
        try:
            role = admission.role_of_token(
                PeerInfo("http", _ADDRESS, 0, "/", {"authorization": f"Bearer {token}"})
            )
        except Refused:
            role = None
        if role is None:
            names = ", ".join(self._settings.auth.tokens) or "none"
            raise CommandError(f"--as: no such token in auth.tokens; known names are {names}", CALLED_WRONGLY)
        return role

    def decide(self, role: Role | None, verb: str, name: str, message: object, type: str | None) -> Outcome:
        """Decide a request: check the role, then send the request and compare what the robot receives.

        Args:
            role: role of the client; None if clients without credentials are refused.
            verb: `publish`, `subscribe`, `call`, `goal`, `get_param`, `set_param` or `provide`.

        Raises:
            CommandError: the type is missing or unknown, or the message does not fit it.
        """
        if role is None:
            text = "a client without credentials is refused (auth.default_role)"
            return Outcome("denied", text, "auth.default_role")
        outcome = Outcome("allowed", role=role.name, credential=role.credential)
        try:
            absolute = f"/{name.removeprefix('/')}" if verb.endswith("param") else canonical(name)
            act = cast("Act", "goals" if verb == "goal" else verb)
            if role.allows(act, absolute):
                outcome.rules = self._rules_of(role, verb, absolute)
            if verb in _ROLE_ACTS:  # The gate has no rules for these.
                role.require(act, absolute)
                return outcome
            client = self._access.client(SharedGraph(self._graph, "/check", 0.0, _ignore), role, _ADDRESS)
            sent = self._send(client, verb, absolute, json.dumps(message).encode(), type)
        except AccessError as refused:
            return self._refused(outcome, refused)
        except (InterfaceError, RobotError, CallFailed, ValueError) as error:
            raise CommandError(f"{verb} {name}: {error}", CALLED_WRONGLY) from error
        return self._passed(outcome, sent)

    def _passed(self, outcome: Outcome, sent: bytes) -> Outcome:
        """Complete the outcome of a request that was not rejected: pending approval, changed or allowed."""
        gate = self._access.gate
        if gate is not None and gate.approvals.pending:
            rule = gate.approvals.pending[0].rule
            return self._refused(outcome, GateRefused("requires human approval", f"{rule.key}.approval"))
        received = self._received[-1] if self._received else b""
        if received and json.loads(received) != json.loads(sent):
            outcome.decision, outcome.sent = "changed", received.decode()
        return outcome

    def _refused(self, outcome: Outcome, refused: AccessError) -> Outcome:
        """Complete the outcome of a request that was rejected, with the setting that rejected it."""
        outcome.decision, outcome.text = "denied", str(refused)
        found = _SETTING.search(str(refused))
        outcome.rule = refused.rule if isinstance(refused, GateRefused) else found[1] if found else ""
        if outcome.rule.endswith(".approval"):
            outcome.decision = "needs approval"
        return outcome

    def _rules_of(self, role: Role, verb: str, name: str) -> list[str]:
        gate = self._access.gate
        if gate is None or not is_gated(verb):
            return []
        return [rule.key for rule in gate.rules.of(verb, name) if rule.holds_for(role.name)]

    def _send(self, client: ClientGraph, verb: str, name: str, message: bytes, type: str | None) -> bytes:
        """Send a request, which the robot notes; return it as it would be without a gate."""
        registry, robot = self._graph.registry, self._robot
        made: list[bytes] = []

        def payload(type: MessageType) -> Payload:
            made.append(bytes(Payload.from_json(type, message, lambda: 0).json()))
            return Payload.from_json(type, message, lambda: 0)

        match verb:
            case "publish":
                info = self._graph.topic(name)
                known = info.type if info is not None else None
                wanted = registry.message(_required(type, name)) if type or known is None else known
                robot.subscribe(name, self._on_sample, wanted)
                client.publisher(name, registry.type_name(wanted)).publish(payload(wanted))
            case "call":
                if type is not None or self._graph.service(name) is None:
                    robot.advertise_service(name, registry.service(_required(type, name)), self._on_call)
                client.call_service(name, payload, _ignore)
            case "goal":
                if type is not None or self._graph.action(name) is None:
                    robot.advertise_action(name, registry.action(_required(type, name)), self._on_goal)
                client.send_goal(name, lambda type: payload(type.goal), GoalEvents(_ignore))
            case _:
                service = "/rosapi/set_param"
                robot.advertise_service(service, registry.service("rosapi_msgs/SetParam"), self._on_call)
                message = json.dumps({"name": name, "value": message.decode()}).encode()
                client.call_service(service, payload, _ignore)
        return made[-1]

    def _on_sample(self, sample: Sample) -> None:
        self._received.append(bytes(sample.payload.json()))

    def _on_call(self, call: ServiceCall) -> None:
        self._received.append(bytes(call.request.json()))

    def _on_goal(self, goal: ServerGoal) -> None:
        self._received.append(bytes(goal.goal.json()))


def _required(type: str | None, name: str) -> str:
    if type is None:
        raise CommandError(f"{name}: the configuration does not state its type: pass --type", CALLED_WRONGLY)
    return type


def _ignore(*_: object) -> None:
    """Ignore an outcome: only the decision counts."""
