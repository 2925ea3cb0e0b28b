"""Reference model of the gate: what the robot receives, by the words of the docs and in as little code."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, auto

LEASE_SECONDS = 0.5
REST_SECONDS = 1.0
BARRED_SECONDS = 0.25
PRECEDENCE = ("supervisor", "operator")
LIMITS = (1.0, 2.0)
"""Limits of the speed, before a reload and after it."""

_ROUNDING = 1e-9


class Fault(Enum):
    """Defect of a command."""

    NONE = auto()
    FIELD = auto()
    """A field beyond a limit that rejects."""


@dataclass(eq=False)
class Person:
    """Client as the model knows it; clients of one credential share pauses.

    Attributes:
        name: name that the gate gives it; empty until it is known.
    """

    role: str
    credential: str
    name: str = ""

    @property
    def rank(self) -> int:
        """Place in the order of roles; lower is stronger."""
        return PRECEDENCE.index(self.role) if self.role in PRECEDENCE else len(PRECEDENCE)


@dataclass
class GateModel:
    """State of a gate with one leased topic, one approved service, one action and one parameter.

    Attributes:
        by_service: True if the lease is only given on request.
        now: steady time.
        silent_since: time of the holder's last accepted message.
        paused: credentials that published while the robot was stopped, with the last time.
        pending: requests for approval by id: client and value.
    """

    by_service: bool
    now: float = 0.0
    limit: float = LIMITS[0]
    holder: Person | None = None
    silent_since: float = 0.0
    barred_until: float = 0.0
    is_stopped: bool = False
    paused: dict[str, float] = field(default_factory=dict)
    pending: dict[str, tuple[Person, bool]] = field(default_factory=dict)

    def may_take(self, who: Person) -> bool:
        """Return True if a client may take the lease on request."""
        if who is self.holder:
            return True
        if self.holder is not None and who.rank >= self.holder.rank:
            return False
        return self.now >= self.barred_until

    def publish(self, who: Person, speed: float, fault: Fault) -> float | None:
        """Return the speed that the robot receives; None if the command is rejected."""
        if self.is_stopped:
            self.paused[who.credential] = self.now
            return None
        refused_at = self.paused.get(who.credential)
        if refused_at is not None:
            is_stop = speed == 0.0 and fault is Fault.NONE
            if self.now - refused_at < REST_SECONDS and not is_stop:
                self.paused[who.credential] = self.now
                return None
            del self.paused[who.credential]
        if who is not self.holder and (self.by_service or not self.may_take(who)):
            return None
        if fault is Fault.FIELD:
            return None
        self.give(who)
        return min(speed, self.limit)

    def give(self, who: Person) -> None:
        """Give or renew the lease."""
        self.holder, self.silent_since = who, self.now

    def lose(self, who: Person | None) -> bool:
        """Free the lease if a client holds it; returns True if the robot has to be stopped."""
        if who is None or who is not self.holder:
            return False
        self.holder = None
        return True

    def stop(self) -> bool:
        """Press the emergency stop; returns True if the robot has to be stopped."""
        was_stopped, self.is_stopped = self.is_stopped, True
        self.holder = None
        self.pending.clear()
        return not was_stopped

    def advance(self, now: float) -> bool:
        """Let time pass; returns True if a lease has ended meanwhile, so that the robot has to be stopped."""
        self.now = now
        late = now - self.silent_since - LEASE_SECONDS
        if self.holder is None or late < -_ROUNDING:
            return False
        if late > BARRED_SECONDS:  # The process was paused.
            self.barred_until = now + BARRED_SECONDS
        return self.lose(self.holder)
