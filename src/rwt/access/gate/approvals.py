"""Human approval: pending requests, and approvals that are valid for a while."""

from __future__ import annotations

import hashlib
from collections import Counter
from enum import Enum
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import msgspec

from rwt.access.errors import GateRefused
from rwt.access.gate.fields import MAX_APPROVED_BYTES
from rwt.access.roles import glob_pattern
from rwt_graph.api import PendingCall
from rwt_interfaces.payload import Payload

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rwt.access.gate.record import Actor, Recorder
    from rwt.access.gate.rules import GatedAct, Rule
    from rwt_graph.clock import Clock

#: Maximum number of pending requests of all clients. Above it, the credential with the most loses its newest.
MAX_PENDING: Final = 1000

#: Maximum number of pending requests of one credential for one rule: a person reads them.
MAX_OF_CREDENTIAL: Final = 20

#: Maximum number of characters of a message that a person is shown.
_MAX_CONTENT: Final = 2000

#: Number of hexadecimal digits of a digest that a person is shown.
_SHOWN_DIGITS: Final = 16


class Subject(NamedTuple):
    """Subject of an approval. Another message, role or credential of the same client is another subject.

    Attributes:
        name: name of the topic, service, action or parameters.
        rule: key of the rule that requires approval.
        role: name of the client's role.
        credential: name of the credential that gave the role.
        digest: SHA-256 of the message as it will reach the robot; see :func:`digest_of`.
    """

    client: Actor
    act: GatedAct
    name: str
    rule: str
    role: str
    credential: str
    digest: str


def digest_of(payload: Payload, rule: Rule) -> str:
    """Return the SHA-256 of a message in hexadecimal, in CDR and without the stamp of its own header.

    The stamp is left out because a client that sends the message again stamps it anew.

    Raises:
        GateRefused: the message is too large to be approved.
    """
    if payload.kept_size > MAX_APPROVED_BYTES:
        raise GateRefused(
            f"a message of {payload.kept_size} bytes: at most {MAX_APPROVED_BYTES} can be approved",
            f"{rule.key}.approval",
        )
    value = payload.value()
    header: Any = getattr(value, "header", None)
    if hasattr(header, "stamp"):
        plain = header.__class__(frame_id=header.frame_id)
        payload = Payload.from_value(payload.type, msgspec.structs.replace(value, header=plain))
    return hashlib.sha256(payload.type.name.encode() + b"\0" + payload.cdr()).hexdigest()


class _ApprovalState(Enum):
    PENDING = "pending"
    APPROVED = "approved"
    DENIED = "denied"
    WITHDRAWN = "withdrawn"


class Approval(PendingCall):
    """Request for the approval of one act.

    Life cycle::

        PENDING ── a person approves ──> APPROVED
           ├── a person denies, timeout, the client has left ──> DENIED
           └── cancel() ──> WITHDRAWN

    Only pending requests are in :attr:`Approvals.pending`.

    Attributes:
        id: number of the request, as a string.
        client, act, name: those of the subject.
        slot: credential and rule whose requests are limited together.
        token: name of the token with which the client asked; empty without one.
        settings: those of the rule.
        content: digest and size of the message, the fields that rules name, and its JSON, truncated.
        asked_ns: ROS time of the request.
        go: performs the act once it is approved; None: the client has to send it again. Set by the requester.
        refuse: called with the reason if the request is denied; set by the requester.
        timer: denies the request after the timeout.
        until: end of the timeout, in seconds of the steady clock.
    """

    def __init__(self, approvals: Approvals, id: str, subject: Subject, rule: Rule, content: str) -> None:
        assert rule.settings.approval is not None  # Only rules with it require approval.
        self._approvals = approvals
        self.id = id
        self.subject = subject
        self.client = subject.client
        self.act: GatedAct = subject.act
        self.name = subject.name
        self.rule = rule
        self.settings = rule.settings.approval
        self.content = content
        self.slot = (subject.client.owner, rule.key)
        self.token = subject.client.token
        self.asked_ns = approvals.clock.time_ns()
        self._state = _ApprovalState.PENDING
        self.go: Callable[[], None] | None = None
        self.refuse: Callable[[str], None] | None = None
        self.until = approvals.clock.monotonic() + self.settings.seconds
        self.timer = approvals.clock.call_later(self.settings.seconds, partial(approvals.expire, self))

    @property
    def is_pending(self) -> bool:
        """True until it is approved, denied or withdrawn."""
        return self._state is _ApprovalState.PENDING

    def become(self, state: _ApprovalState) -> None:
        """Set the final state."""
        assert self.is_pending, f"{self._state} -> {state}"
        self._state = state

    @property
    def seconds_left(self) -> float:
        """Seconds until the request is denied for lack of an answer, with one decimal place."""
        return max(0.0, round(self.until - self._approvals.clock.monotonic(), 1))

    @property
    def progress(self) -> str:
        """Description for the client that waits."""
        roles = " or ".join(self.settings.roles) or "the robot"
        left = f"{self.seconds_left:g} s left"
        return f"{self.act} {self.name}: waiting for approval by {roles} ({left}, id {self.id})"

    def cancel(self) -> None:
        """Withdraw the request."""
        if self.is_pending:
            self._approvals.end(self, _ApprovalState.WITHDRAWN)


