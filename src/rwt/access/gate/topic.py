"""One topic that rules of the gate are about: what may be published on it, by whom, and what stops it."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

import msgspec

from rwt.access.errors import GateRefused
from rwt.access.gate.fields import FieldChecks, Motion, NoSuchField
from rwt.access.gate.lease import Lease
from rwt.access.quotas import RateLimit
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.payload import Payload

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rwt.access.gate.record import Actor, Recorder
    from rwt.access.gate.rules import Rule
    from rwt_graph.api import Participant, Publisher
    from rwt_graph.clock import Clock
    from rwt_interfaces.structs import MessageType
    from rwt_participant.timers import Timer

logger: Final = logging.getLogger("rwt.bridge")

#: Seconds between two stop messages while they are repeated.
REPEAT_PERIOD: Final = 0.1

#: Seconds of silence before a client that went on publishing while the robot was stopped moves it again.
_REST: Final = 1.0


class Shared(Protocol):
    """What all topics of a gate share."""

    participant: Participant
    clock: Clock
    recorder: Recorder
    is_observing: bool

    @property
    def stopped_by(self) -> str:
        """Who has pressed the emergency stop; empty while it is released."""
        ...

    def leases_changed(self) -> None:
        """Tell who holds what now."""

    def approve_message(self, topic: str, rule: Rule, client: Actor, payload: Payload) -> None:
        """Refuse a message that nobody has said yes to, and ask.

        Raises:
            GateRefused: nobody has, yet.
        """


class _Part(NamedTuple):
    """One rule, compiled for the topic's type."""

    rule: Rule
    checks: FieldChecks | None
    rate: RateLimit | None


