"""Clients as the gate knows them, and the record of what they do."""

from __future__ import annotations

import logging
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final, Literal, Protocol, get_args

from rwt.access.audit import one_line
from rwt.access.quotas import RateLimit
from rwt_transports.http.addresses import network_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.audit import Audit
    from rwt.access.gate.audit_file import AuditFile
    from rwt.access.roles import Role
    from rwt_graph.clock import Clock

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
    "left out",
]
"""Outcome of an act at the gate; `lease` and `stop`: a change of state."""

DECISIONS: Final[tuple[Decision, ...]] = get_args(Decision)

#: Limit on lines about rejections and changes caused by one client: sustained rate, and burst.
_LINES_PER_SECOND: Final = 20
_LINES_BURST: Final = 200


class ActorTopic(Protocol):
    """Guarded topic, as its clients know it."""

    name: str

    def leave(self, client: Actor, why: str) -> None:
        """Remove a client that no longer publishes here, and release its lease."""


class Actor:
    """Client as the gate knows it.

    Attributes:
        name: unique name on this server, such as `rosbridge:3`.
        rights: present role.
        address: network address; empty if unknown.
        lines: limit on the audit lines that its rejections cause.
        left_out: number of lines over the limit since the last one that was written.
        topics: guarded topics that it publishes on or has held.
        on_notice: called with what the gate did to its command, such as clamping; None: it is not told.
    """

    __slots__ = ("address", "left_out", "lines", "name", "on_notice", "rights", "topics")

    def __init__(self, name: str, rights: Role, address: str) -> None:
        self.name = name
        self.rights = rights
        self.address = address
        self.lines = RateLimit(_LINES_PER_SECOND, _LINES_BURST)
        self.left_out = 0
        self.topics: set[ActorTopic] = set()
        self.on_notice: Callable[[str], None] | None = None

    @property
    def role(self) -> str:
        """Name of the present role."""
        return self.rights.name

    @property
    def owner(self) -> str:
        """Identity whose clients share limits: the name of the credential, or the address without one."""
        return self.rights.credential or f"@{network_of(self.address)}"

    def __str__(self) -> str:
        return f"{self.name} (role {self.role})"


CALLER: Final[ContextVar[Actor | None]] = ContextVar("caller of the gate", default=None)
"""Client on whose behalf a service of the gate runs; None: a program of the robot itself."""


class Recorder:
    """Record of what happens at the gate: the audit file, if there is one, the server's log, and counters.

    Attributes:
        counts: number of events by decision.

    Args:
        file: audit file; None for none.
        audit: log of the server.
        clock: clock of the graph.
    """

    __slots__ = ("_audit", "_clock", "_file", "counts")

    def __init__(self, file: AuditFile | None, audit: Audit, clock: Clock) -> None:
        self._file = file
        self._audit = audit
        self._clock = clock
        self.counts: dict[Decision, int] = dict.fromkeys(DECISIONS, 0)

    @property
    def keeps_all(self) -> bool:
        """True if acts without a rule are recorded, too."""
        return self._file is not None

    def note(
        self,
        decision: Decision,
        act: str,
        name: str,
        client: Actor | None,
        text: str = "",
        rule: str = "",
    ) -> None:
        """Record one event.

        Args:
            decision: outcome of the act.
            act: act, such as `publish`.
            name: name of the topic, service, action or parameter.
            client: client that acted; None: a program of the robot itself, or the gate.
            text: reason, or what changed.
            rule: key of the rule that decided.
        """
        self.counts[decision] += 1
        is_bounded = decision in ("refused", "would refuse", "changed")
        if is_bounded and client is not None:
            if not client.lines.take(self._clock.monotonic()):
                client.left_out += 1
                return
            if client.left_out:
                left_out, client.left_out = client.left_out, 0
                self._write("left out", act, name, client, f"{left_out} lines about this client", "")
        self._write(decision, act, name, client, text, rule)
        if decision == "would refuse" or decision in ("lease", "stop", "approved", "denied"):
            who = "the robot" if client is None else str(client)
            self._audit.write(
                logging.WARNING if decision in ("stop", "would refuse") else logging.INFO,
                "gate: %s: %s by %s: %s", decision, f"{act} {name}".rstrip(), who, one_line(text),
            )  # fmt: skip

    def _write(self, decision: str, act: str, name: str, client: Actor | None, text: str, rule: str) -> None:
        if self._file is None:
            return
        moment = datetime.fromtimestamp(self._clock.time_ns() / 1e9, UTC)
        line: dict[str, object] = {
            "time": moment.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "decision": decision,
            "act": act,
            "name": name,
        }
        if client is not None:
            line |= {"client": client.name, "role": client.role, "address": client.address}
        if rule:
            line["rule"] = rule
        if text:
            line["text"] = text[:2000]
        self._file.write(line)
