"""Settings of the gate, as models without behaviour."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field, model_validator

from rwt.access.settings.types import MIB, Bytes, Count, CountOrNone, Globs, Table

_PART: Final = r"[A-Za-z][A-Za-z0-9_]*(?:\[\])?"
_PATH: Final = re.compile(rf"{_PART}(?:\.{_PART})*")


def _field_path(path: str) -> str:
    if _PATH.fullmatch(path) is None:
        raise ValueError(
            f"expected the way to a field, as `linear.x` or `points[].positions[]`, got {path!r}"
        )
    return path


FieldPath = Annotated[str, AfterValidator(_field_path)]
"""The way from a message to one of its fields; `[]` stands for every item of a list."""

Number = Annotated[float, Field(allow_inf_nan=False)]
LeaseSeconds = Annotated[float, Field(ge=0.05, le=60.0)]
RepeatSeconds = Annotated[float, Field(ge=0.0, le=60.0)]
ApprovalSeconds = Annotated[float, Field(ge=1.0, le=3600.0)]
RememberSeconds = Annotated[float, Field(ge=0.0, le=86_400.0)]


class LeaseSettings(Table):
    """One client at a time may publish on the topics of the rule, as long as its messages continue."""

    seconds: Annotated[
        LeaseSeconds,
        Field(
            description="seconds of silence after which the holder's robot is stopped and the lease is free"
        ),
    ] = 0.5
    take: Annotated[
        Literal["publish", "service"],
        Field(description="how to take a free lease: by publishing, or only by `/gate/take_lease`"),
    ] = "publish"
    precedence: Annotated[
        tuple[str, ...],
        Field(
            description="roles in order of precedence: each may take the lease from those after it; roles"
            " not listed come last"
        ),
    ] = ()


class StopMessageSettings(Table):
    """Message published by the gate to stop the robot."""

    message: Annotated[
        Mapping[str, object],
        Field(description="field values; omitted fields have their defaults (zero for a velocity)"),
    ] = Field(default_factory=dict)
    repeat_seconds: Annotated[
        RepeatSeconds,
        Field(
            description="seconds for which the message is repeated; choose more than the robot's own timeout"
        ),
    ] = 1.0


class FieldLimit(Table):
    """Limits for the value of a field."""

    min: Annotated[Number | None, Field(description="minimum")] = None
    max: Annotated[Number | None, Field(description="maximum")] = None
    rate: Annotated[
        Annotated[float, Field(gt=0, allow_inf_nan=False)] | None,
        Field(
            description="largest change per second away from the value of the stop message, on topics;"
            " towards that value there is no limit"
        ),
    ] = None
    one_of: Annotated[tuple[str, ...], Field(description="accepted strings, such as frame ids")] = ()
    beyond: Annotated[
        Literal["refuse", "clamp"],
        Field(description="reject a value out of range, or clamp it"),
    ] = "refuse"

    @model_validator(mode="after")
    def _limits_something(self) -> FieldLimit:
        has_number = self.min is not None or self.max is not None or self.rate is not None
        if not has_number and not self.one_of:
            raise ValueError("expected one of `min`, `max`, `rate` and `one_of`")
        if has_number and self.one_of:
            raise ValueError("`one_of` is for texts: expected it without `min`, `max` and `rate`")
        if self.one_of and self.beyond == "clamp":
            raise ValueError('a text cannot be brought within `one_of`: expected `beyond = "refuse"`')
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"`min` is {self.min:g}, and expected at most `max`, {self.max:g}")
        return self


class ApprovalSettings(Table):
    """Approval by a person before each request."""

    roles: Annotated[Globs, Field(min_length=1, description="roles that may approve")]
    seconds: Annotated[
        ApprovalSeconds, Field(description="seconds to approve; after them the request is rejected")
    ] = 60.0
    remember_seconds: Annotated[
        RememberSeconds,
        Field(
            description="longest time in seconds that one approval may cover; 0: each approval is for one"
            " request"
        ),
    ] = 0.0


class GateRule(Table):
    """Rule for the names that the globs match. If several rules match, all apply."""

    topics: Annotated[Globs, Field(description="topics that clients publish on")] = ()
    type: Annotated[
        str | None,
        Field(
            description="message type of `topics`; not set: that of the robot's programs, before which only"
            " roles that may do everything can advertise them"
        ),
    ] = None
    services: Annotated[Globs, Field(description="services that clients call")] = ()
    actions: Annotated[Globs, Field(description="actions that clients send goals to")] = ()
    parameters: Annotated[
        Globs, Field(description="parameters that clients set: `/node:name` on ROS 2, `/name` on ROS 1")
    ] = ()
    roles: Annotated[Globs, Field(description="roles to which the rule applies")] = ("*",)
    emergency: Annotated[bool, Field(description="stopped and rejected by the emergency stop")] = False
    lease: LeaseSettings | None = None
    stop: StopMessageSettings | None = None
    fields: Mapping[FieldPath, FieldLimit] = Field(
        default_factory=dict,
        description="limits of fields of the message, the request or the goal, each under its path",
    )
    finite: Annotated[bool, Field(description="reject NaN and infinity")] = True
    largest_bytes: Annotated[
        CountOrNone, Field(description="largest message, request or goal in bytes; 0: no limit")
    ] = 0
    largest_items: Annotated[
        Count,
        Field(
            description="items in all lists of the largest message whose fields or numbers are checked, and"
            " 32 times as many bytes: checking them holds the event loop"
        ),
    ] = 10_000
    messages_per_second: Annotated[
        CountOrNone,
        Field(description="messages per second on each topic, of all clients together; 0: no limit"),
    ] = 0
    approval: ApprovalSettings | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> GateRule:
        if not (self.topics or self.services or self.actions or self.parameters):
            raise ValueError("expected one of `topics`, `services`, `actions` and `parameters`")
        if not self.topics:
            for name in ("type", "lease", "stop", "messages_per_second"):
                if getattr(self, name):
                    raise ValueError(f"`{name}` is about topics: expected `topics`")
            if any(limit.rate is not None for limit in self.fields.values()):
                raise ValueError("`rate` is about topics: expected `topics`")
        if self.fields and not (self.topics or self.services or self.actions):
            raise ValueError("`fields` are those of messages: expected `topics`, `services` or `actions`")
        if self.topics and self.stop is None and (self.lease or self.emergency):
            raise ValueError(
                "`lease` and `emergency` need a stop message for `topics`: expected `stop`, as `stop = {}`"
            )
        return self


class EmergencySettings(Table):
    """Emergency stop: roles that may stop, and release."""

    stop_roles: Annotated[Globs, Field(description="roles that may stop the robot")] = ("*",)
    release_roles: Annotated[Globs, Field(description="roles that may release the stop")] = ("admin",)
    at_start: Annotated[bool, Field(description="start stopped, until the stop is released")] = False


class AuditSettings(Table):
    """Audit log: one JSON object per line, read by `rwt audit`."""

    file: Annotated[
        Path | None,
        Field(
            description="file of security events, for example `audit.jsonl`; allowed requests are written to"
            " `audit.traffic.jsonl` beside it; not set: no file"
        ),
    ] = None
    stdout: Annotated[
        bool, Field(description="also write the lines to standard output, for example for journald")
    ] = False
    file_bytes: Annotated[Bytes, Field(description="size in bytes at which a new file is started")] = 10 * MIB
    file_days: Annotated[
        float,
        Field(ge=0, le=36_500, description="age in days at which a new file is started; 0: by size only"),
    ] = 0.0
    files: Annotated[
        Count,
        Field(
            le=1000,
            description="files to keep of each kind; the newest has no number, older ones are deleted",
        ),
    ] = 5
    queue_bytes: Annotated[
        Bytes, Field(description="bytes queued for the disk; beyond it, lines are dropped and counted")
    ] = MIB

    @property
    def is_on(self) -> bool:
        """True if lines are written."""
        return self.file is not None or self.stdout


class GateSettings(Table):
    """Rules that requests of clients must pass. The gate is software, not a safety function."""

    mode: Annotated[
        Literal["enforce", "observe"],
        Field(description="`observe` only logs what would be rejected"),
    ] = "enforce"
    rules: Mapping[str, GateRule] = Field(
        default_factory=dict, description="what clients have to keep to, each rule under a name of its own"
    )
    emergency: EmergencySettings = EmergencySettings()
    audit: AuditSettings = AuditSettings()

    def named_roles(self) -> Iterator[tuple[str, str]]:
        """The roles that rules name, by the key of the setting, without those that are globs."""
        globs = [
            ("gate.emergency.stop_roles", self.emergency.stop_roles),
            ("gate.emergency.release_roles", self.emergency.release_roles),
        ]
        for name, rule in self.rules.items():
            globs.append((f"gate.rules.{name}.roles", rule.roles))
            if rule.lease is not None:
                globs.append((f"gate.rules.{name}.lease.precedence", rule.lease.precedence))
            if rule.approval is not None:
                globs.append((f"gate.rules.{name}.approval.roles", rule.approval.roles))
        for key, roles in globs:
            for role in roles:
                if not re.search(r"[*?\[]", role):
                    yield key, role
