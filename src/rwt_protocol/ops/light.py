"""Light forms of the three most frequent ops.

They have all attributes of their op, but are no pydantic models: making one takes a quarter of the time, and
an op is made for each message. A :class:`~rwt_protocol.session.Session` returns them only on request.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final, Literal

import msgspec

from rwt_protocol.ops.base import Op
from rwt_protocol.ops.services import CallService, ServiceResponse
from rwt_protocol.ops.topics import Publish
from rwt_protocol.payloads import RawJson


class LightPublish(msgspec.Struct, frozen=True, gc=False):
    """Light :class:`~rwt_protocol.ops.Publish`."""

    op: ClassVar[Literal["publish"]] = "publish"
    queue_size: ClassVar[None] = None
    qos: ClassVar[None] = None

    topic: str
    msg: RawJson
    id: str | None
    type: str | None
    latch: bool


class LightCall(msgspec.Struct, frozen=True, gc=False):
    """Light :class:`~rwt_protocol.ops.CallService`."""

    op: ClassVar[Literal["call_service"]] = "call_service"
    timeout: ClassVar[None] = None
    fragment_size: ClassVar[None] = None
    compression: ClassVar[str] = "none"

    service: str
    args: RawJson
    id: str | None
    type: str | None


class LightResponse(msgspec.Struct, frozen=True, gc=False):
    """Light :class:`~rwt_protocol.ops.ServiceResponse`."""

    op: ClassVar[Literal["service_response"]] = "service_response"

    service: str
    values: RawJson
    id: str | None
    result: bool


LightOp = LightPublish | LightCall | LightResponse

LIGHT: Final[Mapping[type[Op], type[LightOp]]] = {
    Publish: LightPublish,
    CallService: LightCall,
    ServiceResponse: LightResponse,
}
"""Light forms by op."""
