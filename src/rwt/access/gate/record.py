"""Clients as the gate knows them, and the record of what they do."""

from __future__ import annotations

import logging
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final, Literal, get_args

from rwt.access.audit import Audit, one_line
from rwt.access.gate.audit.file import AuditFile, encode
from rwt_transports.http.addresses import network_of
from rwt_transports.limits import RateLimit

if TYPE_CHECKING:
    from rwt.access.gate.topic import GuardedTopic
    from rwt.access.roles import Role
    from rwt.access.settings import AuditSettings
    from rwt_graph.clock import Clock
    from rwt_participant.timers import Timer

Decision = Literal[
    "allowed",
    "refused",
    "would refuse",
    "changed",
    "asked",
    "approved",
    "denied",
    "lease",
    "stop",
    "reload",
    "left out",
    "opened",
    "closed",
]
"""Outcome of an act at the gate; `lease`, `stop` and `reload`: a change of state; the last three are
about the audit itself."""

DECISIONS: Final[tuple[Decision, ...]] = get_args(Decision)

#: Decisions that say what was let through. They have a file of their own.
_TRAFFIC: Final = frozenset({"allowed", "changed"})

#: Decisions of which repetitions are counted, instead of a line for each.
_COUNTED: Final = frozenset({"allowed", "changed", "refused", "would refuse"})

_LOGGED: Final = frozenset({"would refuse", "lease", "stop", "approved", "denied"})

#: Interval in seconds at which repeated events are written with their number.
_REPEAT_SECONDS: Final = 10.0

#: Number of events of a kind that are written at once; the others of the interval are counted.
_MAX_LINES: Final = 5

#: Maximum number of different events whose repetitions are counted, of all clients and of one source.
_MAX_REPEATED: Final = 4000
_MAX_REPEATED_OF_SOURCE: Final = 200

#: Time in which two credentials that write all they may fill the files: those of events, and of traffic.
_KEEP_EVENTS_SECONDS: Final = 7 * 86_400.0
_KEEP_TRAFFIC_SECONDS: Final = 86_400.0

#: Bytes that the numbers and hashes add to a line.
_CHAIN_BYTES: Final = 140

#: Size of a line about events that were left out, in bytes.
_LEFT_OUT_BYTES: Final = 500

Source = tuple[str, str]
"""Source of events: the name of a credential, and a network address."""

OTHERS: Final[Source] = ("", "others")
"""Source that is charged for those above the maximum number."""

#: Maximum number of sources with a budget of their own.
_MAX_SOURCES: Final = 1000

#: Fraction of a file that one source may fill at once.
_SOURCE_FRACTION: Final = 1 / 8

#: Number of sources that one credential may be, each with all of its budget.
_SOURCES_OF_CREDENTIAL: Final = 4

#: Smallest burst in bytes, where files are tiny.
_MIN_BURST_BYTES: Final = 16 * 1024

#: Source of what the robot's own programs and the gate itself do; no client shares its budget.
_ROBOT: Final = ("/gate", "")

_MAX_NAME: Final = 500
_MAX_TEXT: Final = 2000
_MAX_VALUE_BYTES: Final = 2000


Value = object | Callable[[], object]
"""Value of an audit line, or a function that returns it."""


