"""Ops for services: call_service, service_response, advertise_service, unadvertise_service."""

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
    """Calls a service, from a client to the server or from the server to a provider (SRV-01, SVP-01).

    Attributes:
        service: name as the caller wrote it, which the response repeats.
        args: an object by name or an array by position (SRV-02); absent and null are an empty object.
        timeout: seconds to wait; 0 and less: no limit; None: the server's default (SRV-10).
    """

    op: Literal["call_service"] = "call_service"
    service: Text
    type: Annotated[OptionalText, NoEffect("the service has a type (SRV-03)")] = None
    args: Arguments = Field(EMPTY, strict=False)
    timeout: Timeout = None
    fragment_size: OptionalCount = None
    compression: CompressionOfReply = "none"


class ServiceResponse(Op):
    """Response to a service call (SRV-14).

    Attributes:
        values: the response; if `result` is false, usually a string with the reason (SRV-05). Absent and null
            are an empty object (SVP-05).
        result: true if the service succeeded. Absent is true, as clients read it (CLI-01).
    """

    wire_order: ClassVar[tuple[str, ...]] = ("service", "values", "result", "id")

    op: Literal["service_response"] = "service_response"
    service: Text
    values: Values = Field(EMPTY, strict=False)
    result: Flag = True


class AdvertiseService(Op):
    """Advertises a service of the sender (SVP-01).

    Attributes:
        type: type of the service, for example `std_srvs/Trigger`.
    """

    op: Literal["advertise_service"] = "advertise_service"
    type: Text
    service: Text


class UnadvertiseService(Op):
    """Withdraws a service of the sender (SVP-09)."""

    op: Literal["unadvertise_service"] = "unadvertise_service"
    service: Text


def refuse_call(reply_to: ReplyTo, reason: str, level: Level = "error") -> Op:
    """Reject a call with a response, which its caller waits for (SRV-04 to SRV-08).

    Calls without a service and without an id cannot be answered.
    """
    # Neither member could be matched by the caller, so the text goes out as a status.
    if not reply_to.name and reply_to.id is None:
        return refuse_with_status(reply_to, reason, level)
    return ServiceResponse(service=reply_to.name, values=reason, result=False, id=reply_to.id)


SPECS = (
    OpSpec(CallService, Direction.BOTH, refuse_call),
    OpSpec(ServiceResponse, Direction.BOTH, refuse_with_status),
    OpSpec(AdvertiseService, Direction.TO_SERVER, refuse_with_status),
    OpSpec(UnadvertiseService, Direction.TO_SERVER, refuse_with_status),
)
