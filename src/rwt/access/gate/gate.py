"""Gate of one server: rules, guarded topics, leases and the emergency stop."""

from __future__ import annotations

import logging
import re
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from functools import partial
from typing import Any, Final

from rwt.access.audit import Audit, one_line
from rwt.access.disclosure import affected_parameters
from rwt.access.errors import GateRefused
from rwt.access.gate.approvals import Approvals, Subject
from rwt.access.gate.fields import (
    BYTES_OF_ITEM,
    Change,
    Clamped,
    FieldChecks,
    NoSuchField,
    describe_fields,
    has_finite_numbers,
    without_repeats,
)
from rwt.access.gate.lease import Lease, WakeWatch
from rwt.access.gate.record import Actor, Decision, Recorder, bounded
from rwt.access.gate.rules import GatedAct, Rule, Rules
from rwt.access.gate.stop_path import Cancel, StopPath
from rwt.access.gate.topic import LOST_BY_RELOAD, GuardedTopic, TopicState
from rwt.access.graph_view import canonical
from rwt.access.roles import Role, absolute_globs, glob_pattern
from rwt.access.settings import GateRule, GateSettings, SettingsError
from rwt_graph.api import Graph, Publisher, ServiceInfo
from rwt_graph.parameters.values import decode
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import CallFailed, NotFound, ParameterRejected

logger: Final = logging.getLogger("rwt.bridge")

#: Maximum number of types whose compiled checks of requests and goals are cached; then the cache is cleared.
_MAX_TYPES: Final = 1000

#: Maximum number of topics that the answer to a press names, because they could not be stopped.
_MAX_FAULTS: Final = 5

#: Maximum number of parameters that are checked for one write.
_MAX_PARAMETERS: Final = 1000

#: Maximum number of characters of a client's name for a parameter in an error text.
_MAX_NAME: Final = 80

#: Seconds for which a node's parameter is read before its change is recorded without the value before.
_READ_SECONDS: Final = 2.0

#: Maximum number of publishers of `cancel` topics.
_MAX_CANCELS: Final = 64


MAX_LEASES: Final = 64
"""Maximum number of leases held by the clients of one credential, or of one address without credentials."""

GATE_NODE: Final = "/gate"
"""Node as which the gate publishes stop messages and its own state."""


