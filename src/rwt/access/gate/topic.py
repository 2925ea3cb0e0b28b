"""Topic with gate rules: its checks, its lease and its stop message."""

from __future__ import annotations

import logging
from math import inf
from typing import TYPE_CHECKING, Final, NamedTuple

from rwt.access.errors import GateRefused
from rwt.access.gate.fields import Change, FieldChecks, Motion, NoSuchField, has_lists, without_repeats
from rwt.access.gate.freshness import Freshness
from rwt.access.gate.lease import Lease
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.payload import Payload
from rwt_protocol.states import StateEnum
from rwt_transports.limits import RateLimit

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import msgspec

    from rwt.access.gate.gate import Gate
    from rwt.access.gate.record import Actor
    from rwt.access.gate.rules import Rule
    from rwt_graph.api import Publisher
    from rwt_interfaces.structs import MessageType

logger: Final = logging.getLogger("rwt.bridge")

#: Tolerance in seconds, since sums of floats round.
_ROUNDING: Final = 1e-6

#: Seconds of silence required of a client that kept publishing while the robot was stopped.
_PAUSE_SECONDS: Final = 1.0

#: Number of paused identities above which old ones are dropped.
MAX_PAUSED: Final = 1000

#: Types whose zeros stop a robot, if the rules state no stop message.
_STOPPED_BY_ZEROS: Final = frozenset({"geometry_msgs/Twist", "geometry_msgs/TwistStamped"})

#: Maximum size of a message that is decoded before its limits are checked, in bytes.
_MAX_DECODED_BYTES: Final = 64 * 1024

LOST_BY_RELOAD: Final = "lost by a reload of the settings"


class _CompiledRule(NamedTuple):
    """Rule compiled for the topic's type."""

    rule: Rule
    checks: FieldChecks | None
    rate: RateLimit | None


class _RoleRules(NamedTuple):
    """Rules of a topic that apply to one role.

    Attributes:
        compiled: all of them, in the order of the settings.
        lease: the topic's lease, if a rule requires it.
        emergency: first rule that the emergency stop is for.
        approvals: rules that require approval.
    """

    compiled: tuple[_CompiledRule, ...]
    lease: Lease | None
    emergency: Rule | None
    approvals: tuple[Rule, ...]
    rates: tuple[tuple[Rule, RateLimit], ...]


class TopicState(StateEnum):
    """State of a topic with gate rules; see :class:`GuardedTopic`."""

    OPEN = "STOPPING", "CLOSED"
    STOPPING = "STOPPING", "OPEN", "CLOSED"
    CLOSED = "CLOSED"


