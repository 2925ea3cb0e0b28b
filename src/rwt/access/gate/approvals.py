"""Human approval: pending requests, and approvals that are valid for a while."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rwt.access.errors import GateRefused
from rwt.access.roles import glob_pattern
from rwt_graph.api import PendingCall

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.gate.record import Actor, Recorder
    from rwt.access.gate.rules import GatedAct, Rule
    from rwt_graph.clock import Clock
    from rwt_interfaces.payload import Payload
    from rwt_participant.timers import Timer

#: Maximum number of pending requests of all clients: a person reads them.
MAX_PENDING: Final = 100

#: Maximum number of pending requests of one client.
MAX_OF_CLIENT: Final = 20

#: Maximum number of characters of a message that a person is shown.
_MAX_CONTENT: Final = 2000

_Key = tuple["Actor", "GatedAct", str, str]
"""Subject of an approval: client, act, name and key of the rule."""


class Approval(PendingCall):
    """Request for the approval of one act.

    States: pending until it is approved, denied (by a person, by timeout, or since the client left) or
    withdrawn (:meth:`cancel`). It leaves :attr:`Approvals.pending` once and for all.

    Attributes:
        id: number of the request, as a string.
        client: client that requests approval.
        act: act to be approved.
        name: name of the topic, service, action or parameter.
        rule: rule that requires approval.
        content: message to be sent, as JSON, truncated.
        asked_ns: ROS time of the request.
        go: performs the act once it is approved; None: the client has to send it again. Set by the requester.
        refuse: called with the reason if the request is denied; set by the requester.
        timer: denies the request after the timeout.
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
        """Subject of the approval."""
        return (self.client, self.act, self.name, self.rule.key)

    def cancel(self) -> None:
        """Withdraw the request."""
        self._approvals.withdraw(self)


class Approvals:
    """Requests for approval of one gate, and approvals that are valid for a while.

    An approval with a duration stays valid until then. One without is for a single act: it is performed at
    once, or, for a message, when the client sends it again.

    Args:
        clock: clock of the graph.
        recorder: records requests and answers.
        on_change: called after a change of the pending requests.
    """

    def __init__(self, clock: Clock, recorder: Recorder, on_change: Callable[[], None]) -> None:
        self._clock = clock
        self._recorder = recorder
        self._on_change = on_change
        self._count = 0
        self._pending: dict[str, Approval] = {}
        # Until when on the steady clock, and whether it is for a single act.
        self._granted: dict[_Key, tuple[float, bool]] = {}

    @property
    def pending(self) -> tuple[Approval, ...]:
        """Pending requests, oldest first."""
        return tuple(self._pending.values())

    def take(self, client: Actor, act: GatedAct, name: str, rule: Rule) -> bool:
        """Return True if an act is approved; an approval for a single act is used up."""
        key = (client, act, name, rule.key)
        granted = self._granted.get(key)
        if granted is None:
            return False
        until, is_single = granted
        if is_single or self._clock.monotonic() >= until:
            del self._granted[key]
        return self._clock.monotonic() < until

    def find(self, client: Actor, act: GatedAct, name: str, rule: Rule) -> Approval | None:
        """Return the pending request for the same act, if any."""
        key = (client, act, name, rule.key)
        return next((each for each in self._pending.values() if each.key == key), None)

    def ask(self, client: Actor, act: GatedAct, name: str, rule: Rule, payload: Payload | None) -> Approval:
        """Request approval.

        Raises:
            GateRefused: the maximum number of pending requests is reached.
        """
        if sum(each.client is client for each in self._pending.values()) >= MAX_OF_CLIENT:
            raise GateRefused(
                f"{MAX_OF_CLIENT} requests of this client wait for an answer", f"{rule.key}.approval"
            )
        if len(self._pending) >= MAX_PENDING:
            raise GateRefused(f"{MAX_PENDING} requests wait for an answer", f"{rule.key}.approval")
        assert rule.settings.approval is not None  # Only rules with it require approval.
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
        """Approve or deny a request.

        Args:
            id: id of the request.
            approve: True to approve, False to deny.
            by: client that answers; None: a program of the robot, or a person asked by a gateway.
            seconds: duration of the approval; 0: for this act only.

        Returns:
            A description of what was approved or denied.

        Raises:
            GateRefused: no request of that id is pending, the client may not answer it, or `seconds` is
                longer than the rule allows.
        """
        approval = self._pending.get(id)
        if approval is None:
            raise GateRefused(f"nothing waits for an answer under id {id[:40]!r}")
        settings = approval.rule.settings.approval
        assert settings is not None  # Only rules with it require approval.
        key = f"{approval.rule.key}.approval"
        if by is not None and glob_pattern(settings.roles).fullmatch(by.role) is None:
            raise GateRefused(f"role {by.role!r} may not answer requests", f"{key}.roles")
        if by is approval.client:
            raise GateRefused("a client may not answer its own request", key)
        # Written so that NaN is rejected, too.
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
            # The client has to send it again, within the timeout of the request.
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
        """Withdraw a request that is still pending."""
        if self._pending.get(approval.id) is approval:
            self._end(approval)

    def _end(self, approval: Approval) -> None:
        del self._pending[approval.id]
        if approval.timer is not None:
            approval.timer.cancel()
        self._on_change()

    def leave(self, client: Actor) -> None:
        """Deny the requests of a client that leaves, and drop its approvals."""
        for approval in [each for each in self._pending.values() if each.client is client]:
            self._deny(approval, None, "the client has left")
        self._granted = {key: held for key, held in self._granted.items() if key[0] is not client}

    def _forget_expired(self) -> None:
        now = self._clock.monotonic()
        self._granted = {key: held for key, held in self._granted.items() if held[0] > now}


def _shown(payload: Payload | None) -> str:
    """Return a message as shown to a person."""
    if payload is None:
        return ""
    if payload.kept_size > 2 * _MAX_CONTENT:
        return f"{payload.type.name} of about {payload.kept_size} bytes"
    text = bytes(payload.json()).decode()
    return text if len(text) <= _MAX_CONTENT else f"{text[:_MAX_CONTENT]}…"
