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
    """Lets one client at a time publish on the topics of a rule, as long as its messages come."""

    seconds: Annotated[
        LeaseSeconds,
        Field(description="silence of the holder after which the robot is stopped, and the lease is free"),
    ] = 0.5
    take: Annotated[
        Literal["publish", "service"],
        Field(description="how a client takes a free lease: by publishing, or only by `/gate/take_lease`"),
    ] = "publish"
    precedence: Annotated[
        tuple[str, ...],
        Field(
            description="roles that take the lease from those after them, the strongest first; roles that are"
            " not named are the weakest"
        ),
    ] = ()


class StopMessageSettings(Table):
    """The message that makes the robot stand still, which the gate itself publishes."""

    message: Annotated[
        Mapping[str, object],
        Field(description="its fields; those left out have their defaults, which for a velocity is zero"),
    ] = Field(default_factory=dict)
    repeat_seconds: Annotated[
        RepeatSeconds,
        Field(description="how long it is published again: longer than the robot's own time-out"),
    ] = 1.0


class FieldLimit(Table):
    """What a field may hold."""

    min: Annotated[Number | None, Field(description="the smallest number")] = None
    max: Annotated[Number | None, Field(description="the largest number")] = None
    rate: Annotated[
        Annotated[float, Field(gt=0, allow_inf_nan=False)] | None,
        Field(
            description="by how much the number may move away from that of the stop message in a second, on"
            " topics; towards it, it may move at once"
        ),
    ] = None
    one_of: Annotated[tuple[str, ...], Field(description="the texts that are taken, such as frame ids")] = ()
    beyond: Annotated[
        Literal["refuse", "clamp"],
        Field(description="whether a message beyond the limit is refused, or its number brought within"),
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
    """Asks a person before anything of a rule happens."""

    roles: Annotated[Globs, Field(min_length=1, description="roles that may say yes")]
    seconds: Annotated[
        ApprovalSeconds, Field(description="time in which somebody has to; after it the answer is no")
    ] = 60.0
    remember_seconds: Annotated[
        RememberSeconds,
        Field(description="the longest time for which one yes may hold; 0: each yes is for one act"),
    ] = 0.0


class GateRule(Table):
    """What clients have to keep to, on what the globs name. Of several rules that fit, each holds."""

    topics: Annotated[Globs, Field(description="topics that clients publish on")] = ()
    services: Annotated[Globs, Field(description="services that clients call")] = ()
    actions: Annotated[Globs, Field(description="actions that clients send goals to")] = ()
    parameters: Annotated[
        Globs, Field(description="parameters that clients set: `/node:name` on ROS 2, `/name` on ROS 1")
    ] = ()
    roles: Annotated[Globs, Field(description="roles for which the rule holds")] = ("*",)
    emergency: Annotated[
        bool, Field(description="whether the emergency stop ends and refuses all of this")
    ] = False
    lease: LeaseSettings | None = None
    stop: StopMessageSettings | None = None
    fields: Mapping[FieldPath, FieldLimit] = Field(
        default_factory=dict,
        description="limits of fields of the message, the request or the goal, each under its path",
    )
    finite: Annotated[bool, Field(description="whether NaN and infinity are refused")] = True
    largest_bytes: Annotated[
        CountOrNone, Field(description="bytes of the largest message, request or goal; 0 for any size")
    ] = 0
    messages_per_second: Annotated[
        CountOrNone, Field(description="messages a second on each topic, of all clients; 0 for any number")
    ] = 0
    approval: ApprovalSettings | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> GateRule:
        if not (self.topics or self.services or self.actions or self.parameters):
            raise ValueError("expected one of `topics`, `services`, `actions` and `parameters`")
        if not self.topics:
            for name in ("lease", "stop", "messages_per_second"):
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
    """The emergency stop: who may press it, and who may release it."""

    stop_roles: Annotated[Globs, Field(description="roles that may stop the robot")] = ("*",)
    release_roles: Annotated[Globs, Field(description="roles that may let it move again")] = ("admin",)
    at_start: Annotated[
        bool, Field(description="whether the server begins stopped, until somebody releases it")
    ] = False


class AuditSettings(Table):
    """The file of who did what to the robot: a JSON object a line, for `rwt audit`."""

    file: Annotated[Path | None, Field(description="the file; not set: nothing is written")] = None
    file_bytes: Annotated[Bytes, Field(description="size at which a new file is begun")] = 10 * MIB
    files: Annotated[
        Count, Field(le=1000, description="files kept, the newest without a number; older ones are deleted")
    ] = 5
    queue_bytes: Annotated[
        Bytes, Field(description="lines that wait for the disk; beyond it they are dropped, and counted")
    ] = MIB


class GateSettings(Table):
    """What clients' acts have to pass before they reach the robot. It is software and no safety function."""

    mode: Annotated[
        Literal["enforce", "observe"],
        Field(description="`observe` only says what would have been refused"),
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
