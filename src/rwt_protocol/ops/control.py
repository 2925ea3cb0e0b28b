"""Ops for the connection itself: fragment, png, set_level, status, auth."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from rwt_protocol.error_text import Expected
from rwt_protocol.errors import Level
from rwt_protocol.ops.base import (
    MOST,
    Count,
    Direction,
    Op,
    OpSpec,
    ReplyTo,
    RequiredId,
    SafeInteger,
    Text,
)

LevelName = Annotated[Level, Expected('"info", "warning", "error" or "none"')]


def _floor(value: object) -> object:
    """Round a number of fragments down: other servers write it as a fraction (FRG-23)."""
    return math.floor(value) if isinstance(value, float) and math.isfinite(value) else value


def _whole_seconds(value: object) -> object:
    """Return whole seconds from an integer, a float or ``{sec, nanosec}`` (AUT-02, AUT-05)."""
    if isinstance(value, dict):
        # ROS 2 names the field sec, ROS 1 secs.
        value = value.get("sec", value.get("secs"))
    return math.floor(value) if isinstance(value, float) and math.isfinite(value) else value


Total = Annotated[
    int,
    Field(ge=1, le=MOST),
    BeforeValidator(_floor, json_schema_input_type=Annotated[float, Field(ge=1, le=MOST)]),
    Expected("a whole number, one or more"),
]
_Number = Annotated[float, Field(ge=-MOST, le=MOST)]
Seconds = Annotated[
    SafeInteger,
    BeforeValidator(_whole_seconds, json_schema_input_type=_Number | dict[str, _Number]),
    Expected("a time in seconds"),
]


def _set_level(name: str) -> str:
    """Accept the three names that are in use for this op (X02)."""
    # The model keeps one name, so that handlers and tables need not know the others.
    return "set_level"


SetLevelName = Annotated[Literal["set_level", "set_status_level", "status_level"], AfterValidator(_set_level)]


class Fragment(Op):
    """Part of the text of another message (FRG-01).

    Attributes:
        id: id shared by all fragments of a message.
        data: text of the fragment.
        num: number of the fragment, from 0.
        total: number of fragments.
    """

    op: Literal["fragment"] = "fragment"
    id: RequiredId
    data: Text
    num: Count
    total: Total


class Png(Op):
    """Message encoded as the pixels of a PNG image (PNG-01).

    Attributes:
        data: the image, in base64.
    """

    op: Literal["png"] = "png"
    data: Text


class SetLevel(Op):
    """Requests status messages of `level` and above (STA-01, STA-02).

    Attributes:
        level: minimum severity; `none` for no messages.
    """

    op: SetLevelName = "set_level"
    level: LevelName


class Status(Op):
    """Reports the outcome of a client's message (STA-03, STA-04).

    Attributes:
        level: severity.
        msg: human-readable description.
    """

    op: Literal["status"] = "status"
    level: LevelName
    msg: Text


class Auth(Op):
    """Credentials as computed by rosauth (AUT-02).

    Attributes:
        mac: message authentication code of all other members.
        client: address of the client, as stated by the client.
        dest: address of the server, as stated by the client.
        rand: random string.
        t: creation time, seconds since 1970.
        level: requested role (AUT-03).
        end: expiry time, seconds since 1970.
    """

    op: Literal["auth"] = "auth"
    mac: Text
    client: Text
    dest: Text
    rand: Text
    t: Seconds
    level: Text
    end: Seconds


def refuse_with_status(reply_to: ReplyTo, reason: str, level: Level = "error") -> Op:
    """Reject an op that has no response of its own."""
    return Status(level=level, msg=reason, id=reply_to.id)


SPECS = (
    OpSpec(Fragment, Direction.BOTH, refuse_with_status, in_session=True),
    OpSpec(Png, Direction.TO_CLIENT, refuse_with_status, in_session=True),
    OpSpec(SetLevel, Direction.TO_SERVER, refuse_with_status, in_session=True),
    OpSpec(Status, Direction.TO_CLIENT, refuse_with_status),
    OpSpec(Auth, Direction.TO_SERVER, refuse_with_status),
)
