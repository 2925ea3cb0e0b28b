"""Models and reader of scripts in TOML. Errors name the file, the key and the expected value."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from rwt.extensions.testing.errors import ScriptError, instead
from rwt_protocol.error_text import annotation_at, but_got, expected, first_error, locate, model_in

Fields: TypeAlias = Mapping[str, Any]
"""Message, or some of its fields. Checked against its ROS type, not by this model."""

Seconds = Annotated[float, Field(ge=0, le=1_000_000_000, allow_inf_nan=False)]
PositiveNumber = Annotated[float, Field(ge=0.001, le=1_000_000, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=10**9)]
AtLeastOne = Annotated[int, Field(ge=1, le=10**9)]


class ScriptTable(BaseModel):
    """Table of the file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Recorded(ScriptTable):
    """Message with its time."""

    at: Annotated[Seconds, Field(description="seconds of the robot's clock from the beginning")]
    msg: Annotated[Fields, Field(description="the message")]


def _only_one(table: ScriptTable, keys: tuple[str, ...]) -> list[str]:
    given = [key for key in keys if key in table.model_fields_set]
    if len(given) > 1:
        raise ValueError(f"expected one of {' and '.join(f'`{key}`' for key in given)}, not both")
    return given


class TopicScript(ScriptTable):
    """Topic. Without `latched`, `messages`, `recorded` and `file`, it only has a type."""

    type: Annotated[str, Field(description="message type, for example `std_msgs/String`")]
    latched: Annotated[
        Fields | None, Field(description="a message that every subscriber gets, however late it comes")
    ] = None
    messages: Annotated[
        list[Fields],
        Field(description="messages published one after the other: by `rate`, or by `/rwt_script/next`"),
    ] = []
    rate: Annotated[
        PositiveNumber | None, Field(description="of `messages`, how many are published each second")
    ] = None
    recorded: Annotated[
        list[Recorded], Field(description="messages at their own times: `{ at = 0.5, msg = {…} }`")
    ] = []
    file: Annotated[
        str | None,
        Field(
            description='file of recorded messages beside the script, a line each: `{"at": 0.5, "msg": {…}}`'
        ),
    ] = None
    repeat: Annotated[
        bool | None,
        Field(description="begin again at the end; by default `messages` do, and recorded ones do not"),
    ] = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _only_one(self, ("latched", "messages", "recorded", "file"))
        if self.rate is not None and not self.messages:
            raise ValueError("`rate` needs `messages`")
        return self


_ANSWERS = ("returns", "fails", "never_answers")


class AnswerScript(ScriptTable):
    """Answer to a call."""

    returns: Annotated[
        Fields | list[Fields] | None,
        Field(description="the response, or several, for one call after the other"),
    ] = None
    fails: Annotated[str | None, Field(description="fail, with this text")] = None
    never_answers: Annotated[bool, Field(description="leave the caller waiting")] = False
    after: Annotated[Seconds, Field(description="seconds of the robot's clock that an answer takes")] = 0.0


class CaseScript(AnswerScript):
    """Answer to matching requests."""

    request: Annotated[Fields, Field(description="fields of the request and their values")]

    @model_validator(mode="after")
    def _answered(self) -> Self:
        if not _only_one(self, _ANSWERS):
            raise ValueError("expected one of `returns`, `fails` and `never_answers`")
        return self


class ServiceScript(AnswerScript):
    """Service and its answers; the first matching case in `when` answers."""

    type: Annotated[str, Field(description="service type, for example `std_srvs/SetBool`")]
    when: Annotated[
        list[CaseScript], Field(description="answers to some requests, each with a `request`")
    ] = []

    @model_validator(mode="after")
    def _answered(self) -> Self:
        if not _only_one(self, _ANSWERS) and not self.when:
            raise ValueError("expected one of `returns`, `fails`, `never_answers` and `when`")
        return self


class ActionScript(ScriptTable):
    """Action and the course of its goals. By default they succeed with a default result."""

    type: Annotated[str, Field(description="action type, for example `example_interfaces/Fibonacci`")]
    feedback: Annotated[list[Fields], Field(description="sent to each goal, in this order")] = []
    every: Annotated[Seconds, Field(description="seconds before each feedback")] = 0.1
    after: Annotated[Seconds, Field(description="seconds before the end")] = 0.0
    succeeds: Annotated[Fields | None, Field(description="the result of a goal that succeeds")] = None
    aborts: Annotated[Fields | None, Field(description="the result of a goal that is aborted")] = None
    rejects: Annotated[str | None, Field(description="accept no goal, and say why")] = None
    never_ends: Annotated[bool, Field(description="let goals run until they are canceled")] = False
    ignores_cancel: Annotated[bool, Field(description="go on when somebody asks to cancel")] = False

    @model_validator(mode="after")
    def _one_end(self) -> Self:
        _only_one(self, ("succeeds", "aborts", "rejects", "never_ends"))
        return self


