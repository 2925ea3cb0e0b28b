"""Ops about services: call_service, service_response, advertise_service, unadvertise_service."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from rwt_protocol.error_text import Expected
from rwt_protocol.errors import Level
from rwt_protocol.ops.base import (
    MOST_SECONDS,
    Arguments,
    Direction,
    Flag,
    NoEffect,
    Op,
    OpSpec,
    OptionalText,
    ReplyTo,
    Text,
    Values,
)
from rwt_protocol.ops.control import refuse_with_status
from rwt_protocol.ops.topics import CompressionOfReply, OptionalCount
from rwt_protocol.payloads import EMPTY

Timeout = Annotated[
    Annotated[float, Field(ge=-MOST_SECONDS, le=MOST_SECONDS, allow_inf_nan=False)] | None,
    Expected("a number of seconds"),
]


class CallService(Op):
    """Asks for one run of a service; to a provider, asks it to run (SRV-01, SVP-01).

    Attributes:
        service: the name as the caller wrote it, which the reply repeats.
        args: an object by name or an array by position (SRV-02); absent and null are an empty object.
        timeout: seconds to wait; 0 and less: no limit; None leaves it to the server (SRV-10).
    """

    op: Literal["call_service"] = "call_service"
    service: Text
    type: Annotated[OptionalText, NoEffect("the service has a type (SRV-03)")] = None
    args: Arguments = Field(EMPTY, strict=False)
    timeout: Timeout = None
    fragment_size: OptionalCount = None
    compression: CompressionOfReply = "none"


class ServiceResponse(Op):
    """The one reply to a call (SRV-14).

    Attributes:
        values: the response; when `result` is false, usually a string that says why (SRV-05). Absent and
            null are an empty object (SVP-05).
        result: whether the service ran and succeeded. Absent is true, as clients read it (CLI-01).
    """

    wire_order: ClassVar[tuple[str, ...]] = ("service", "values", "result", "id")

    op: Literal["service_response"] = "service_response"
    service: Text
    values: Values = Field(EMPTY, strict=False)
    result: Flag = True


class AdvertiseService(Op):
    """The sender offers a service (SVP-01).

    Attributes:
        type: type of the service, for example `std_srvs/Trigger`.
    """

    op: Literal["advertise_service"] = "advertise_service"
    type: Text
    service: Text


class UnadvertiseService(Op):
    """The sender withdraws a service that it offers (SVP-09)."""

    op: Literal["unadvertise_service"] = "unadvertise_service"
    service: Text


def refuse_call(reply_to: ReplyTo, reason: str, level: Level = "error") -> Op:
    """A caller waits for its reply, so it gets one (SRV-04 to SRV-08).

    Only a call that names no service and has no id cannot be replied to.
    """
    if not reply_to.name and reply_to.id is None:
        return refuse_with_status(reply_to, reason, level)
    return ServiceResponse(service=reply_to.name, values=reason, result=False, id=reply_to.id)


SPECS = (
    OpSpec(CallService, Direction.BOTH, refuse_call),
    OpSpec(ServiceResponse, Direction.BOTH, refuse_with_status),
    OpSpec(AdvertiseService, Direction.TO_SERVER, refuse_with_status),
    OpSpec(UnadvertiseService, Direction.TO_SERVER, refuse_with_status),
)
