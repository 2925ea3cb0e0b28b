"""Who may publish on a topic: one client at a time, as long as its messages come."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt.access.errors import GateRefused

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.gate.record import Actor
    from rwt.access.settings.gate import LeaseSettings
    from rwt_graph.clock import Clock
    from rwt_participant.timers import Timer


class Lease:
    """The lease of one topic.

    It is given by publishing or by asking, passed on by who holds it, taken by a stronger role, and lost by
    silence, by leaving, and when it is given back.

    A message costs no timer: the one timer there is looks, when it is due, whether the holder has been silent
    for so long.

    Attributes:
        holder: who holds it; None: nobody does.
        since_ns: ROS time since when.

    Args:
        topic: absolute name.
        key: of the setting, for texts.
        settings: see there.
        clock: of the graph.
        on_change: called after each change of the holder: with what happened, who holds it now and who held
            it before.
    """

    __slots__ = (
        "_clock", "_heard_at", "_key", "_on_change", "_timer", "_topic", "holder", "settings", "since_ns",
    )  # fmt: skip

    def __init__(
        self,
        topic: str,
        key: str,
        settings: LeaseSettings,
        clock: Clock,
        on_change: Callable[[str, Actor | None, Actor | None], None],
    ) -> None:
        self._topic = topic
        self._key = key
        self.settings = settings
        self._clock = clock
        self._on_change = on_change
        self._timer: Timer | None = None
        self._heard_at = 0.0
        self.holder: Actor | None = None
        self.since_ns = clock.time_ns()

    def require(self, client: Actor) -> None:
        """Refuse unless a message of the client may pass, with which it takes the lease where it has to.

        Raises:
            GateRefused: another one holds it, who is named, or it has to be asked for.
        """
        if client is self.holder:
            return
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

    def _rank(self, client: Actor) -> int:
        order = self.settings.precedence
        return order.index(client.role) if client.role in order else len(order)

    def heard(self, client: Actor) -> None:
        """A message of a client has passed that :meth:`require` lets pass."""
        self._heard_at = self._clock.monotonic()
        if client is not self.holder:
            self._give(client, "taken")

    def take(self, client: Actor) -> None:
        """Give the lease to a client that asks for it, or go on with it.

        Raises:
            GateRefused: another one holds it, who is named.
        """
        if client is not self.holder:
            self._require_free(client)
        self.heard(client)

    def pass_on(self, to: Actor) -> None:
        """Give the lease to another client, which then has to publish like any holder."""
        self._heard_at = self._clock.monotonic()
        if to is not self.holder:
            self._give(to, "passed on")

    def lose(self, client: Actor | None, why: str) -> None:
        """Free the lease if a client holds it; None: whoever does."""
        if self.holder is not None and client in (None, self.holder):
            self._stop_timer()
            self._give(None, why)

    def _give(self, client: Actor | None, what: str) -> None:
        before, self.holder = self.holder, client
        self.since_ns = self._clock.time_ns()
        if client is not None and self._timer is None:
            self._timer = self._clock.call_later(self.settings.seconds, self._look)
        self._on_change(what, client, before)

    def _look(self) -> None:
        """Free the lease of a holder that was silent for too long."""
        self._timer = None
        left = self._heard_at + self.settings.seconds - self._clock.monotonic()
        # Sums of floats round; a timer of less than a microsecond would run at once again.
        if left > 1e-6:
            self._timer = self._clock.call_later(left, self._look)
        else:
            self.lose(None, f"lost by {self.settings.seconds:g} s of silence")

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