class FaultScript(ScriptTable):
    """Fault: one of `drop`, `delay`, `duplicate`, `refuse` and `slow_reader`."""

    drop: Annotated[str | None, Field(description="glob of topics, services or actions to lose")] = None
    delay: Annotated[str | None, Field(description="glob of what comes late, by `seconds`")] = None
    seconds: Annotated[Seconds | None, Field(description="of a `delay`")] = None
    duplicate: Annotated[str | None, Field(description="glob of what comes `copies` times")] = None
    copies: Annotated[int, Field(ge=2, le=1000, description="of a `duplicate`")] = 2
    refuse: Annotated[
        int | None, Field(ge=400, le=599, description="HTTP status with which clients are refused")
    ] = None
    slow_reader: Annotated[
        PositiveNumber | None, Field(description="messages a second that each client reads")
    ] = None
    op: Annotated[str, Field(description="only ops that match this glob")] = "*"
    to: Annotated[
        Literal["client", "server", "both"], Field(description="only messages to the client or the server")
    ] = "both"
    count: Annotated[Count | None, Field(description="how many at most; not set: all")] = None
    every: Annotated[AtLeastOne, Field(description="only each so-manieth")] = 1

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if not _only_one(self, ("drop", "delay", "duplicate", "refuse", "slow_reader")):
            raise ValueError("expected one of `drop`, `delay`, `duplicate`, `refuse` and `slow_reader`")
        if (self.delay is None) != (self.seconds is None):
            raise ValueError("expected `delay` and `seconds` together")
        return self


class Script(ScriptTable):
    """Script file."""

    name: Annotated[str, Field(description="name of the robot's node")] = "robot"
    parameters: Annotated[Mapping[str, Any], Field(description="parameters and their values")] = {}
    topics: Annotated[Mapping[str, TopicScript], Field(description="topics by name")] = {}
    services: Annotated[Mapping[str, ServiceScript], Field(description="services by name")] = {}
    actions: Annotated[Mapping[str, ActionScript], Field(description="actions by name")] = {}
    faults: Annotated[
        list[FaultScript],
        Field(description="what goes wrong from the start; `/rwt_script/faults` switches it off and on"),
    ] = []


def read_script(file: Path) -> Script:
    """Read a script.

    Raises:
        ScriptError: the file cannot be read, or has an unknown key or an invalid value.
    """
    text = _text(file)
    try:
        values = tomllib.loads(text)
    except RecursionError:
        raise ScriptError(f"{file}: tables or lists are nested too deeply") from None
    except ValueError as error:  # TOMLDecodeError, or a number with thousands of digits.
        raise ScriptError(f"{file}: not TOML: {error}") from None
    try:
        return Script.model_validate(values)
    except ValidationError as error:
        raise ScriptError(f"{file}: {_explain(error)}") from None


def read_recorded(file: Path) -> list[Recorded]:
    """Read recorded messages, one JSON object per line; empty lines are skipped.

    Raises:
        ScriptError: the file cannot be read, or a line is invalid.
    """
    lines = _text(file).splitlines()
    return [_line(file, number, line) for number, line in enumerate(lines, 1) if line.strip()]


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise ScriptError(f"{file}: {error.strerror or 'cannot be read'}") from None
    except UnicodeDecodeError as error:
        raise ScriptError(f"{file}: not UTF-8 at byte {error.start}") from None


def _line(file: Path, number: int, line: str) -> Recorded:
    try:
        return Recorded.model_validate(json.loads(line))
    except ValidationError as error:
        raise ScriptError(f"{file}:{number}: {_explain(error, Recorded)}") from None
    except (ValueError, RecursionError):  # JSONDecodeError, or a number with thousands of digits.
        raise ScriptError(
            f'{file}:{number}: not JSON; expected {{"at": seconds, "msg": {{…}}}} on each line'
        ) from None


def dotted(key: Sequence[str | int]) -> str:
    """Format a key like TOML: ``topics."/odom".messages[1]``."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
            continue
        bare = part.isascii() and part.replace("-", "_").isidentifier()
        text += ("." if text else "") + (part if bare else json.dumps(part, ensure_ascii=False))
    return text


def _explain(error: ValidationError, model: type[BaseModel] = Script) -> str:
    first = first_error(error)
    key, annotation = locate(model, first["loc"])
    if first["type"] == "extra_forbidden":
        table = model_in(annotation_at(model, key[:-1]))
        known = table.model_fields if table else ()
        return f"unknown key `{dotted(key)}`; {instead(str(key[-1]), known)}"
    if first["type"] == "value_error":
        text = str(first["ctx"]["error"])
        return f"`{dotted(key)}`: {text}" if key else text
    return f"`{dotted(key)}`: expected {expected(annotation)}{but_got(first)}"