@dataclass(slots=True, eq=False, repr=False)
class Actor:
    """Client as the gate knows it.

    Attributes:
        name: unique name on this server, such as `rosbridge:3`.
        device: program and system, such as `Firefox, Android`, or the address; for people.
        rights: present role.
        address: network address; empty if unknown.
        topics: guarded topics that it publishes on or has held.
        on_notice: called with what the gate did to its command, such as clamping; None: it is not told.
        on_approval: called when a command begins to wait for approval, and with the answer; None: it is not
            told.
    """

    name: str
    rights: Role
    address: str
    device: str = ""
    topics: set[GuardedTopic] = field(default_factory=set)
    on_notice: Callable[[str], None] | None = None
    on_approval: Callable[[str], None] | None = None

    def __post_init__(self) -> None:
        self.device = self.device or self.address

    def tell_approval(self, text: str) -> None:
        """Tell the client about its request for approval, if it wants that."""
        if self.on_approval is not None:
            self.on_approval(text)

    @property
    def role(self) -> str:
        """Name of the present role."""
        return self.rights.name

    @property
    def owner(self) -> str:
        """Identity whose clients share limits: the name of the token, or the address without one."""
        return self.rights.token or f"@{network_of(self.address)}"

    @property
    def credential(self) -> str:
        """Name of the token that gave the role, or `rosauth`; empty for a client without credentials."""
        return self.rights.credential

    @property
    def token(self) -> str:
        """Name of the token that gave the role; empty for a client that nothing identifies."""
        return self.rights.token

    def __str__(self) -> str:
        return f"{self.name} (role {self.role})"


CALLER: Final[ContextVar[Actor | None]] = ContextVar("caller of the gate", default=None)
"""Client on whose behalf a service of the gate runs; None: a program of the robot itself."""


@dataclass(slots=True, eq=False)
class _Repeated:
    """Repetitions of one event since its last line."""

    line: dict[str, object]
    source: Source
    since: float
    lines: int = 1
    count: int = 0


class AuditBudget:
    """Budget of one kind of lines, for each source and for each credential.

    A source gets an eighth of a file at once, then an eighth of all files in `keep_seconds`; a credential
    four times as much. So one credential needs nearly twice that time to rotate away what others did. What
    exceeds the budget is counted by decision.

    Args:
        keep_seconds: time in which two credentials that write all they may fill the files.
    """

    def __init__(self, file_bytes: int, files: int, keep_seconds: float) -> None:
        self._burst = max(file_bytes * _SOURCE_FRACTION, _MIN_BURST_BYTES)
        self._rate = file_bytes * max(files - 1, 0.5) / keep_seconds * _SOURCE_FRACTION
        self._sources: dict[Source, RateLimit] = {}
        times = _SOURCES_OF_CREDENTIAL
        self._credentials = defaultdict[str, RateLimit](
            lambda: RateLimit(self._rate * times, self._burst * times)
        )
        self._left_out: dict[Source, Counter[str]] = {}

    def take(self, source: Source, size: int, now: float) -> bool:
        """Return True if a line of this size may be written; `now` in seconds on a monotonic clock."""
        bucket = self._bucket_of(source, now)
        if not bucket.take(now, size):
            return False
        if not self._credentials[source[0]].take(now, size):
            bucket.give_back(size)
            return False
        return True

    def _bucket_of(self, source: Source, now: float) -> RateLimit:
        bucket = self._sources.get(source)
        if bucket is None and len(self._sources) >= _MAX_SOURCES:
            self._sources = {each: left for each, left in self._sources.items() if not left.is_full(now)}
            if len(self._sources) >= _MAX_SOURCES:
                source = OTHERS
                bucket = self._sources.get(source)
        if bucket is None:
            bucket = self._sources[source] = RateLimit(self._rate, self._burst)
        return bucket

    def leave_out(self, source: Source, decision: str, count: int = 1) -> None:
        """Count events that are over the budget."""
        if source not in self._left_out and len(self._left_out) >= _MAX_SOURCES:
            source = OTHERS
        self._left_out.setdefault(source, Counter())[decision] += count

    @property
    def has_left_out(self) -> bool:
        """True if events were counted that no line states yet."""
        return bool(self._left_out)

    def take_left_out(self, size: int, now: float, *, at_end: bool) -> Iterator[tuple[Source, Counter[str]]]:
        """Yield the counted events of each source whose budget admits a line again.

        Args:
            size: size of such a line.
            now: seconds on a monotonic clock.
            at_end: True to yield all of them: the audit is closed.
        """
        for source in tuple(self._left_out):
            if at_end or self.take(source, size, now):
                yield source, self._left_out.pop(source)


