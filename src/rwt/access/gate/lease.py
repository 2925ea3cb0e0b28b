"""Leases: one client at a time may publish on a topic, as long as it keeps publishing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rwt.access.errors import GateRefused

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.gate.record import Actor
    from rwt.access.settings import LeaseSettings
    from rwt_graph.clock import Clock
    from rwt_participant.timers import Timer


#: Interval at which suspension is looked for, and the shortest one that is noticed, in seconds.
_WATCH_SECONDS: Final = 0.05
_SUSPENDED_SECONDS: Final = 0.1

#: Seconds after the end of a lease at which it was noticed so late that the process must have been paused.
_LATE_SECONDS: Final = 0.25

#: Seconds for which a lease whose end was noticed late cannot be taken.
_BARRED_SECONDS: Final = 0.25


class WakeWatch:
    """Detection of the machine's suspension, while there is something to watch for.

    Timers do not run on while a machine is suspended, so a lease would last for its rest after the wake-up.

    Args:
        look: called with True after the machine was suspended, otherwise with False; returns False if nothing
            is left to watch for.
    """

    __slots__ = ("_clock", "_look", "_offset", "_timer")

    def __init__(self, clock: Clock, look: Callable[[bool], bool]) -> None:
        self._clock = clock
        self._look = look
        self._offset = 0.0
        self._timer: Timer | None = None

    def begin(self) -> None:
        """Watch from now on; no-op if it does already."""
        if self._timer is None:
            self._offset = self._clock.boottime() - self._clock.monotonic()
            self._timer = self._clock.call_urgently(_WATCH_SECONDS, self._check)

    def _check(self) -> None:
        offset = self._clock.boottime() - self._clock.monotonic()
        was_suspended, self._offset = offset - self._offset > _SUSPENDED_SECONDS, offset
        self._timer = None
        if self._look(was_suspended):
            self._timer = self._clock.call_urgently(_WATCH_SECONDS, self._check)

    def close(self) -> None:
        """Watch no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class Lease:
    """Lease of one topic.

    States::

        free ──publish, or take_lease──> held ──silence, leaving, release, emergency stop──> free
                                          └──a stronger role publishes or asks, or the holder passes it on──┐
                                           ^────────────────────────────────────────────────────────────────┘

    A message starts no timer: the only timer checks, when it expires, how long the holder has been silent.
    It runs while the lease is held.

    The end of a lease may be noticed late: the process was paused (SIGSTOP, a migration), or the machine was
    suspended. The first that happens then is the release, also if a message comes before the timer. Messages
    of the time before are read next; so the lease cannot be taken for a moment.

    Attributes:
        holder: client that holds the lease; None while it is free.
        since_ns: ROS time of the last change of the holder.

    Args:
        topic: absolute name of the topic.
        key: key of the setting, for error texts.
        on_change: called after each change of the holder, with a description of the change, the holder and
            the holder before.
        require_room: raises GateRefused if a client may hold no more leases.
    """

    __slots__ = (
        "_barred_until", "_clock", "_key", "_on_change", "_renewed_at", "_require_room", "_timer", "_topic",
        "holder", "settings", "since_ns",
    )  # fmt: skip

    def __init__(
        self,
        topic: str,
        key: str,
        settings: LeaseSettings,
        clock: Clock,
        on_change: Callable[[str, Actor | None, Actor | None], None],
        require_room: Callable[[Actor], None],
    ) -> None:
        self._topic = topic
        self._key = key
        self.settings = settings
        self._clock = clock
        self._on_change = on_change
        self._require_room = require_room
        self._timer: Timer | None = None
        self._renewed_at = 0.0  # By the clock that includes suspension, as below.
        self._barred_until = 0.0
        self.holder: Actor | None = None
        self.since_ns = clock.time_ns()

    def require(self, client: Actor) -> None:
        """Check that the client may publish: it holds the lease, or may take it by publishing.

        Raises:
            GateRefused: another client holds the lease, or it is only given on request.
        """
        if client is self.holder:
            if self._clock.boottime() - self._renewed_at <= self.settings.seconds:
                return
            self.check_silence()
        self._require_free(client)
        if self.settings.take == "service":
            raise GateRefused(
                f"{self._topic} is published on by who holds its lease: take it by /gate/take_lease first",
                f"{self._key}.take",
            )

    def _require_free(self, client: Actor) -> None:
        holder = self.holder
        if holder is not None and self._rank(client) >= self._rank(holder):
            raise GateRefused(f"{self._topic} is held by {holder}", self._key)
        if self._clock.boottime() < self._barred_until:
            raise GateRefused(
                f"the lease of {self._topic} ended while this server was paused:"
                f" commands of that time are not executed, send them again in {_BARRED_SECONDS:g} s",
                self._key,
            )
        self._require_room(client)

    def _rank(self, client: Actor) -> int:
        order = self.settings.precedence
        return order.index(client.role) if client.role in order else len(order)

    def renew(self, client: Actor, change: str = "taken") -> None:
        """Give or extend the lease without a check, after a message for which :meth:`require` passed.

        Args:
            change: description of the change if another client gets it.
        """
        self._renewed_at = self._clock.boottime()
        if client is not self.holder:
            self._give(client, change)

    def take(self, client: Actor) -> None:
        """Give or extend the lease on request.

        Raises:
            GateRefused: another client holds the lease.
        """
        if client is not self.holder:
            self._require_free(client)
        self.renew(client)

    def take_over_bar(self, other: Lease) -> None:
        """Continue the bar of another lease, whose settings were replaced: commands of a pause may follow."""
        self._barred_until = other._barred_until

    def take_over(self, other: Lease) -> None:
        """Continue another lease, whose settings were replaced: its holder keeps it, silence included."""
        self.holder, other.holder = other.holder, None
        self.since_ns = other.since_ns
        self._renewed_at = other._renewed_at
        other._stop_timer()
        if self.holder is not None:
            self.check_silence()

    def release(self, client: Actor | None, why: str) -> None:
        """Free the lease if `client` holds it; None: from any holder."""
        if self.holder is not None and client in (None, self.holder):
            self._stop_timer()
            self._give(None, why)

    def _give(self, client: Actor | None, change: str) -> None:
        before, self.holder = self.holder, client
        self.since_ns = self._clock.time_ns()
        if client is not None and self._timer is None:
            self._timer = self._clock.call_urgently(self.settings.seconds, self.check_silence)
        self._on_change(change, client, before)

    def check_silence(self) -> None:
        """Free the lease if the holder has been silent for too long; otherwise check again later."""
        self._stop_timer()
        if self.holder is None:
            return
        now = self._clock.boottime()
        left = self._renewed_at + self.settings.seconds - now
        # Sums of floats round: a timer of less than a microsecond would expire at once, again and again.
        if left > 1e-6:
            self._timer = self._clock.call_urgently(left, self.check_silence)
            return
        if -left > _LATE_SECONDS:
            self._barred_until = now + _BARRED_SECONDS
        self.release(None, f"lost by {self.settings.seconds:g} s of silence")

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