class GuardedTopic:
    """Topic with gate rules.

    Life cycle::

        OPEN ─────── halt() ───────> STOPPING ── close() ──> CLOSED
         │^─── repeated or passed ──────┘                      ^
         └────────────────────── close() ──────────────────────┘

    * **OPEN**: messages of clients pass if the rules allow them.
    * **STOPPING**: the gate's stop path repeats the stop message every 0.1 s, until `repeat_seconds` have
      passed and the emergency stop is released (*repeated*), or a message of a client passes (*passed*).
    * **CLOSED**: the gate has another object for the topic, or none.

    A client has states as well, on a topic that the emergency stop is for::

        moving ──a message while stopped──> paused ──stop released, then 1 s of silence or the stop message──┐
          ^──────────────────────────────────────────────────────────────────────────────────────────────────┘

    A message of a paused client is rejected after the release, too: it was meant for before the stop.

    A rule that does not fit the topic's type, such as one for an unknown field, is a fault: every message is
    rejected, and no stop message is published.

    Private attributes:

    * Stalled connections: ``_freshness`` (of the commands; None without a lease), ``_has_lists`` (False: a
      message of any size is decoded before its limits are checked).
    * Rules: ``_rules``, ``_compiled``, ``_by_role`` (compiled for each role on first use).
    * Clients: ``_lease_owner`` (identity that the lease counts for), ``_paused_at`` (identities of paused
      clients, with the time of the last rejected message: another connection or advertisement of the same
      credential is paused, too).
    * Rates: ``_motion`` (values last passed on), ``_has_rates`` (True if a rule limits them).
    * Stop message: ``_stop`` (its rule), ``_neutral`` (its value; ``_zeros`` without it), ``_publisher``,
      ``_repeat_for`` (seconds), ``_repeat_until`` (steady clock), ``_prepared`` (payload made in advance),
      ``_is_stamped`` (True if it has a header).

    Attributes:
        name: absolute name.
        state: state of the topic.
        lease: lease of the topic; None if no rule requires one.
        fault: description of what is wrong with the rules; empty if they fit.
        users: clients that publish on the topic.
        is_emergency: True if the emergency stop is for the topic.
        driven_in: number of the last press of the emergency stop before a client's message passed.
        stopped_in: number of the press that stopped the topic last.
    """

    def __init__(self, gate: Gate, name: str, type: MessageType, rules: Iterable[Rule]) -> None:
        self.name = name
        self.type = type
        self.fault = ""
        self.users: set[Actor] = set()
        self.state = TopicState.OPEN
        self._gate = gate
        self._rules = tuple(rules)
        self._compiled: tuple[_CompiledRule, ...] = ()
        self._by_role: dict[str, _RoleRules] = {}
        self._lease_owner = ""
        self._paused_at: dict[str, float] = {}
        self._motion = Motion()
        self._has_rates = any(
            limit.rate is not None for rule in self._rules for limit in rule.settings.fields.values()
        )
        stops = [(rule, rule.settings.stop) for rule in self._rules if rule.settings.stop is not None]
        self._stop = stops[0][0] if stops else None
        self._neutral: msgspec.Struct | None = None
        self._publisher: Publisher | None = None
        self._repeat_for = max((stop.repeat_seconds for _, stop in stops), default=0.0)
        self._repeat_until = 0.0
        self._prepared: Payload | None = None
        self._zeros = Payload.from_value(type, {}).value() if type.name in _STOPPED_BY_ZEROS else None
        self._is_stamped = False
        self._has_lists = has_lists(type)
        self.is_emergency = any(rule.settings.emergency for rule in self._rules)
        self.driven_in = self.stopped_in = -1
        try:
            self._prepare_stop()
            self._compiled = tuple(self._compile(rule) for rule in self._rules)
        except NoSuchField as wrong:
            self.fault = f"{wrong} ({self.type.name}, {name})"
        self.lease = self._make_lease()
        self._freshness = self._make_freshness()
        if self.fault:
            if self.is_emergency:
                gate.faults[name] = self.fault
            logger.error("the gate rejects every message on %s: %s", name, self.fault)
        elif self._stop is not None:
            # Before it is needed: over a network, discovery by the subscribers takes a while.
            self._publisher = gate.participant.advertise(name, type)
            if all(rule.type is None for rule in self._rules):
                # A client may have given the topic its type: the robot must be able to give it another.
                self._publisher.on_displaced = lambda _: gate.guard_anew(self)

    def _compile(self, rule: Rule) -> _CompiledRule:
        checks = FieldChecks(rule, self.type, self._motion, self._neutral)
        limit = rule.settings.messages_per_second
        rate = RateLimit(limit, 1 + limit // 10) if limit else None
        return _CompiledRule(rule, None if checks.is_empty else checks, rate)

    def _make_lease(self) -> Lease | None:
        """Return the lease of the rule with the shortest one."""
        found = [(rule.settings.lease, rule) for rule in self._rules if rule.settings.lease is not None]
        if not found:
            return None
        settings, rule = min(found, key=lambda each: each[0].seconds)
        return Lease(
            self.name,
            f"{rule.key}.lease",
            settings,
            self._gate.clock,
            self._lease_changed,
            self._gate.require_lease_room,
        )

    def _make_freshness(self) -> Freshness | None:
        if self.lease is None:
            return None
        leases = ((rule.key, rule.settings.lease) for rule in self._rules)
        ages = {lease.max_age: key for key, lease in leases if lease is not None and lease.max_age}
        if ages and "header" not in self.type.struct.__struct_fields__:
            key = next(iter(ages.values()))
            self.fault = f"`{key}.lease.max_age`: {self.type.name} has no header with a stamp ({self.name})"
        return Freshness(self.lease.settings.seconds, min(ages, default=inf))

    def _prepare_stop(self) -> None:
        """Make the stop message in advance, or raise NoSuchField if it does not fit the type."""
        if self._stop is None:
            return
        try:
            one, other = self._make_stop(lambda: 0), self._make_stop(lambda: 1)
        except InterfaceError as error:
            raise NoSuchField(f"`{self._stop.key}.stop.message`: {error}") from None
        self._is_stamped = one.value() != other.value()
        self._neutral = one.value()
        self._prepared = one

    def _make_stop(self, now: Callable[[], int]) -> Payload:
        assert self._stop is not None and self._stop.settings.stop is not None  # Only called with one.
        # A copy: from_value() completes the header in place.
        return Payload.from_value(self.type, dict(self._stop.settings.stop.message), now)

    @property
    def is_idle(self) -> bool:
        """True if closing the topic loses no state."""
        if self._paused_at and not self.is_stopped:
            self._drop_old_pauses(self._gate.clock.monotonic())
        is_stopping = self.state is TopicState.STOPPING or self.is_stopped
        return not (self.users or self.is_held or is_stopping or self._paused_at)

    @property
    def is_held(self) -> bool:
        """True if a client holds the lease."""
        return self.lease is not None and self.lease.holder is not None

    @property
    def is_stopped(self) -> bool:
        """True while the emergency stop is pressed, if it is for this topic."""
        return self.is_emergency and bool(self._gate.stopped_by)

    @property
    def lease_rule(self) -> str:
        """Key of the rule that requires the lease; empty if none does."""
        return next((rule.key for rule in self._rules if rule.settings.lease is not None), "")

    # Messages

    def publish(self, client: Actor, payload: Payload, forward: Callable[[Payload], None]) -> None:
        """Check a client's message, and forward it if it passes every rule.

        Raises:
            GateRefused: a rule rejects the message; the text names the rule.
        """
        role = client.rights.name
        rules = self._by_role.get(role)
        if rules is None:
            rules = self._by_role[role] = self._rules_of(role)
        if not rules.compiled and not self.fault:
            forward(payload)
            return
        gate = self._gate
        now = gate.clock.monotonic()
        try:
            passed = self._check(client, rules, payload, now)
        except GateRefused as refused:
            self._motion.refused()
            gate.refuse(client, "publish", self.name, refused)
            forward(payload)
            return
        if self._has_rates:
            self._motion.passed(now)
        if rules.lease is not None:
            rules.lease.renew(client)
        if self.state is TopicState.STOPPING:
            self.state = self.state.become(TopicState.OPEN)
            gate.stop_path.end_repeats(self)
        if self.driven_in != gate.presses:
            self.driven_in = gate.presses
            if self.is_emergency:
                gate.stop_path.note_topic(self)
        forward(payload if gate.is_observing else passed)

    def _rules_of(self, role: str) -> _RoleRules:
        compiled = tuple(each for each in self._compiled if each.rule.holds_for(role))
        rules = [each.rule for each in compiled]
        return _RoleRules(
            compiled,
            self.lease if any(rule.settings.lease for rule in rules) else None,
            next((rule for rule in rules if rule.settings.emergency), None),
            tuple(rule for rule in rules if rule.settings.approval is not None),
            tuple((rule, rate) for rule, _, rate in compiled if rate is not None),
        )

    def _check(self, client: Actor, rules: _RoleRules, payload: Payload, now: float) -> Payload:
        if self.fault:
            raise GateRefused(f"the rules of {self.name} cannot be applied: {self.fault}")
        if rules.emergency is not None and (self._paused_at or self._gate.stopped_by):
            self._require_moving(client, rules.emergency, payload, now)
        if rules.lease is not None:
            rules.lease.require(client)
            self._require_fresh(client, rules.lease, payload, now)
        changed: list[Change] = []
        for _, checks, _ in rules.compiled:
            if checks is not None:
                payload, changes = checks.check(payload, now)
                changed += changes
        # After the fields, so that rejected messages do not use up the rate of other clients.
        for rule, rate in rules.rates:
            if not rate.take(now):
                raise GateRefused(
                    f"more than {rule.settings.messages_per_second} messages a second on {self.name}",
                    f"{rule.key}.messages_per_second",
                )
        # Last, so that only what passes every other rule is approved, or uses up an approval.
        if rules.approvals:
            payload = self._approved(client, rules, payload)
        if changed:
            first = rules.compiled[0].rule.key
            self._gate.note_clamped(client, "publish", self.name, changed, first)
        return payload

    def _approved(self, client: Actor, rules: _RoleRules, payload: Payload) -> Payload:
        """Use up the approvals of a message and return it as approved, or raise GateRefused."""
        payload = without_repeats(payload)
        try:
            for rule in rules.approvals:
                self._gate.require_approval(self.name, rule, client, payload, is_stop=self._is_stop(payload))
        except GateRefused:
            for _, rate in rules.rates:
                rate.give_back()
            raise
        return payload

    def _require_fresh(self, client: Actor, lease: Lease, payload: Payload, now: float) -> None:
        """Raise GateRefused for a command that waited in a stalled connection; the robot stops then."""
        if self._freshness is None or self._neutral is None:
            return
        command = payload.value() if not self._has_lists or _is_small(payload) else None
        is_stop = command is not None and _is_equal(command, self._neutral) and self._is_stop(payload)
        why = self._freshness.check(client, command, now, self._gate.clock, is_stop=is_stop)
        if why:
            if not self._gate.is_observing:
                lease.release(client, "lost by a stalled connection")
            raise GateRefused(why, f"{self.lease_rule}.lease")

    def _require_moving(self, client: Actor, rule: Rule, payload: Payload, now: float) -> None:
        """Raise GateRefused while the emergency stop is pressed, and until a paused client may go on."""
        if self._gate.stopped_by:
            self._pause(client, now)
            self._gate.require_released(rule)
        refused_at = self._paused_at.get(client.owner)
        if refused_at is None:
            return
        if now - refused_at < _PAUSE_SECONDS and not self._is_stop(payload):
            self._pause(client, now)
            raise GateRefused(
                "the emergency stop was released while this client went on publishing:"
                f" be silent for {_PAUSE_SECONDS:g} s, or send the stop message first",
                f"{rule.key}.emergency",
            )
        del self._paused_at[client.owner]

    def _pause(self, client: Actor, now: float) -> None:
        if len(self._paused_at) >= MAX_PAUSED:
            self._drop_old_pauses(now)
        self._paused_at[client.owner] = now

    def _drop_old_pauses(self, now: float) -> None:
        self._paused_at = {key: at for key, at in self._paused_at.items() if now - at < _PAUSE_SECONDS}

    def _is_stop(self, payload: Payload) -> bool:
        """Return True for the stop message; a large message is not decoded to find out."""
        neutral = self._neutral or self._zeros
        if neutral is None:
            return False
        is_equal = _is_small(payload) and _is_equal(payload.value(), neutral)
        return is_equal and without_repeats(payload) is payload

    # Stopping

    def _lease_changed(self, change: str, holder: Actor | None, before: Actor | None) -> None:
        """Stop the robot if its driver lost the lease; then count, record and announce the new holder.

        Called by the lease after its holder has changed from `before` to `holder`.
        """
        gate = self._gate
        # A client that takes the lease by publishing commands the robot itself. An emergency stop has
        # published the stop message already.
        has_stopped = self.is_stopped and self.stopped_in == gate.presses
        if before is not None and change != "taken" and not gate.is_observing and not has_stopped:
            self.halt()
        self._count_lease(holder)
        gate.recorder.note(
            "lease", "publish", self.name, holder or before, change, self.lease_rule,
            before="" if before is None else before.name, after="" if holder is None else holder.name,
        )  # fmt: skip
        gate.on_leases()

    def _count_lease(self, holder: Actor | None) -> None:
        """Count the lease for the identity of its new holder, and no longer for the one before."""
        gate = self._gate
        assert self.lease is not None  # Called after its holder has changed.
        gate.held.pop(self.lease, None)
        if self._lease_owner:
            gate.leases_held[self._lease_owner] -= 1
        self._lease_owner = "" if holder is None else holder.owner
        if holder is not None:
            holder.topics.add(self)
            gate.leases_held[self._lease_owner] += 1
            gate.held[self.lease] = self.name
            if gate.clock.is_real:
                gate.wake_watch.begin()

    def emergency_stop(self) -> None:
        """Publish the stop message, and repeat it; :meth:`end_lease` follows when the stop is recorded."""
        self.stopped_in = self._gate.presses
        self.halt()

    def end_lease(self, why: str = "lost by the emergency stop") -> None:
        """Release the lease, after an emergency stop unless the gate says otherwise."""
        if self.lease is not None and not self._gate.is_observing:
            self.lease.release(None, why)

    def halt(self) -> None:
        """Publish the stop message now, and repeat it until the robot's own timeout has expired."""
        if self._publisher is None or self.fault:
            return
        self._motion.reset()
        self._repeat_until = self._gate.clock.monotonic() + self._repeat_for + _ROUNDING
        # First, so that a failure is repaired by the next repetition.
        self.state = self.state.become(TopicState.STOPPING)
        self._gate.stop_path.repeat(self)
        self.publish_stop()

    def must_repeat(self) -> bool:
        """Return True if the stop message has to be published once more; otherwise the repetition is over."""
        must = self.is_stopped or self._gate.clock.monotonic() <= self._repeat_until
        if not must:
            self.state = self.state.become(TopicState.OPEN)
        return must

    def publish_stop(self) -> None:
        """Publish the stop message."""
        if self._publisher is not None and self._prepared is not None:
            stamped = self._make_stop(self._gate.clock.time_ns) if self._is_stamped else self._prepared
            self._publisher.publish(stamped)
            if self._gate.faults:
                self._gate.faults.pop(self.name, None)

    # Clients

    def leave(self, client: Actor, why: str) -> None:
        """Remove a client that no longer publishes here, and release its lease."""
        self.users.discard(client)
        client.topics.discard(self)
        if self.lease is not None:
            self.lease.release(client, why)

    def take_over(self, before: GuardedTopic) -> None:
        """Continue the topic under other rules: clients, lease, rates, stop messages and pauses.

        The robot is stopped if the holder of the lease may not keep it.
        """
        gate = self._gate
        for client in tuple(before.users):
            self.users.add(client)
            client.topics.add(self)
        self._paused_at.update(before._paused_at)
        self._motion.take_over(before._motion)
        streams = before._freshness
        if self._freshness is not None and streams is not None and self._freshness.seconds == streams.seconds:
            streams.max_age = self._freshness.max_age
            self._freshness = streams  # Commands that waited are still rejected.
        self.driven_in, self.stopped_in = before.driven_in, before.stopped_in
        if self.is_emergency and self.driven_in == gate.presses:
            gate.stop_path.note_topic(self)
        if before.state is TopicState.STOPPING and self._publisher is not None:
            self._repeat_until = before._repeat_until
            self.state = self.state.become(TopicState.STOPPING)
            gate.stop_path.repeat(self)
        if before.lease is None:
            return
        if self.lease is not None:
            self.lease.take_over_bar(before.lease)
        holder = before.lease.holder
        if holder is None:
            return
        holder.topics.discard(before)
        if self.lease is not None and self._rules_of(holder.role).lease is not None:
            holder.topics.add(self)
            self._lease_owner, before._lease_owner = before._lease_owner, ""
            gate.held.pop(before.lease, None)
            gate.held[self.lease] = self.name
            self.lease.take_over(before.lease)
        else:
            before.end_lease(LOST_BY_RELOAD)
            self.halt()

    def close(self) -> None:
        """Close the topic's publisher."""
        self.state = self.state.become(TopicState.CLOSED)
        self._gate.stop_path.forget_topic(self)
        self._gate.stop_path.end_repeats(self)
        for client in tuple(self.users):
            client.topics.discard(self)
        self._gate.faults.pop(self.name, None)
        if self._publisher is not None:
            self._publisher.close()
            self._publisher = None


def _is_small(payload: Payload) -> bool:
    """Return True if a message may be decoded here: its size is not limited yet."""
    return payload.is_decoded or payload.kept_size <= _MAX_DECODED_BYTES


def _is_equal(one: msgspec.Struct, other: msgspec.Struct) -> bool:
    """Return True if two messages of one type are equal, headers apart."""
    for name in one.__struct_fields__:  # No generator, because it runs for every command.
        if name != "header" and getattr(one, name) != getattr(other, name):
            return False
    return True
