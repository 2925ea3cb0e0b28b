"""rosbridge v2 as types and bytes: ops, encodings, the session of one peer, the dispatcher. No I/O.

>>> from rwt_protocol import CallService, dump, parse
>>> call = CallService(service="/add_two_ints", args={"a": 1, "b": 2}, id="1")
>>> dump(call)
'{"op":"call_service","id":"1","service":"/add_two_ints","args":{"a":1,"b":2}}'
>>> parse(dump(call, "cbor")) == [call]
True

Names are imported on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt_protocol.dispatcher import Dispatcher
    from rwt_protocol.errors import (
        EncodingUnavailable,
        IncompleteDispatcher,
        MalformedMessage,
        MalformedPayload,
        ProtocolError,
        Refused,
    )
    from rwt_protocol.fragments import cut
    from rwt_protocol.frames import Frame
    from rwt_protocol.limits import WireLimits
    from rwt_protocol.ops import (
        OPS,
        ActionFeedback,
        ActionResult,
        Advertise,
        AdvertiseAction,
        AdvertiseService,
        AnyOp,
        Auth,
        CallService,
        CancelActionGoal,
        Direction,
        Fragment,
        Op,
        OpToClient,
        OpToServer,
        Png,
        Publish,
        Qos,
        ReplyTo,
        SendActionGoal,
        ServiceResponse,
        SetLevel,
        Status,
        Subscribe,
        Unadvertise,
        UnadvertiseAction,
        UnadvertiseService,
        Unsubscribe,
        inbound,
    )
    from rwt_protocol.payloads import Decoded, Encodable, RawJson
    from rwt_protocol.profiles import COMPAT, PROFILES, ROS1, ROS2_2024, V2_0_0, Profile
    from rwt_protocol.schema import protocol_asyncapi, protocol_schema
    from rwt_protocol.session import Refusal, Session
    from rwt_protocol.stateless import EncodingName, dump, parse

_HOMES: Final = {
    name: home
    for home, names in {
        "rwt_protocol.stateless": "parse dump EncodingName",
        "rwt_protocol.session": "Session Refusal",
        "rwt_protocol.dispatcher": "Dispatcher",
        "rwt_protocol.ops": (
            "AnyOp OpToServer OpToClient Op OPS inbound Direction ReplyTo Advertise Unadvertise Publish "
            "Subscribe Unsubscribe Qos CallService ServiceResponse AdvertiseService UnadvertiseService "
            "SendActionGoal CancelActionGoal ActionFeedback ActionResult AdvertiseAction "
            "UnadvertiseAction Status SetLevel Auth Fragment Png"
        ),
        "rwt_protocol.payloads": "Encodable RawJson Decoded",
        "rwt_protocol.fragments": "cut",
        "rwt_protocol.limits": "WireLimits",
        "rwt_protocol.profiles": "Profile PROFILES COMPAT ROS1 ROS2_2024 V2_0_0",
        "rwt_protocol.frames": "Frame",
        "rwt_protocol.schema": "protocol_schema protocol_asyncapi",
        "rwt_protocol.errors": (
            "ProtocolError Refused MalformedMessage MalformedPayload EncodingUnavailable IncompleteDispatcher"
        ),
    }.items()
    for name in names.split()
}

__all__ = [
    "parse",
    "dump",
    "EncodingName",
    "Session",
    "Refusal",
    "WireLimits",
    "Dispatcher",
    "AnyOp",
    "OpToServer",
    "OpToClient",
    "Op",
    "OPS",
    "inbound",
    "Direction",
    "ReplyTo",
    "Advertise",
    "Unadvertise",
    "Publish",
    "Subscribe",
    "Unsubscribe",
    "Qos",
    "CallService",
    "ServiceResponse",
    "AdvertiseService",
    "UnadvertiseService",
    "SendActionGoal",
    "CancelActionGoal",
    "ActionFeedback",
    "ActionResult",
    "AdvertiseAction",
    "UnadvertiseAction",
    "Status",
    "SetLevel",
    "Auth",
    "Fragment",
    "Png",
    "Encodable",
    "RawJson",
    "Decoded",
    "cut",
    "Profile",
    "PROFILES",
    "COMPAT",
    "ROS1",
    "ROS2_2024",
    "V2_0_0",
    "Frame",
    "protocol_schema",
    "protocol_asyncapi",
    "ProtocolError",
    "Refused",
    "MalformedMessage",
    "MalformedPayload",
    "EncodingUnavailable",
    "IncompleteDispatcher",
]


def __getattr__(name: str) -> object:
    """Import a name on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """Return all names, imported or not."""
    return sorted({*globals(), *__all__})
