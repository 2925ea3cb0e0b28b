"""What waits for a person's yes, and what has had one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rwt.access.errors import GateRefused
from rwt.access.gate.rules import pattern
from rwt_graph.api import PendingCall

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.gate.record import Actor, Recorder
    from rwt.access.gate.rules import GatedAct, Rule
    from rwt_graph.clock import Clock
    from rwt_interfaces.payload import Payload
    from rwt_participant.timers import Timer

#: Requests that wait at a time, of all clients: a person reads them.
MOST_PENDING: Final = 100

#: Of one client.
MOST_OF_CLIENT: Final = 20

_LONGEST_CONTENT: Final = 2000
"""Characters of a message that a person is shown."""

_Key = tuple["Actor", "GatedAct", str, str]
"""What a yes is for: who, what, with which name, by which rule."""


class Approval(PendingCall):
    """One act that waits for a person's answer.

    Attributes:
        id: a number, as text.
        client: who asks.
        act: see :data:`rwt.access.gate.rules.GatedAct`.
        name: of the topic, service, action or parameter.
        rule: which asks for the yes.
        content: what is to be done, as JSON, cut.
        asked_ns: ROS time.
        go: does it; set by who asks.
        refuse: is told why it is not done; set by who asks.
    """

    __slots__ = (
        "_approvals",
        "act",
        "asked_ns",
        "client",
        "content",
        "go",
        "id",
        "name",
        "refuse",
        "rule",
        "timer",
    )

    def __init__(
        self, approvals: Approvals, id: str, client: Actor, act: GatedAct, name: str, rule: Rule, content: str
    ) -> None:
        self._approvals = approvals
        self.id = id
        self.client = client
        self.act: GatedAct = act
        self.name = name
        self.rule = rule
        self.content = content
        self.asked_ns = 0
        self.go: Callable[[], None] | None = None
        self.refuse: Callable[[str], None] | None = None
        self.timer: Timer | None = None

    @property
    def key(self) -> _Key:
        """What the yes is for."""
        return (self.client, self.act, self.name, self.rule.key)

    def cancel(self) -> None:
        """Ask no more: the client has gone, or does not want it any longer."""
        self._approvals.withdraw(self)


class Approvals:
    """The requests of one gate, and the answers that hold for a while.

    Args:
        clock: of the graph.
        recorder: notes requests and answers.
        on_change: called when the list of what waits is another.
    """

    def __init__(self, clock: Clock, recorder: Recorder, on_change: Callable[[], None]) -> None:
        self._clock = clock
        self._recorder = recorder
        self._on_change = on_change
        self._count = 0
        self._pending: dict[str, Approval] = {}
        self._granted: dict[_Key, tuple[float, bool]] = {}

    @property
    def pending(self) -> tuple[Approval, ...]:
        """What waits, oldest first."""
        return tuple(self._pending.values())

    def take(self, client: Actor, act: GatedAct, name: str, rule: Rule) -> bool:
        """Whether an answer that was given holds for this act; one that is for a single act is used up."""
        key = (client, act, name, rule.key)
        granted = self._granted.get(key)
        if granted is None:
            return False
        until, is_single = granted
        if is_single or self._clock.monotonic() >= until:
            del self._granted[key]
        return self._clock.monotonic() < until

    def find(self, client: Actor, act: GatedAct, name: str, rule: Rule) -> Approval | None:
        """The request for just this that waits already."""
        key = (client, act, name, rule.key)
        return next((each for each in self._pending.values() if each.key == key), None)

    def ask(self, client: Actor, act: GatedAct, name: str, rule: Rule, payload: Payload | None) -> Approval:
        """Ask for a yes.

        Raises:
            GateRefused: as much waits already as people can read.
        """
        if sum(each.client is client for each in self._pending.values()) >= MOST_OF_CLIENT:
            raise GateRefused(
                f"{MOST_OF_CLIENT} requests of this client wait for an answer", f"{rule.key}.approval"
            )
        if len(self._pending) >= MOST_PENDING:
            raise GateRefused(f"{MOST_PENDING} requests wait for an answer", f"{rule.key}.approval")
        assert rule.settings.approval is not None  # Only rules with it ask.
        self._count += 1
        approval = Approval(self, str(self._count), client, act, name, rule, _shown(payload))
        approval.asked_ns = self._clock.time_ns()
        seconds = rule.settings.approval.seconds
        approval.timer = self._clock.call_later(
            seconds, lambda: self._deny(approval, None, f"nobody answered within {seconds:g} s")
        )
        self._pending[approval.id] = approval
        self._recorder.note("asked", act, name, client, f"as {approval.id}: {approval.content}", rule.key)
        self._on_change()
        return approval

    def answer(self, id: str, *, approve: bool, by: Actor | None, seconds: float = 0.0) -> str:
        """Answer a request.

        Args:
            id: of the request.
            approve: yes or no.
            by: who answers; None: the robot's own program, or a person whom a gateway has asked.
            seconds: for how long a yes holds; 0: for this act alone.

        Returns:
            What was said yes or no to, in words.

        Raises:
            GateRefused: nothing waits under that id, or whoever answers may not.
        """
        approval = self._pending.get(id)
        if approval is None:
            raise GateRefused(f"nothing waits for an answer under id {id[:40]!r}")
        settings = approval.rule.settings.approval
        assert settings is not None  # Only rules with it ask.
        key = f"{approval.rule.key}.approval"
        if by is not None and pattern(settings.roles).fullmatch(by.role) is None:
            raise GateRefused(f"role {by.role!r} may not answer requests", f"{key}.roles")
        if by is approval.client:
            raise GateRefused("a client may not answer its own request", key)
        # Written so that what is no number is refused too.
        if not 0 <= seconds <= settings.remember_seconds:
            raise GateRefused(
                f"a yes holds for at most {settings.remember_seconds:g} s here, got {seconds:g}",
                f"{key}.remember_seconds",
            )
        what = f"{approval.act} {approval.name} of {approval.client}"
        if not approve:
            self._deny(approval, by, "a person said no")
            return f"denied: {what}"
        self._end(approval)
        self._recorder.note("approved", approval.act, approval.name, by, f"{id} of {approval.client}", key)
        self._forget_expired()
        now = self._clock.monotonic()
        if seconds:
            self._granted[approval.key] = (now + seconds, False)
        elif approval.go is None:
            # The client has to send it again, for which it has as long as there was to answer.
            self._granted[approval.key] = (now + settings.seconds, True)
        if approval.go is not None:
            approval.go()
        return f"approved: {what}"

    def _deny(self, approval: Approval, by: Actor | None, why: str) -> None:
        self._end(approval)
        self._recorder.note(
            "denied",
            approval.act,
            approval.name,
            by,
            f"{approval.id} of {approval.client}: {why}",
            approval.rule.key,
        )
        if approval.refuse is not None:
            approval.refuse(f"{approval.act} {approval.name}: {why} ({approval.rule.key}.approval)")

    def withdraw(self, approval: Approval) -> None:
        """Ask no more."""
        if self._pending.get(approval.id) is approval:
            self._end(approval)

    def _end(self, approval: Approval) -> None:
        del self._pending[approval.id]
        if approval.timer is not None:
            approval.timer.cancel()
        self._on_change()

    def leave(self, client: Actor) -> None:
        """Forget a client: what it asked, and what it was allowed."""
        for approval in [each for each in self._pending.values() if each.client is client]:
            self._deny(approval, None, "the client has left")
        self._granted = {key: held for key, held in self._granted.items() if key[0] is not client}

    def _forget_expired(self) -> None:
        now = self._clock.monotonic()
        self._granted = {key: held for key, held in self._granted.items() if held[0] > now}


def _shown(payload: Payload | None) -> str:
    """A message as a person is shown it."""
    if payload is None:
        return ""
    if payload.kept_size > 2 * _LONGEST_CONTENT:
        return f"{payload.type.name} of about {payload.kept_size} bytes"
    text = bytes(payload.json()).decode()
    return text if len(text) <= _LONGEST_CONTENT else f"{text[:_LONGEST_CONTENT]}…"
