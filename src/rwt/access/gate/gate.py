"""The gate of one server: its rules, the topics they are about, the emergency stop and the approvals."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from rwt.access.errors import GateRefused
from rwt.access.gate.approvals import Approvals
from rwt.access.gate.audit_file import AuditFile
from rwt.access.gate.fields import FieldChecks, NoSuchField
from rwt.access.gate.record import Actor, Recorder
from rwt.access.gate.rules import Rules, pattern
from rwt.access.gate.topic import GuardedTopic
from rwt.access.graph_view import canonical
from rwt_interfaces.payload import Payload

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rwt.access.audit import Audit
    from rwt.access.gate.rules import GatedAct, Rule
    from rwt.access.roles import Role
    from rwt.access.settings.gate import GateSettings
    from rwt_graph.api import Graph
    from rwt_interfaces.structs import MessageType

logger: Final = logging.getLogger("rwt.bridge")

GATE_NODE: Final = "/gate"
"""The node as which the gate publishes stop messages, and tells who holds what."""

#: Types for which the checks of requests and goals are remembered; at the bound all are forgotten.
_MOST_TYPES: Final = 1000


class BadRule(Exception):
    """A rule cannot be applied to what is in the graph. The text names the setting."""


class Gate:
    """What clients' acts have to pass.

    Attributes:
        settings: see there.
        rules: all of them.
        participant: the gate's node in the graph.
        clock: of the graph.
        recorder: notes what happens.
        approvals: what waits for a person's yes.
        is_observing: whether it only says what it would refuse.
        stopped_by: who has pressed the emergency stop; empty while it is released.
        stopped_reason: why, as they say; or why it was released.
        stopped_ns: ROS time of the last change.
        last_by: who pressed or released it last.
        on_leases, on_stop, on_approvals: called when these have changed.

    Args:
        graph: the robot.
        settings: see there.
        audit: the server's log.

    Raises:
        BadRule: a rule does not fit a topic that is there.
        OSError: the audit's file cannot be opened.
    """

    def __init__(self, graph: Graph, settings: GateSettings, audit: Audit) -> None:
        self._graph = graph
        self.settings = settings
        self.rules = Rules(settings.rules)
        self.clock = graph.clock
        self.is_observing = settings.mode == "observe"
        self._file = AuditFile(settings.audit) if settings.audit.file is not None else None
        self.recorder = Recorder(self._file, audit, graph.clock)
        self.participant = graph.participant(GATE_NODE)
        self.approvals = Approvals(graph.clock, self.recorder, self._approvals_changed)
        self.on_leases: Callable[[], None] | None = None
        self.on_stop: Callable[[], None] | None = None
        self.on_approvals: Callable[[], None] | None = None
        self.stopped_by = ""
        self.stopped_reason = ""
        self.last_by = ""
        self.stopped_ns = graph.clock.time_ns()
        self._actors: dict[str, Actor] = {}
        self._count = 0
        self._topics: dict[str, GuardedTopic] = {}
        self._checks: dict[tuple[Rule, MessageType], FieldChecks | str] = {}
        try:
            self._check_rules()
        except BaseException:
            self.close()
            raise
        if settings.emergency.at_start:
            self._latch("the setting gate.emergency.at_start", "")

    def _check_rules(self) -> None:
        """Apply every rule to what is in the graph now, so that mistakes are found before they matter."""
        for topic in self._graph.topics():
            if topic.type is not None and self.rules.of("publish", topic.name):
                guarded = self.guarded(topic.name, topic.type)
                if guarded.fault:
                    raise BadRule(guarded.fault)
        types: list[tuple[GatedAct, str, MessageType]] = [
            *(("call", each.name, each.type.request) for each in self._graph.services()),
            *(("goal", each.name, each.type.goal) for each in self._graph.actions()),
        ]
        for act, name, type in types:
            for rule in self.rules.of(act, name):
                checks = self._checks_of(rule, type)
                if isinstance(checks, str):
                    raise BadRule(f"{checks} ({name})")

    # Clients

    def join(self, name: str, role: Role, address: str) -> Actor:
        """Know a client from now on, under a name that no other has."""
        self._count += 1
        actor = Actor(name or f"client:{self._count}", role, address)
        if actor.name in self._actors:
            actor.name = f"{actor.name}.{self._count}"
        self._actors[actor.name] = actor
        return actor

    def leave(self, actor: Actor) -> None:
        """Forget a client: what it holds is free, and what it asked is not done."""
        self._actors.pop(actor.name, None)
        for topic in tuple(self._topics.values()):
            topic.left(actor, "its holder has left")
        self.approvals.left(actor)

    def left_topic(self, actor: Actor, name: str) -> None:
        """A client does not publish on a topic any more."""
        topic = self._topics.get(name)
        if topic is not None:
            topic.left(actor, "its holder stopped publishing")

    def take_role(self, actor: Actor, role: Role) -> None:
        """A client has another role, which may allow less."""
        actor.rights = role
        for topic in tuple(self._topics.values()):
            if not role.allows("publish", topic.name):
                topic.left(actor, "its holder's role may not publish there")

    # Topics

    @property
    def topics(self) -> tuple[GuardedTopic, ...]:
        """The topics that rules are about and somebody has published on, or that the robot has."""
        return tuple(self._topics.values())

    def guarded(self, name: str, type: MessageType) -> GuardedTopic:
        """The topic of that name, about which there are rules.

        Raises:
            GateRefused: it is in use with another type.
        """
        topic = self._topics.get(name)
        if topic is not None:
            if topic.type is type or topic.type.name == type.name:
                return topic
            if not topic.is_idle:
                raise GateRefused(f"{name} is of type {topic.type.name} for the gate, not {type.name}")
        for each in [each for each in self._topics.values() if each is topic or self._is_abandoned(each)]:
            each.close()
            del self._topics[each.name]
        topic = self._topics[name] = GuardedTopic(self, name, type, self.rules.of("publish", name))
        if topic.lease is not None:
            self.leases_changed()
        return topic

    def _is_abandoned(self, topic: GuardedTopic) -> bool:
        """Whether nobody but the gate itself knows of a topic any more."""
        info = self._graph.topic(topic.name)
        others = () if info is None else (*info.publishers, *info.subscribers)
        return topic.is_idle and all(each.node == GATE_NODE for each in others)

    def leases_changed(self) -> None:
        """Tell who holds what now."""
        if self.on_leases is not None:
            self.on_leases()

    def approve_message(self, topic: str, rule: Rule, client: Actor, payload: Payload) -> None:
        """Refuse a message that nobody has said yes to, and ask.

        Raises:
            GateRefused: nobody has, yet.
        """
        if self.approvals.take(client, "publish", topic, rule):
            return
        text = f"publishing on {topic} needs a person's yes"
        if not self.is_observing:
            waits = self.approvals.waits(client, "publish", topic, rule)
            waits = waits or self.approvals.ask(client, "publish", topic, rule, payload)
            text += f", which was asked for under id {waits.id}: send it again when it is there"
        raise GateRefused(text, f"{rule.key}.approval")

    def _approvals_changed(self) -> None:
        if self.on_approvals is not None:
            self.on_approvals()

    # Requests and goals

    def check(
        self, actor: Actor, acts: Iterable[tuple[GatedAct, str]], type: MessageType, payload: Payload
    ) -> tuple[Payload, list[tuple[GatedAct, str, Rule]]]:
        """The request or goal of a client as it may be sent, and the acts to which a person has to say yes.

        Args:
            actor: the client.
            acts: what it does with it, first what the payload is for.
            type: of the payload.
            payload: the request or the goal.

        Raises:
            GateRefused: a rule does not let it through; the text says which.
        """
        asked: dict[tuple[GatedAct, Rule], list[str]] = {}
        for number, (act, name) in enumerate(acts):
            for rule in self.rules.of(act, name):
                if not rule.holds_for(actor.role):
                    continue
                self.require_moving(rule)
                if number == 0:
                    payload = self._checked(actor, act, name, rule, type, payload)
                if rule.settings.approval is not None:
                    asked.setdefault((act, rule), []).append(name)
        # One yes of a rule is for all parameters of a call.
        needed = [
            (act, ", ".join(names), rule)
            for (act, rule), names in asked.items()
            if not self.approvals.take(actor, act, ", ".join(names), rule)
        ]
        if not self.is_observing:
            return payload, needed
        for act, name, rule in needed:
            key = f"{rule.key}.approval"
            self.recorder.note("would refuse", act, name, actor, f"needs a person's yes ({key})", key)
        return payload, []

    def require_moving(self, rule: Rule) -> None:
        """Refuse what the emergency stop forbids.

        Raises:
            GateRefused: it is on, and the rule names it.
        """
        if self.stopped_by and rule.settings.emergency:
            raise GateRefused(
                f"the emergency stop is on: stopped by {self.stopped_by}", f"{rule.key}.emergency"
            )

    def _checked(
        self, actor: Actor, act: GatedAct, name: str, rule: Rule, type: MessageType, payload: Payload
    ) -> Payload:
        checks = self._checks_of(rule, type)
        if isinstance(checks, str):
            raise GateRefused(f"the rules of {name} cannot be applied: {checks}")
        taken, changes = checks.check(payload, None, self.clock.monotonic())
        if changes:
            self.recorder.note("changed", act, name, actor, changes, rule.key)
        return payload if self.is_observing else taken

    def _checks_of(self, rule: Rule, type: MessageType) -> FieldChecks | str:
        """The limits of a rule for a type of requests or goals; in words what is wrong with them."""
        checks = self._checks.get((rule, type))
        if checks is None:
            if len(self._checks) >= _MOST_TYPES:
                self._checks.clear()
            try:
                checks = FieldChecks(rule, type)
            except NoSuchField as wrong:
                checks = str(wrong)
                logger.error("the gate lets nothing through: %s", wrong)
            self._checks[rule, type] = checks
        return checks

    # Leases

    def leased(self, actor: Actor | None, name: str) -> GuardedTopic:
        """The topic of that name, whose lease a client asks about.

        Raises:
            GateRefused: there is no lease there, or the client may not publish there.
        """
        absolute = canonical(name)
        if actor is not None and not actor.rights.allows("publish", absolute):
            raise GateRefused(
                f"role {actor.role!r} may not publish on {absolute}", f"roles.{actor.role}.publish"
            )
        rules = self.rules.of("publish", absolute)
        if not any(rule.settings.lease for rule in rules if actor is None or rule.holds_for(actor.role)):
            raise GateRefused(f"no rule of the gate asks for a lease of {absolute}")
        topic = self._topics.get(absolute)
        info = self._graph.topic(absolute)
        if topic is None and info is not None and info.type is not None:
            topic = self.guarded(absolute, info.type)
        if topic is None or topic.lease is None:
            raise GateRefused(f"nobody has advertised {absolute}, so that its type is not known yet")
        if topic.fault:
            raise GateRefused(f"the rules of {absolute} cannot be applied: {topic.fault}")
        return topic

    def lease_seconds(self, role: Role, name: str) -> float | None:
        """Silence after which a client of a role loses the lease of a topic; None where no rule asks for one,
        and where the gate only observes."""
        if self.is_observing:
            return None
        rules = self.rules.of("publish", canonical(name))
        leases = (rule.settings.lease for rule in rules if rule.holds_for(role.name))
        return min((lease.seconds for lease in leases if lease is not None), default=None)

    def take_lease(self, actor: Actor, name: str) -> None:
        """Give a client a lease that it asks for.

        Raises:
            GateRefused: another one holds it, or as :meth:`leased`.
        """
        topic = self.leased(actor, name)
        if topic.is_stopped:
            raise GateRefused(
                f"the emergency stop is on: stopped by {self.stopped_by}", f"{topic.lease_rule}.emergency"
            )
        assert topic.lease is not None  # `leased` finds no others.
        before = topic.lease.holder
        topic.lease.take(actor)
        if before is not None and before is not actor:
            topic.halt()  # What the former holder said last is not what the new one wants.

    def release_lease(self, actor: Actor, name: str) -> None:
        """Free a lease, and stop the robot.

        Raises:
            GateRefused: the client does not hold it, or as :meth:`leased`.
        """
        topic = self.leased(actor, name)
        assert topic.lease is not None  # `leased` finds no others.
        self._require_holder(topic, actor)
        topic.lease.lose(actor, "given back")

    def pass_lease(self, actor: Actor, name: str, to: str) -> None:
        """Give a lease to another client, and stop the robot until that publishes.

        Raises:
            GateRefused: the client does not hold it, the other one is not there or may not publish there, or
                as :meth:`leased`.
        """
        topic = self.leased(actor, name)
        assert topic.lease is not None  # `leased` finds no others.
        self._require_holder(topic, actor)
        other = self._actors.get(to)
        if other is None:
            raise GateRefused(
                f"there is no client {to[:80]!r}; each hears its own name from /gate/take_lease"
            )
        self.leased(other, name)
        topic.lease.pass_on(other)

    def _require_holder(self, topic: GuardedTopic, actor: Actor) -> None:
        holder = None if topic.lease is None else topic.lease.holder
        if holder is not actor:
            raise GateRefused(f"{topic.name} is held by {holder or 'nobody'}, and not by this client")

    # The emergency stop

    def stop(self, actor: Actor | None, reason: str = "") -> None:
        """Stop the robot, and let nothing move it until that is released.

        Args:
            actor: who stops it; None: a program of the robot itself.
            reason: in words of theirs.

        Raises:
            GateRefused: the role may not, or no rule says what there is to stop.
        """
        roles = self.settings.emergency.stop_roles
        if actor is not None and pattern(roles).fullmatch(actor.role) is None:
            raise GateRefused(f"role {actor.role!r} may not stop the robot", "gate.emergency.stop_roles")
        if not any(rule.settings.emergency for rule in self.rules.all):
            raise GateRefused("no rule says what there is to stop: set gate.rules.NAME.emergency")
        self._latch(str(actor or "the robot"), reason, actor)
        if self.is_observing:
            raise GateRefused(
                "what moves was told to stop, but the gate only observes and refuses nothing", "gate.mode"
            )

    def _latch(self, by: str, reason: str, actor: Actor | None = None) -> None:
        self.stopped_by = self.last_by = by
        self.stopped_reason = reason[:500]
        self.stopped_ns = self.clock.time_ns()
        self.recorder.note("stop", "stop", "", actor, f"stopped by {by}: {self.stopped_reason}")
        for info in self._graph.topics():
            rules = self.rules.of("publish", info.name)
            if info.type is not None and any(rule.settings.emergency for rule in rules):
                self.guarded(info.name, info.type)
        for topic in tuple(self._topics.values()):
            if topic.is_stopped:
                topic.emergency_stop()
        self._cancel_goals()
        if self.is_observing:
            self.stopped_by = ""  # It refuses nothing.
        if self.on_stop is not None:
            self.on_stop()

    def release(self, actor: Actor | None, reason: str = "") -> None:
        """Let the robot be moved again. Nobody holds a lease then.

        Raises:
            GateRefused: the role may not.
        """
        roles = self.settings.emergency.release_roles
        if actor is not None and pattern(roles).fullmatch(actor.role) is None:
            raise GateRefused(
                f"role {actor.role!r} may not release the robot", "gate.emergency.release_roles"
            )
        if not self.stopped_by:
            return
        self.stopped_by = ""
        self.last_by = str(actor or "the robot")
        self.stopped_reason = reason[:500]
        self.stopped_ns = self.clock.time_ns()
        self.recorder.note("stop", "release", "", actor, f"released by {self.last_by}: {self.stopped_reason}")
        if self.on_stop is not None:
            self.on_stop()

    def _cancel_goals(self) -> None:
        """Cancel the goals of every action that the stop is for, whoever sent them."""
        for info in self._graph.actions():
            if self._stops("goal", info.name):
                self.participant.cancel_every_goal(info.name)
        for topic in self._graph.topics():
            # An action of ROS 1 that the graph knows by its topics alone.
            action, _, part = topic.name.rpartition("/")
            if topic.type is None or (part, topic.type.name) != ("cancel", "actionlib_msgs/GoalID"):
                continue
            if self._stops("goal", action):
                self._publish_once(topic.name, topic.type)

    def _stops(self, act: GatedAct, name: str) -> bool:
        return any(rule.settings.emergency for rule in self.rules.of(act, name))

    def _publish_once(self, topic: str, type: MessageType) -> None:
        """Publish a message of defaults."""
        publisher = self.participant.advertise(topic, type)
        publisher.publish(Payload.from_value(type, {}))
        publisher.close()

    # Leaving

    def close(self) -> None:
        """Leave the graph, and write what the audit's queue holds."""
        for topic in self._topics.values():
            topic.close()
        self._topics.clear()
        self.participant.close()
        if self._file is not None:
            self._file.close()

    @property
    def dropped_lines(self) -> int:
        """Lines of the audit that could not be written."""
        return 0 if self._file is None else self._file.dropped