class GuardedTopic:
    """A topic that rules are about.

    What is wrong with a rule for the topic's type, such as a field that there is not, refuses every message.

    Attributes:
        name: absolute.
        type: of its messages.
        lease: who may publish; None: no rule asks for one.
        fault: what is wrong with its rules; empty: nothing.
        users: clients that publish on it.

    Args:
        shared: of the gate.
        name: see above.
        type: see above.
        rules: all that are about it.
    """

    def __init__(self, shared: Shared, name: str, type: MessageType, rules: Iterable[Rule]) -> None:
        self.name = name
        self.type = type
        self.fault = ""
        self.users: set[Actor] = set()
        self._shared = shared
        self._rules = tuple(rules)
        self._motion = Motion()
        self._publisher: Publisher | None = None
        self._repeats: Timer | None = None
        self._repeat_until = 0.0
        self._restless: dict[Actor, float] = {}
        self._by_role: dict[str, tuple[_Part, ...]] = {}
        stops = [rule for rule in self._rules if rule.settings.stop is not None]
        self._stop = stops[0] if stops else None
        self._repeat_seconds = max(
            (rule.settings.stop.repeat_seconds for rule in stops if rule.settings.stop), default=0.0
        )
        self._neutral: msgspec.Struct | None = None
        self._parts: tuple[_Part, ...] = ()
        try:
            stop_message = self._make_stop()
            self._neutral = None if stop_message is None else stop_message.value()
            self._parts = tuple(self._compile(rule) for rule in self._rules)
        except NoSuchField as wrong:
            self.fault = f"{wrong} ({self.type.name}, {name})"
        self.lease = self._make_lease()
        if self.fault:
            logger.error("the gate lets nothing through on %s: %s", name, self.fault)
        elif self._stop is not None:
            # Before it is needed: over a network it takes a while until subscribers know of it.
            self._publisher = shared.participant.advertise(name, type)

    def _compile(self, rule: Rule) -> _Part:
        checks = FieldChecks(rule, self.type, self._neutral)
        most = rule.settings.messages_per_second
        return _Part(
            rule, None if checks.is_empty else checks, RateLimit(most, 1 + most // 10) if most else None
        )

    def _make_lease(self) -> Lease | None:
        """The lease of the rule that gives the shortest one."""
        found = [(rule.settings.lease, rule) for rule in self._rules if rule.settings.lease is not None]
        if not found:
            return None
        settings, rule = min(found, key=lambda each: each[0].seconds)
        return Lease(self.name, f"{rule.key}.lease", settings, self._shared.clock, self._lease_changed)

    def _make_stop(self) -> Payload | None:
        """The stop message with the time of now; None where there is none."""
        if self._stop is None or self._stop.settings.stop is None:
            return None
        try:
            # A copy: a header is completed in it.
            return Payload.from_value(
                self.type, dict(self._stop.settings.stop.message), self._shared.clock.time_ns
            )
        except InterfaceError as error:
            raise NoSuchField(f"`{self._stop.key}.stop.message`: {error}") from None

    @property
    def is_idle(self) -> bool:
        """Whether nothing would be lost with it."""
        held = self.lease is not None and self.lease.holder is not None
        return not (self.users or held or self._repeats or self.is_stopped)

    @property
    def is_stopped(self) -> bool:
        """Whether the emergency stop holds here."""
        return bool(self._shared.stopped_by) and any(rule.settings.emergency for rule in self._rules)

    @property
    def lease_rule(self) -> str:
        """The key of the rule that gives the lease."""
        return next((rule.key for rule in self._rules if rule.settings.lease is not None), "")

    # Messages

    def publish(self, client: Actor, payload: Payload, hand_on: Callable[[Payload], None]) -> None:
        """Hand a client's message on, if every rule lets it pass.

        Args:
            client: who publishes.
            payload: of the topic's type.
            hand_on: publishes it.

        Raises:
            GateRefused: a rule does not; the text says which.
        """
        parts = self._by_role.get(client.role)
        if parts is None:
            parts = self._by_role[client.role] = self._parts_of(client.role)
        if not parts and not self.fault:
            hand_on(payload)
            return
        shared = self._shared
        now = shared.clock.monotonic()
        leased = self.lease if any(part.rule.settings.lease for part in parts) else None
        taken = payload
        try:
            taken = self._passed(client, parts, leased, payload, now)
        except GateRefused as refused:
            self._motion.refused()
            decision = "would refuse" if shared.is_observing else "refused"
            shared.recorder.note(decision, "publish", self.name, client, str(refused), refused.rule)  # type: ignore[arg-type]  # one of two literals
            if not shared.is_observing:
                raise
            hand_on(payload)
            return
        self._motion.passed(now)
        if leased is not None:
            leased.heard(client)
        if self._repeats is not None:
            self._end_repeats()
        hand_on(payload if shared.is_observing else taken)

    def _parts_of(self, role: str) -> tuple[_Part, ...]:
        return tuple(part for part in self._parts if part.rule.holds_for(role))

    def _passed(
        self, client: Actor, parts: tuple[_Part, ...], lease: Lease | None, payload: Payload, now: float
    ) -> Payload:
        """The message as it may be published."""
        if self.fault:
            raise GateRefused(f"the rules of {self.name} cannot be applied: {self.fault}")
        if self._restless or self._shared.stopped_by:
            self._require_moving(client, parts, payload, now)
        if lease is not None:
            lease.require(client)
        changed: list[str] = []
        for rule, checks, rate in parts:
            if checks is not None:
                payload, changes = checks.check(payload, self._motion, now)
                if changes:
                    changed.append(changes)
            if rate is not None and not rate.take(now):
                raise GateRefused(
                    f"more than {rule.settings.messages_per_second} messages a second on {self.name}",
                    f"{rule.key}.messages_per_second",
                )
        for rule, _, _ in parts:
            if rule.settings.approval is not None:
                self._shared.approve_message(self.name, rule, client, payload)
        if changed:
            self._shared.recorder.note(
                "changed", "publish", self.name, client, "; ".join(changed), parts[0].rule.key
            )
        return payload

    def _require_moving(self, client: Actor, parts: tuple[_Part, ...], payload: Payload, now: float) -> None:
        """Refuse while the robot is stopped, and after it as long as the client just goes on as before."""
        rule = next((part.rule for part in parts if part.rule.settings.emergency), None)
        if rule is None:
            return
        if self._shared.stopped_by:
            self._restless[client] = now
            raise GateRefused(
                f"the emergency stop is on: stopped by {self._shared.stopped_by}", f"{rule.key}.emergency"
            )
        refused_at = self._restless.get(client)
        if refused_at is None:
            return
        if now - refused_at < _REST and not _same(payload.value(), self._neutral):
            self._restless[client] = now
            raise GateRefused(
                "the emergency stop was released while this client went on publishing:"
                f" be silent for {_REST:g} s, or send the stop message first",
                f"{rule.key}.emergency",
            )
        del self._restless[client]

    # Standing still

    def _lease_changed(self, what: str, holder: Actor | None, before: Actor | None) -> None:
        shared = self._shared
        shared.recorder.note("lease", "publish", self.name, holder or before, what, self.lease_rule)
        if before is not None and what != "taken" and not shared.is_observing:
            # Who takes it by publishing says itself what the robot does.
            self.halt()
        shared.leases_changed()

    def emergency_stop(self) -> None:
        """Stop, and let nobody hold the lease."""
        if self.lease is None or self.lease.holder is None or self._shared.is_observing:
            self.halt()
        else:
            self.lease.lose(None, "lost by the emergency stop")  # Which halts.

    def halt(self) -> None:
        """Publish the stop message now, and again until the robot's own time-out is past."""
        if self._publisher is None or self.fault:
            return
        self._motion.reset()
        self._repeat_until = self._shared.clock.monotonic() + self._repeat_seconds
        self._say_stop()

    def _say_stop(self) -> None:
        """Publish the stop message, and go on with it where that has to be."""
        self._end_repeats()
        publisher = self._publisher
        message = self._make_stop()
        if publisher is None or message is None:
            return
        clock = self._shared.clock
        if self.is_stopped or clock.monotonic() + REPEAT_PERIOD <= self._repeat_until:
            self._repeats = clock.call_later(REPEAT_PERIOD, self._say_stop)
        publisher.publish(message)

    def _end_repeats(self) -> None:
        if self._repeats is not None:
            self._repeats.cancel()
            self._repeats = None

    # Clients

    def left(self, client: Actor, why: str) -> None:
        """A client does not publish here any more."""
        self.users.discard(client)
        self._restless.pop(client, None)
        if self.lease is not None:
            self.lease.lose(client, why)

    def close(self) -> None:
        """Leave the topic."""
        self._end_repeats()
        if self._publisher is not None:
            self._publisher.close()
            self._publisher = None


def _same(one: msgspec.Struct, other: msgspec.Struct | None) -> bool:
    """Whether two messages of one type say the same, whatever their headers."""
    if other is None:
        return False
    names = (name for name in one.__struct_fields__ if name != "header")
    return all(getattr(one, name) == getattr(other, name) for name in names)