class Gate:
    """Gate of one server: checks what clients do to the robot against the rules of the settings.

    The emergency stop is released or pressed: ``stopped_by`` names who pressed it, and is empty while it is
    released. In mode ``observe`` a press publishes the stop messages, and is released at once.

    Private attributes: ``_stop_roles`` (cached: True for roles that may press the emergency stop),
    ``_checks`` (limits of rules, compiled for a type of requests or goals),
    ``_cancels`` (publishers of the `cancel` topics of ROS 1's actions, by topic),
    ``_count`` (number of clients so far), ``_topics`` (by name; from the first publisher on, or since the
    robot has the topic), ``_sweep`` (the same, in the order in which they are examined for removal).

    Attributes:
        is_observing: True if the gate only records what it would reject.
        participant: the gate's node in the graph.
        actors: clients by name.
        stop_path: stop messages of all topics.
        presses: number of times that the emergency stop was pressed.
        faults: topics that cannot be stopped, with the reason.
        stopped_by: client or program that pressed the emergency stop; empty while it is released.
        stopped_reason: reason for the last press or release, in the words of the client.
        stopped_ns: ROS time of the last press or release.
        last_by: client or program that pressed or released the stop last.
        stop_type: type of the topic that presses the emergency stop.
        held: leases with a holder, with the names of their topics.
        leases_held: number of the same by identity, see :attr:`rwt.access.gate.record.Actor.owner`.
        wake_watch: ends them after a suspension of the machine.
        open_services: services that every role may call, because the gate decides; set by the gate's node.
        on_leases, on_stop, on_approvals: called after a change; set by the gate's node.

    Raises:
        SettingsError: a rule does not fit a topic, service or action of the graph.
        OSError: the audit file cannot be opened.
    """

    def __init__(self, graph: Graph, settings: GateSettings, audit: Audit) -> None:
        self._graph = graph
        self.settings = settings
        self.is_observing = settings.mode == "observe"
        self._stop_roles: dict[str, bool] = {}
        self.rules = Rules(settings)
        self.clock = graph.clock
        self.recorder = Recorder(settings.audit, audit, graph.clock)
        self.participant = graph.participant(GATE_NODE)
        self.approvals = Approvals(graph.clock, self.recorder, lambda: self.on_approvals(), self._describe)
        self.stop_path = StopPath(graph.clock, self._not_stopped)
        self.presses = 0
        self.faults: dict[str, str] = {}
        self.stopped_by = ""
        self.stopped_reason = ""
        self.stopped_ns = graph.clock.time_ns()
        self.last_by = ""
        self.stop_type: MessageType = graph.registry.message("std_msgs/Empty")
        self.held: dict[Lease, str] = {}
        self.leases_held: Counter[str] = Counter()
        self.wake_watch = WakeWatch(graph.clock, self._look)
        self.on_leases = self.on_stop = self.on_approvals = _nothing
        self.open_services: Set[str] = frozenset()
        self.actors: dict[str, Actor] = {}
        self._count = 0
        self._topics: dict[str, GuardedTopic] = {}
        self._sweep: deque[GuardedTopic] = deque()
        self._checks: dict[tuple[Rule, MessageType, bool], FieldChecks | str] = {}
        self._cancels: dict[str, Publisher] = {}
        try:
            self._check_rules()
        except BaseException:
            self.close()
            raise
        if settings.emergency.at_start:
            self._latch("the setting gate.emergency.at_start", "")

    def _check_rules(self) -> None:
        """Apply every rule to its own type and to the present graph, to find mistakes at startup."""
        for rule in self.rules.all:
            if rule.settings.type is not None:
                try:
                    rule.type = self._graph.registry.message(rule.settings.type)
                except InterfaceError as error:
                    raise SettingsError(f"`{rule.key}.type`: {error}") from None
                for name in filter(_is_name, absolute_globs(rule.settings.topics)):
                    _require_fit(self.guarded(name, rule.type))
        for topic in self._graph.topics():
            if topic.type is not None and self.rules.of("publish", topic.name):
                _require_fit(self.guarded(topic.name, topic.type))
        types: list[tuple[GatedAct, str, MessageType]] = [
            *(("call", each.name, each.type.request) for each in self._graph.services()),
            *(("goal", each.name, each.type.goal) for each in self._graph.actions()),
        ]
        for act, name, type in types:
            for rule in self.rules.of(act, name):
                try:
                    self._checks_of(rule, type)
                except NoSuchField as wrong:
                    raise SettingsError(f"{wrong} ({name})") from None

    def replace_rules(self, settings: GateSettings) -> None:
        """Replace the rules, the mode, and the roles of the emergency stop while clients are connected.

        Either everything changes or nothing. A lease stays with its holder if rules and role still allow it;
        otherwise the robot is stopped there. Requests and approvals of changed rules are denied. The
        emergency stop stays pressed. Gateways have to request their publishers again.

        Raises:
            SettingsError: a rule does not fit the graph, the emergency stop would end somewhere, or the
                change requires a restart. Nothing has changed.
        """
        before = self.settings
        self._require_reloadable(settings)
        if settings == before:
            return
        old = self.rules, self._topics, self._sweep, self._checks, dict(self.faults)
        topics = self._topics
        self.rules, self._topics, self._sweep, self._checks = Rules(settings), {}, deque(), {}
        try:
            self._check_rules()
            for topic in topics.values():
                if self.rules.of("publish", topic.name):
                    _require_fit(self.guarded(topic.name, topic.type))
        except (SettingsError, GateRefused) as wrong:
            for topic in self._topics.values():
                topic.close()
            self.rules, self._topics, self._sweep, self._checks, self.faults = old
            raise SettingsError(str(wrong)) from None
        self.settings = settings
        self.is_observing = settings.mode == "observe"
        self._stop_roles.clear()
        for topic in topics.values():
            if self.rules.of("publish", topic.name):
                self.guarded(topic.name, topic.type).take_over(topic)
            else:
                topic.end_lease(LOST_BY_RELOAD)
            topic.close()
        names = {*before.rules, *settings.rules}
        keys = {f"gate.rules.{name}" for name in names if before.rules.get(name) != settings.rules.get(name)}
        changed = [rule for rule in (*old[0].all, *self.rules.all) if rule.key in keys]

        def concerns(subject: Subject) -> bool:
            """Return True for a request that a changed rule has checked, or would check now."""
            names = subject.name.split(", ")
            about = any(rule.names(subject.act, name) for rule in changed for name in names)
            return about or subject.rule in keys

        for _ in self.approvals.drop(concerns, "the settings have changed"):
            pass
        text = f"rules replaced; changed are {', '.join(sorted(keys)) or 'none'}"
        self.recorder.note("reload", "reload", "", None, text, before=before.mode, after=settings.mode)
        self.on_leases()

    def _require_reloadable(self, settings: GateSettings) -> None:
        """Raise SettingsError for a change that requires a restart, or would end an emergency stop."""
        if settings.audit != self.settings.audit:
            raise SettingsError("`gate.audit`: cannot change while the server runs: restart it")
        if bool(settings.rules) != bool(self.settings.rules):
            raise SettingsError("`gate.rules`: the first and the last rule require a restart of the server")
        if not self.stopped_by:
            return
        if settings.mode != self.settings.mode:
            raise SettingsError("`gate.mode`: the emergency stop is on: release it first")
        for name, rule in self.settings.rules.items():
            now = settings.rules.get(name)
            if rule.emergency and (now is None or not _stops_the_same(rule, now)):
                raise SettingsError(
                    f"`gate.rules.{name}`: the change would end the emergency stop: release it first"
                )

    # Clients

    def join(self, name: str, role: Role, address: str, device: str = "") -> Actor:
        """Add a client, under a name that no other client has."""
        self._count += 1
        actor = Actor(name or f"client:{self._count}", role, address, device)
        if actor.name in self.actors:
            actor.name = f"{actor.name}.{self._count}"
        self.actors[actor.name] = actor
        return actor

    def leave(self, actor: Actor) -> None:
        """Remove a client: release its leases, and withdraw its requests for approval."""
        self.actors.pop(actor.name, None)
        for topic in tuple(actor.topics):
            topic.leave(actor, "its holder has left")
        self.approvals.leave(actor)

    def leave_topic(self, actor: Actor, name: str) -> None:
        """Remove a client that no longer publishes on a topic."""
        topic = self._topics.get(name)
        if topic is not None:
            topic.leave(actor, "its holder stopped publishing")

    # Topics

    @property
    def topics(self) -> tuple[GuardedTopic, ...]:
        """Guarded topics: those that clients have published on, and those of the robot with rules."""
        return tuple(self._topics.values())

    def holder_of(self, name: str) -> Actor | None:
        """Return the client that holds the lease of a topic, given by its absolute name."""
        topic = self._topics.get(name)
        return None if topic is None or topic.lease is None else topic.lease.holder

    def leased_topics(self) -> Iterator[GuardedTopic]:
        """Yield the topics with a lease, those with a holder first."""
        yield from (self._topics[name] for name in tuple(self.held.values()) if name in self._topics)
        for topic in self._topics.values():
            if topic.lease is not None and topic.lease not in self.held:
                yield topic

    def guarded(self, name: str, type: MessageType) -> GuardedTopic:
        """Return the guarded topic of a name. Raises GateRefused if it is in use with another type."""
        topic = self._topics.get(name)
        if topic is not None:
            if topic.type is type or topic.type.name == type.name:
                return topic
            if not topic.is_idle:
                raise GateRefused(f"{name} is of type {topic.type.name} for the gate, not {type.name}")
            topic.close()
            del self._topics[name]
        self._drop_abandoned()
        topic = self._topics[name] = GuardedTopic(self, name, type, self.rules.of("publish", name))
        self._sweep.append(topic)
        if topic.lease is not None:
            self.on_leases()
        return topic

    def guard_anew(self, topic: GuardedTopic) -> None:
        """Guard a topic with the type that the robot has given it, in place of the type of clients."""
        if self._topics.get(topic.name) is not topic:
            return
        must_stop = topic.is_held or topic.state is TopicState.STOPPING
        topic.end_lease("the robot uses the topic with another type")
        topic.close()
        del self._topics[topic.name]
        info = self._graph.topic(topic.name)
        if info is not None and info.type is not None:
            present = self.guarded(topic.name, info.type)
            if must_stop:
                present.halt()

    def join_topic(self, actor: Actor, name: str, type: MessageType) -> GuardedTopic:
        """Like :meth:`guarded`, for a client that publishes on the topic from now on."""
        topic = self.guarded(name, type)
        topic.users.add(actor)
        actor.topics.add(topic)
        return topic

    def require_type(self, actor: Actor, name: str, type: MessageType) -> None:
        """Check that a client does not give a guarded topic its type, unless its role is unrestricted.

        Otherwise a client could give a topic another type before the robot has started: then the robot could
        not use its own topic, and the stop message would not fit.

        Raises:
            GateRefused: the type is not that of the rules, or not known yet.
        """
        rules = self.rules.of("publish", name)
        if not rules:
            return
        for rule in rules:
            if rule.type is not None and rule.type.name != type.name:
                expected = self._graph.registry.type_name(rule.type)
                raise GateRefused(f"{name} is of type {expected}", f"{rule.key}.type")
        if any(rule.type is not None for rule in rules):
            return
        info, known = self._graph.topic(name), self._topics.get(name)
        if (info is not None and info.type is not None) or (known is not None and known.type is type):
            return
        if actor.rights.unrestricted:
            topic = self.guarded(name, type)
            if topic.fault:
                del self._topics[name]
                topic.close()
                raise GateRefused(f"the rules of {name} do not fit {type.name}: {topic.fault}")
            return
        needing = next((rule for rule in rules if rule.settings.stop or rule.settings.fields), None)
        if needing is not None:
            raise GateRefused(
                f"no program of the robot uses {name} yet, so that its type is not known:"
                f" start it first, or set the type in the rule",
                f"{needing.key}.type",
            )

    def _drop_abandoned(self) -> None:
        """Close topics that only the gate uses; examines two, so that the work does not grow with topics."""
        for _ in range(min(2, len(self._sweep))):
            topic = self._sweep.popleft()
            if topic.state is TopicState.CLOSED:
                continue
            if self._is_abandoned(topic):
                topic.close()
                del self._topics[topic.name]
            else:
                self._sweep.append(topic)

    def _is_abandoned(self, topic: GuardedTopic) -> bool:
        """Return True if only the gate itself uses a topic, whose type no rule states."""
        if not topic.is_idle or any(rule.type is not None for rule in self.rules.of("publish", topic.name)):
            return False
        info = self._graph.topic(topic.name)
        others = () if info is None else (*info.publishers, *info.subscribers)
        return all(each.node == GATE_NODE for each in others)

    def latch_rule(self, name: str) -> Rule | None:
        """Return the rule that forbids latched publishers of a topic; None if it may be latched.

        Late subscribers would receive the last command even after a stop.
        """
        return next((rule for rule in self.rules.of("publish", name) if rule.settings.stop is not None), None)

    # Requests and goals

    def check(
        self,
        actor: Actor,
        acts: Iterable[tuple[GatedAct, str]],
        type: MessageType,
        payload: Payload,
        text: str = "",
    ) -> tuple[Payload, list[tuple[GatedAct, str, Rule]]]:
        """Check a client's request or goal.

        Args:
            acts: acts and names that it is for; the first is checked for its fields.
            text: value of a parameter as JSON text, if the request has one.

        Returns:
            The payload as it may be sent, and the acts that require approval.

        Raises:
            GateRefused: a rule rejects it; the text names the rule.
        """
        asked: dict[tuple[GatedAct, Rule], list[str]] = {}
        finite: set[Rule] = set()  # Rules that have checked all numbers: one call may set many parameters.
        for number, (act, name) in enumerate(acts):
            self.rules.require(act, name)
            for rule in self.rules.of(act, name):
                if not rule.holds_for(actor.role):
                    continue
                self.require_released(rule)
                if act == "goal" and rule.settings.emergency:
                    self.note_goal(name)
                if number == 0:
                    payload = self._checked(actor, act, name, rule, type, payload)
                elif act == "set_param" and rule not in finite:
                    finite.add(rule)
                    self.require_finite(rule, payload, text)
                if rule.settings.approval is not None:
                    payload = without_repeats(payload)
                    asked.setdefault((act, rule), []).append(name)
        # One approval of a rule is for all parameters of a call.
        needed = [
            (act, ", ".join(names), rule)
            for (act, rule), names in asked.items()
            if not self.approvals.take(self.approvals.subject(actor, act, ", ".join(names), rule, payload))
        ]
        if not self.is_observing:
            return payload, needed
        for act, name, rule in needed:
            key = f"{rule.key}.approval"
            self.recorder.note("would refuse", act, name, actor, f"needs a person's yes ({key})", key)
        return payload, []

    def refuse(self, actor: Actor, act: GatedAct, name: str, refused: GateRefused) -> None:
        """Record a rejection, and raise it unless the gate only observes."""
        decision: Decision = "would refuse" if self.is_observing else "refused"
        self.recorder.note(decision, act, name, actor, str(refused), refused.rule)
        if not self.is_observing:
            raise refused

    def require_same_type(self, info: ServiceInfo) -> None:
        """Raise GateRefused if a service has another type than when it was called."""
        now = self._graph.service(info.name)
        if now is not None and now.type is not info.type:
            raise GateRefused(f"{info.name} is of another type now: call it again")

    def require_released(self, rule: Rule) -> None:
        """Raise GateRefused while the emergency stop is pressed, if a rule is for it."""
        if self.stopped_by and rule.settings.emergency:
            raise GateRefused(
                f"the emergency stop is on: stopped by {self.stopped_by}", f"{rule.key}.emergency"
            )

    def require_approval(
        self, topic: str, rule: Rule, client: Actor, payload: Payload, *, is_stop: bool = False
    ) -> None:
        """Use up the approval for a message, or request one.

        Args:
            topic: absolute name of the topic.
            payload: message as it will reach the robot.
            is_stop: True for the stop message, which needs none while another message is approved.

        Raises:
            GateRefused: the message is not approved yet.
        """
        approvals = self.approvals
        subject = approvals.subject(client, "publish", topic, rule, payload)
        if approvals.take(subject) or (is_stop and approvals.has_lasting(subject)):
            return
        text = f"publishing on {topic} needs a person's yes"
        if not self.is_observing:
            request = approvals.find(subject)
            if request is not None and request.subject != subject:
                text += f", and another message waits for it under id {request.id}"
            else:
                request = request or approvals.ask(subject, rule, payload)
                text += f", which was asked for under id {request.id}: send it again when it is there"
        raise GateRefused(text, f"{rule.key}.approval")

    def note_clamped(
        self, client: Actor, act: GatedAct, name: str, changes: Sequence[Change], key: str
    ) -> None:
        """Record what was clamped, and tell the client."""
        clamped = Clamped(changes)
        text = str(clamped)
        self.recorder.note(
            "changed", act, name, client, text, key, before=clamped.before, after=clamped.after
        )
        if client.on_notice is not None and not self.is_observing:
            client.on_notice(f"{act} {name}: {text} ({key})")

    def _describe(self, act: GatedAct, name: str, payload: Payload) -> str:
        """Return the fields of a message that rules for its name limit, with their values."""
        paths = {
            path: limit for rule in self.rules.of(act, name) for path, limit in rule.settings.fields.items()
        }
        return describe_fields(payload, paths)

    def _checked(
        self, actor: Actor, act: GatedAct, name: str, rule: Rule, type: MessageType, payload: Payload
    ) -> Payload:
        try:
            checks = self._checks_of(rule, type)
        except NoSuchField as wrong:
            raise GateRefused(f"the rules of {name} cannot be applied: {wrong}") from None
        taken, changes = checks.check(payload, self.clock.monotonic())
        if changes:
            self.note_clamped(actor, act, name, changes, rule.key)
        return payload if self.is_observing else taken

    def affected_parameters(self, written: Iterable[str], text: str) -> list[str]:
        """Return the parameters that a call changes, those above and below them included.

        Raises:
            GateRefused: there are too many to be checked at once.
        """
        if not self.rules.has_parameters:
            return list(written)
        found: dict[str, None] = {}
        for name in written:
            names = affected_parameters(self._graph.parameters, name, text, _MAX_PARAMETERS)
            if names is None:
                raise GateRefused(
                    f"{name[:_MAX_NAME]} has more than {_MAX_PARAMETERS} parameters below it,"
                    " or a name that is too long: set each by itself"
                )
            found.update(dict.fromkeys(names))
        return list(found)

    def read_parameters(self, names: list[str], on_values: Callable[[Mapping[str, object]], None]) -> None:
        """Read parameters of the tree, or of one node, before they are set.

        Args:
            names: full names.
            on_values: called once with the values by full name, without those that are not set: at once,
                unless the node is in another process.
        """
        node, is_of_node, _ = names[0].partition(":")
        values: dict[str, object] = {}
        info = self._graph.service(f"{node}/get_parameters") if is_of_node else None
        if info is None:
            for name in names:
                with suppress(NotFound):
                    self._graph.parameters.read(name, partial(values.__setitem__, name))
            on_values({name: bounded(value) for name, value in values.items()})
            return

        def on_reply(outcome: Payload | CallFailed) -> None:
            if isinstance(outcome, Payload):
                read: Any = outcome.value()
                with suppress(ParameterRejected):  # A client may offer this service, too.
                    values.update(
                        (name, decode(each)) for name, each in zip(names, read.values, strict=False)
                    )
            on_values(values)

        request = Payload.from_value(info.type.request, {"names": [name.partition(":")[2] for name in names]})
        self.participant.call_service(info.name, request, on_reply, _READ_SECONDS)

    def require_finite(self, rule: Rule, payload: Payload, text: str = "") -> None:
        """Check that all numbers of a message are finite, whose fields the rule's limits are not for.

        Args:
            payload: message with the values of parameters, or with a goal in it.
            text: value of a parameter as JSON text.

        Raises:
            GateRefused: one is not, or the message is too large to be checked.
        """
        if not rule.settings.finite:
            return
        self._checks_of(rule, payload.type, has_limits=False).check(payload, 0.0)
        most_bytes = BYTES_OF_ITEM * rule.settings.largest_items
        if len(text) > most_bytes:
            raise GateRefused(
                f"a value of {len(text)} characters: {most_bytes} is the limit where numbers are checked",
                f"{rule.key}.largest_items",
            )
        if text and not has_finite_numbers(text):
            raise GateRefused("value: expected finite numbers", f"{rule.key}.finite")

    def _checks_of(self, rule: Rule, type: MessageType, *, has_limits: bool = True) -> FieldChecks:
        """Return the compiled limits of a rule for requests or goals.

        Args:
            has_limits: False for a check of size and numbers alone.

        Raises:
            NoSuchField: the limits do not fit the type.
        """
        checks = self._checks.get((rule, type, has_limits))
        if checks is None:
            if len(self._checks) >= _MAX_TYPES:
                self._checks.clear()
            try:
                checks = FieldChecks(rule, type, limits=None if has_limits else {})
            except NoSuchField as wrong:
                checks = str(wrong)
                logger.error("the gate rejects every command: %s", wrong)
            self._checks[rule, type, has_limits] = checks
        if isinstance(checks, str):
            raise NoSuchField(checks)
        return checks

    # Leases

    def leased(self, actor: Actor, name: str) -> tuple[GuardedTopic, Lease]:
        """Return the topic whose lease a client asks about, and that lease.

        Raises:
            GateRefused: the topic has no lease, or the client may not publish on it.
        """
        absolute = canonical(name)
        if not actor.rights.allows("publish", absolute):
            raise GateRefused(
                f"role {actor.role!r} may not publish on {absolute}", f"roles.{actor.role}.publish"
            )
        rules = self.rules.of("publish", absolute)
        if not any(rule.settings.lease for rule in rules if rule.holds_for(actor.role)):
            raise GateRefused(f"no rule of the gate asks for a lease of {absolute}")
        topic = self._topics.get(absolute)
        info = self._graph.topic(absolute)
        if topic is None and info is not None and info.type is not None:
            topic = self.guarded(absolute, info.type)
        if topic is None or topic.lease is None:
            raise GateRefused(f"{absolute} is not advertised, so its type is not known yet")
        if topic.fault:
            raise GateRefused(f"the rules of {absolute} cannot be applied: {topic.fault}")
        return topic, topic.lease

    def lease_seconds(self, role: Role, name: str) -> float | None:
        """Return the seconds of silence after which a client loses the lease of a topic.

        None if no rule requires a lease for the role, and if the gate only observes.
        """
        if self.is_observing:
            return None
        rules = self.rules.of("publish", canonical(name))
        leases = (rule.settings.lease for rule in rules if rule.holds_for(role.name))
        return min((lease.seconds for lease in leases if lease is not None), default=None)

    def take_lease(self, actor: Actor, name: str) -> None:
        """Give a client a lease on request.

        Raises:
            GateRefused: another client holds it, or as for :meth:`leased`.
        """
        topic, lease = self.leased(actor, name)
        for rule in self.rules.of("publish", topic.name):
            self.require_released(rule)
        before = lease.holder
        lease.take(actor)
        if before is not None and before is not actor:
            topic.halt()  # Else the last command of the former holder would stay in effect.

    def release_lease(self, actor: Actor, name: str) -> None:
        """Free a lease, and stop the robot.

        Raises:
            GateRefused: the client does not hold it, or as for :meth:`leased`.
        """
        self._held_by(actor, name).release(actor, "given back")

    def pass_lease(self, actor: Actor, name: str, to: str) -> None:
        """Give a lease to another client, and stop the robot until that client publishes.

        Raises:
            GateRefused: the client does not hold it, the other one is unknown or may not publish on the
                topic, or as for :meth:`leased`.
        """
        lease = self._held_by(actor, name)
        other = self.actors.get(to)
        if other is None:
            raise GateRefused(
                f"there is no client {to[:80]!r}; each hears its own name from /gate/take_lease"
            )
        self.leased(other, name)
        if self.leases_held[other.owner] >= MAX_LEASES // 2:  # Else a client could fill another's room.
            raise GateRefused(
                f"clients of its credential hold {MAX_LEASES // 2} leases: no more are passed on"
            )
        lease.renew(other, "passed on")

    def require_lease_room(self, client: Actor) -> None:
        """Check that a client may hold one more lease: all leases may end at the same time.

        Raises:
            GateRefused: clients of its credential hold the maximum.
        """
        if self.leases_held[client.owner] >= MAX_LEASES:
            raise GateRefused(f"clients of this credential hold {MAX_LEASES} leases, which is the limit")

    def _look(self, was_suspended: bool) -> bool:
        if was_suspended:
            for lease in tuple(self.held):
                lease.check_silence()
        return bool(self.held)

    def _held_by(self, actor: Actor, name: str) -> Lease:
        """Return the lease that a client holds. Raises GateRefused if it does not hold it."""
        topic, lease = self.leased(actor, name)
        if lease.holder is not actor:
            holder = lease.holder or "no client"
            raise GateRefused(f"{topic.name} is held by {holder}, and not by this client")
        return lease

    # The emergency stop

    def stop(self, actor: Actor | None, reason: str = "") -> str:
        """Press the emergency stop: publish the stop messages, cancel goals, reject commands until release.

        No-op while it is pressed.

        Args:
            actor: client that presses it; None: a program of the robot itself.
            reason: reason, in the client's words.

        Returns:
            The topics that could not be stopped, with the reasons; empty if there are none.

        Raises:
            GateRefused: the role may not press it, or no rule is for the emergency stop; or the gate only
                observes: then the stop messages are published nevertheless.
        """
        if actor is not None and not self.may_stop(actor.role):
            raise GateRefused(f"role {actor.role!r} may not stop the robot", "gate.emergency.stop_roles")
        if not self.rules.has_emergency:
            raise GateRefused("no rule says what there is to stop: set gate.rules.NAME.emergency")
        if not self.stopped_by:
            self._latch(str(actor or "the robot"), reason, actor)
        if self.is_observing:
            raise GateRefused(
                "what moves was told to stop, but the gate only observes and refuses nothing", "gate.mode"
            )
        return "; ".join(f"{name}: {fault}" for name, fault in list(self.faults.items())[:_MAX_FAULTS])

    def may_stop(self, role: str) -> bool:
        """Return True if clients of a role may press the emergency stop."""
        may_stop = self._stop_roles.get(role)
        if may_stop is None:
            pattern = glob_pattern(self.settings.emergency.stop_roles)
            may_stop = self._stop_roles[role] = pattern.fullmatch(role) is not None
        return may_stop

    def is_stop_due(self, role: str) -> bool:
        """Return True if clients of a role can stop the robot now, ahead of all other messages.

        In mode ``observe`` nothing is stopped for longer than a message, so a press is one like any other.
        """
        return not (self.stopped_by or self.is_observing) and self.rules.has_emergency and self.may_stop(role)

    def _latch(self, by: str, reason: str, actor: Actor | None = None) -> None:
        # From here on every command is rejected, each when it is checked.
        self.stopped_by = self.last_by = by
        self.presses += 1
        self.stopped_reason = one_line(reason)
        self.stopped_ns = self.clock.time_ns()
        self.stop_path.press()
        text = f"stopped by {by}{_because(self.stopped_reason)}"
        self.recorder.note("stop", "stop", "", actor, text, before="released", after="stopped")
        self.stop_path.in_turns(self._rest(self.presses))
        if self.is_observing:
            self.stopped_by = ""  # Nothing is rejected.
        self.on_stop()

    def _rest(self, press: int) -> Iterator[None]:
        """Stop, a step each, what no client drove before a press; end the leases, and cancel all goals."""
        emergencies = {rule.key for rule in self.rules.all if rule.settings.emergency}
        yield from self.approvals.drop(
            lambda each: each.rule in emergencies, f"the emergency stop is on: stopped by {self.last_by}"
        )
        for topic in tuple(self._topics.values()):
            self._stop_topic(topic, press)
            yield
        actions: dict[str, Cancel] = {}
        for name in self._graph.topic_names():
            if self._stops("publish", name):
                self.stop_path.run(name, partial(self._stop_topic_named, name, press))
            # A ROS 1 action that the graph knows by its topics only.
            action, _, part = name.rpartition("/")
            if part == "cancel" and self._stops("goal", action):
                actions[action] = self._cancel_of(action)
            yield
        for name in self._graph.action_names():
            if self._stops("goal", name):
                actions[name] = self._cancel_of(name)
            yield
        yield from self.stop_path.cancel_goals(actions)

    def _stop_topic(self, topic: GuardedTopic, press: int) -> None:
        """Stop a topic, unless it was stopped already, or driven after a release meanwhile."""
        if not topic.is_emergency or topic.state is TopicState.CLOSED or topic.driven_in >= press:
            return
        if topic.stopped_in < press:
            self.stop_path.run(topic.name, topic.emergency_stop)
        self.stop_path.run(topic.name, topic.end_lease)

    def _stop_topic_named(self, name: str, press: int) -> None:
        info = self._graph.topic(name)
        if name not in self._topics and info is not None and info.type is not None:
            self._stop_topic(self.guarded(name, info.type), press)

    def release(self, actor: Actor | None, reason: str = "") -> None:
        """Release the emergency stop. All leases that it is for are free then.

        Raises:
            GateRefused: the role may not release it.
        """
        roles = self.settings.emergency.release_roles
        if actor is not None and glob_pattern(roles).fullmatch(actor.role) is None:
            raise GateRefused(
                f"role {actor.role!r} may not release the robot", "gate.emergency.release_roles"
            )
        if not self.stopped_by:
            return
        self.stopped_by = ""
        self.last_by = str(actor or "the robot")
        self.stopped_reason = one_line(reason)
        self.stopped_ns = self.clock.time_ns()
        text = f"released by {self.last_by}{_because(self.stopped_reason)}"
        self.recorder.note("stop", "release", "", actor, text, before="stopped", after="released")
        self.on_stop()

    def note_goal(self, action: str) -> None:
        """Note an action to which a client sends goals: the emergency stop cancels them first."""
        self.stop_path.note_goal(action, partial(self._cancel_of, action))

    def _cancel_of(self, action: str) -> Cancel:
        """Return a function that cancels all goals of an action, of any client, in steps."""
        info = self._graph.topic(f"{action}/cancel")
        if self._graph.action(action) is not None or info is None or info.type is None:
            return partial(self.participant.cancel_every_goal, action)
        if info.type.name != "actionlib_msgs/GoalID":
            return lambda: iter(())
        # Advertised before it is needed: over a network, discovery takes a while.
        publisher = self._cancels.get(info.name)
        if publisher is None:
            if len(self._cancels) >= _MAX_CANCELS:
                self._cancels.pop(next(iter(self._cancels))).close()
            publisher = self._cancels[info.name] = self.participant.advertise(info.name, info.type)
        every = Payload.from_value(info.type, {})
        return lambda: iter((publisher.publish(every),))

    def _not_stopped(self, name: str, error: Exception) -> None:
        text = f"{type(error).__name__}: {error}"
        if self.faults.get(name) != text:  # Recorded once: the stop message is repeated.
            self.faults[name] = text
            self.recorder.note("stop", "stop", name, None, f"not stopped: {text}")

    def _stops(self, act: GatedAct, name: str) -> bool:
        return any(rule.settings.emergency for rule in self.rules.of(act, name))

    # Closing

    def close(self) -> None:
        """Leave the graph, and flush the audit file."""
        self.stop_path.close()
        self.wake_watch.close()
        for topic in self._topics.values():
            topic.close()
        self._topics.clear()
        self.participant.close()
        self.recorder.close()


def _nothing() -> None:
    """No-op, until the gate's node sets its own."""


def _stops_the_same(before: GateRule, now: GateRule) -> bool:
    """Return True if an emergency stop that a rule is for would not change with another version of it."""
    names = ("topics", "services", "actions", "parameters")
    return (
        now.emergency
        and (now.roles, now.stop, now.type) == (before.roles, before.stop, before.type)
        and all(set(getattr(before, each)) <= set(getattr(now, each)) for each in names)
    )


def _require_fit(topic: GuardedTopic) -> None:
    if topic.fault:
        raise SettingsError(topic.fault)


def _is_name(glob: str) -> bool:
    """Return True if a glob matches one name only."""
    return re.search(r"[*?\[]", glob) is None


def _because(reason: str) -> str:
    """Return the end of a text with its reason; empty without one."""
    return f": {reason}" if reason else ""