class Approvals:
    """Requests for approval of one gate, and approvals that are valid for a while.

    An approval is for the message that was shown. With a duration, the same message may be sent until then.
    Without, it is for a single act: it is performed at once, or, for a message, when the client sends the
    same message again.

    Args:
        on_change: called after a change of the pending requests.
        describe: returns the fields of a message that rules name, with their values.
    """

    def __init__(
        self,
        clock: Clock,
        recorder: Recorder,
        on_change: Callable[[], None],
        describe: Callable[[GatedAct, str, Payload], str],
    ) -> None:
        self.clock = clock
        self._recorder = recorder
        self._on_change = on_change
        self._describe = describe
        self._count = 0
        self._pending: dict[str, Approval] = {}
        # Until when on the steady clock, and whether it is for a single act.
        self._granted: dict[Subject, tuple[float, bool]] = {}
        self._counts: Counter[tuple[str, str]] = Counter()
        self._asked: dict[tuple[object, ...], Approval] = {}  # Pending, by the subject without its digest.

    @property
    def pending(self) -> tuple[Approval, ...]:
        """Pending requests, oldest first."""
        return tuple(self._pending.values())

    def subject(self, client: Actor, act: GatedAct, name: str, rule: Rule, payload: Payload) -> Subject:
        """Return the subject of an approval. Raises GateRefused if the message is too large."""
        role = client.rights
        digest = digest_of(payload, rule)
        return Subject(client, act, name, rule.key, role.name, role.credential, digest)

    def take(self, subject: Subject) -> bool:
        """Return True if an act is approved; an approval for a single act is used up."""
        granted = self._granted.get(subject)
        if granted is None:
            return False
        until, is_single = granted
        if is_single or self.clock.monotonic() >= until:
            del self._granted[subject]
        return self.clock.monotonic() < until

    def has_lasting(self, subject: Subject) -> bool:
        """Return True if any message of a subject's client on the same name is approved for a while."""
        now = self.clock.monotonic()
        return any(
            known[:-1] == subject[:-1] and not is_single and now < until
            for known, (until, is_single) in self._granted.items()
        )

    def find(self, subject: Subject) -> Approval | None:
        """Return the pending request of the same client for any message on the same name, if any."""
        return self._asked.get(subject[:-1])

    def listed(self, most: int) -> list[Approval]:
        """Return pending requests, oldest first; of many, the oldest ones of each credential."""
        ranks: Counter[str] = Counter()
        ranked = []
        for number, each in enumerate(self._pending.values()):
            ranks[each.slot[0]] += 1
            ranked.append((ranks[each.slot[0]], number, each))
        return [each for *_, each in sorted(sorted(ranked)[:most], key=itemgetter(1))]

    def ask(self, subject: Subject, rule: Rule, payload: Payload) -> Approval:
        """Request approval. Raises GateRefused if too many requests are pending."""
        client, act, name = subject[:3]
        slot = client.owner, rule.key
        if self._counts[slot] >= MAX_OF_CREDENTIAL:
            raise GateRefused(
                f"{MAX_OF_CREDENTIAL} requests of this client wait for an answer", f"{rule.key}.approval"
            )
        if len(self._pending) >= MAX_PENDING:
            self._make_room(client.owner, rule)
        self._count += 1
        content = _shown(subject.digest, self._describe(act, name, payload), payload)
        approval = Approval(self, str(self._count), subject, rule, content)
        self._pending[approval.id] = self._asked[subject[:-1]] = approval
        self._counts[slot] += 1
        self._recorder.note("asked", act, name, client, f"as {approval.id}: {approval.content}", rule.key)
        self._on_change()
        client.tell_approval(approval.progress)
        return approval

    def _make_room(self, owner: str, rule: Rule) -> None:
        """Deny the newest request of the credential with the most. Raises GateRefused if that is `owner`."""
        counts = Counter(each.slot[0] for each in self._pending.values())
        name, count = counts.most_common(1)[0]
        if counts[owner] + 1 >= count:
            raise GateRefused(f"{MAX_PENDING} requests wait for an answer", f"{rule.key}.approval")
        newest = next(each for each in reversed(self._pending.values()) if each.slot[0] == name)
        self._deny(newest, None, f"{MAX_PENDING} requests wait for an answer, most of them of its credential")

    def answer(self, id: str, *, approve: bool, by: Actor | None, seconds: float = 0.0) -> str:
        """Approve or deny a request.

        Args:
            approve: True to approve, False to deny.
            by: client that answers; None: a program of the robot, or a person asked by a gateway.
            seconds: duration of the approval; 0: for this act only.

        Returns:
            A description of what was approved or denied.

        Raises:
            GateRefused: no request of that id is pending, the client may not answer it or has no token but
                that of the requester, or `seconds` is longer than the rule allows.
        """
        approval = self._pending.get(id)
        if approval is None:
            raise GateRefused(f"nothing waits for an answer under id {id[:40]!r}")
        settings = approval.settings
        key = f"{approval.rule.key}.approval"
        if by is not None and glob_pattern(settings.roles).fullmatch(by.role) is None:
            raise GateRefused(f"role {by.role!r} may not answer requests", f"{key}.roles")
        # Without a token nothing distinguishes two connections of one person.
        if by is not None and not by.token:
            raise GateRefused("a client without a token may not answer requests (auth.tokens)", key)
        if by is not None and by.token == approval.token:
            raise GateRefused("a client may not answer its own request, nor one of its token", key)
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
        self.end(approval, _ApprovalState.APPROVED)
        self._recorder.note("approved", approval.act, approval.name, by, f"{id} of {approval.client}", key)
        self._forget_expired()
        now = self.clock.monotonic()
        if seconds:
            self._granted[approval.subject] = (now + seconds, False)
        elif approval.go is None:
            # The client has to send it again, within the timeout of the request.
            self._granted[approval.subject] = (now + settings.seconds, True)
        approval.client.tell_approval(f"{approval.act} {approval.name}: approved (id {id})")
        if approval.go is not None:
            approval.go()
        return f"approved: {what}"

    def expire(self, approval: Approval) -> None:
        """Deny a request after its timeout."""
        self._deny(approval, None, f"no answer within {approval.settings.seconds:g} s")

    def _deny(self, approval: Approval, by: Actor | None, why: str) -> None:
        self.end(approval, _ApprovalState.DENIED)
        client, act, name, rule = approval.subject[:4]
        reason = f"{approval.id} of {client}: {why}"
        self._recorder.note("denied", act, name, by, reason, rule, about=client)
        text = f"{act} {name}: {why} ({rule}.approval)"
        if approval.refuse is not None:
            approval.refuse(text)
        else:
            client.tell_approval(f"{text}, id {approval.id}")

    def end(self, approval: Approval, state: _ApprovalState) -> None:
        """Remove a pending request, which gets its final state."""
        approval.become(state)
        del self._pending[approval.id]
        if self._asked.get(approval.subject[:-1]) is approval:
            del self._asked[approval.subject[:-1]]
        self._counts[approval.slot] -= 1
        if not self._counts[approval.slot]:
            del self._counts[approval.slot]
        approval.timer.cancel()
        self._on_change()

    def leave(self, client: Actor) -> None:
        """Deny the requests of a client that leaves, and drop its approvals."""
        for approval in [each for each in self._pending.values() if each.client is client]:
            self._deny(approval, None, "the client has left")
        self._granted = {key: held for key, held in self._granted.items() if key.client is not client}

    def drop(self, concerns: Callable[[Subject], bool], why: str) -> Iterator[None]:
        """Drop the approvals of some subjects, and deny the requests about them, a step each."""
        self._granted = {key: held for key, held in self._granted.items() if not concerns(key)}
        for approval in [each for each in self._pending.values() if concerns(each.subject)]:
            if approval.is_pending:
                self._deny(approval, None, why)
            yield

    def _forget_expired(self) -> None:
        now = self.clock.monotonic()
        self._granted = {key: held for key, held in self._granted.items() if held[0] > now}


def _shown(digest: str, fields: str, payload: Payload) -> str:
    """Return a message as shown to a person: what identifies it and what matters comes before the text."""
    about = f"sha256:{digest[:_SHOWN_DIGITS]}, {payload.size} bytes"
    if fields:
        about += f"; {fields}"
    text = bytes(payload.json()).decode()
    text = "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)
    if len(text) > _MAX_CONTENT:
        text = f"{text[:_MAX_CONTENT]}… (cut off)"
    return f"{about}; {text}"