class Recorder:
    """Record of what happens at the gate: the audit, if there is one, the server's log, and counters.

    The first events of a kind are written at once: their texts may differ. Further ones of the same source
    within 10 seconds are counted, and written as one line. Each source, a credential at an address, has a
    budget of bytes (:class:`AuditBudget`).

    Attributes:
        counts: number of events by decision.

    Raises:
        OSError: the audit file cannot be opened.
    """

    __slots__ = ("_audit", "_budgets", "_clock", "_file", "_of_source", "_repeated", "_timer", "counts")

    def __init__(self, settings: AuditSettings, audit: Audit, clock: Clock) -> None:
        self._file = AuditFile(settings) if settings.is_on else None
        self._audit = audit
        self._clock = clock
        self._budgets = tuple(
            AuditBudget(settings.file_bytes, settings.files, seconds)
            for seconds in (_KEEP_EVENTS_SECONDS, _KEEP_TRAFFIC_SECONDS)
        )
        self._repeated: dict[tuple[object, ...], _Repeated] = {}
        self._of_source: Counter[Source] = Counter()
        self._timer: Timer | None = None
        self.counts: dict[Decision, int] = dict.fromkeys(DECISIONS, 0)
        if self._file is not None:
            self._file.write(encode(self._line("opened", "audit", "")))

    @property
    def keeps_all(self) -> bool:
        """True if acts without a rule are recorded, too."""
        return self._file is not None

    @property
    def dropped_lines(self) -> int:
        """Number of lines that could not be written."""
        return 0 if self._file is None else self._file.dropped

    @property
    def problems(self) -> tuple[str, ...]:
        """Reason why the audit cannot be written at present; empty if it can."""
        reason = "" if self._file is None else self._file.failure
        return (f"audit: {reason}",) if reason else ()

    def note(
        self,
        decision: Decision,
        act: str,
        name: str,
        client: Actor | None,
        text: str = "",
        rule: str = "",
        *,
        before: Value = None,
        after: Value = None,
        about: Actor | None = None,
    ) -> None:
        """Record one event.

        Args:
            act: act, such as `publish`.
            name: name of the topic, service, action or parameter.
            client: client that acted; None: a program of the robot itself, or the gate.
            text: reason, or what changed.
            rule: key of the rule that decided.
            before: value before the event, or a function that returns it, called only if it is written.
            after: value after it.
            about: client that caused what the gate does itself; its budget is charged.
        """
        self.counts[decision] += 1
        if decision in _LOGGED:
            self._log(decision, act, name, client, text)
        if self._file is None:
            return
        payer = client or about
        source = _ROBOT if payer is None else (payer.credential, network_of(payer.address))
        key = (source, decision, act, name, rule)
        is_counted = decision in _COUNTED and act != "set_param"  # Each value of a parameter matters.
        repeated = self._repeated.get(key) if is_counted else None
        if repeated is not None:
            repeated.lines += 1
            if repeated.lines > _MAX_LINES:
                repeated.count += 1
                return
        line = self._line(decision, act, _text(name, _MAX_NAME)) | _members_of(client)
        if rule:
            line["rule"] = rule
        if text:
            line["text"] = _text(text, _MAX_TEXT)
        for what, value in (("before", before), ("after", after)):
            given = value() if callable(value) else value
            if given is not None:
                line[what] = bounded(given)
        is_written = self._put(line, decision, source)
        if is_written and is_counted and repeated is None and len(name) <= _MAX_NAME:
            is_full = len(self._repeated) >= _MAX_REPEATED
            if not is_full and self._of_source[source] < _MAX_REPEATED_OF_SOURCE:
                self._repeated[key] = _Repeated(line, source, self._clock.monotonic())
                self._of_source[source] += 1
        if self._timer is None and (self._repeated or any(each.has_left_out for each in self._budgets)):
            self._timer = self._clock.call_later(_REPEAT_SECONDS, self._flush)

    def _log(self, decision: Decision, act: str, name: str, client: Actor | None, text: str) -> None:
        """Write one event to the server's log."""
        if decision == "stop":
            # A press names the client already; a fault has the name of what was not stopped.
            event = one_line(f"{name}: {text}" if name else text)
        else:
            who = "the robot" if client is None else str(client)
            event = f"{one_line(f'{act} {name}'.rstrip())} by {one_line(who)}: {one_line(text)}"
        self._audit.write(
            logging.WARNING if decision in ("stop", "would refuse") else logging.INFO,
            "gate: %s: %s", decision, event, client=None if client is None else client.name,
        )  # fmt: skip

    def _line(self, decision: Decision, act: str, name: str) -> dict[str, object]:
        return {"time": self._time(), "decision": decision, "act": act, "name": name}

    def _time(self) -> str:
        moment = datetime.fromtimestamp(self._clock.time_ns() / 1e9, UTC)
        return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")

    def _put(self, line: Mapping[str, object], decision: str, source: Source, count: int = 1) -> bool:
        """Write a line if the budget of its source admits it; otherwise count its events."""
        assert self._file is not None  # Checked by the caller.
        data = encode(line)
        is_traffic = decision in _TRAFFIC
        budget = self._budgets[is_traffic]
        if not budget.take(source, len(data) + _CHAIN_BYTES, self._clock.monotonic()):
            budget.leave_out(source, decision, count)
            return False
        self._file.write(data, is_traffic=is_traffic)
        return True

    def _flush(self, *, at_end: bool = False) -> None:
        """Write the numbers of repeated events and of those over the budget."""
        assert self._file is not None  # Only then events are counted.
        self._timer = None
        now = self._clock.monotonic()
        repeated, self._repeated = self._repeated, {}
        self._of_source.clear()
        for each in repeated.values():
            if each.count:
                seconds = round(now - each.since, 1)
                times = "once" if each.count == 1 else f"{each.count} times"
                text = f"repeated {times} in {seconds:g} s"
                moment = self._time()
                line = {**each.line, "time": moment, "text": text, "repeated": each.count}
                line.pop("before", None)  # Those of the first event.
                line.pop("after", None)
                self._put(line, str(each.line["decision"]), each.source, each.count)
        for is_traffic, budget in enumerate(self._budgets):
            for (credential, network), counts in budget.take_left_out(_LEFT_OUT_BYTES, now, at_end=at_end):
                line = self._line("left out", "", "")
                text = ", ".join(f"{count} {decision}" for decision, count in counts.items())
                line |= {"credential": credential, "address": network, "text": f"over the budget: {text}"}
                self._file.write(encode(line), is_traffic=bool(is_traffic))
        if not at_end and any(each.has_left_out for each in self._budgets):
            self._timer = self._clock.call_later(_REPEAT_SECONDS, self._flush)

    def close(self) -> None:
        """Write what was counted, and flush the audit file."""
        if self._timer is not None:
            self._timer.cancel()
        if self._file is not None:
            self._flush(at_end=True)
            self._file.write(encode(self._line("closed", "audit", "")))
            self._file.close()


def _members_of(client: Actor | None) -> dict[str, object]:
    """Return the members of a line that name the client; none for the robot itself."""
    if client is None:
        return {}
    line: dict[str, object] = {
        "client": _text(client.name, _MAX_NAME),
        "role": client.role,
        "address": client.address,
    }
    if client.credential:
        line["credential"] = client.credential
    return line


def _text(text: str, limit: int) -> str:
    """Return a text as it is written: truncated, and valid in UTF-8."""
    return text[:limit].encode(errors="backslashreplace").decode()


def bounded(value: object) -> object:
    """Return a value as it is written: as JSON, truncated if it is long."""
    text = encode(value)
    return value if len(text) <= _MAX_VALUE_BYTES else f"{text[:_MAX_VALUE_BYTES].decode(errors='ignore')}…"
