"""rosbridge v2 as types and bytes: ops, encodings, one peer's session, the dispatcher. No I/O.

>>> from rwt_protocol import CallService, dump, parse
>>> call = CallService(service="/add_two_ints", args={"a": 1, "b": 2}, id="1")
>>> dump(call)
'{"op":"call_service","id":"1","service":"/add_two_ints","args":{"a":1,"b":2}}'
>>> parse(dump(call, "cbor")) == [call]
True

Nothing is imported before its name is used.
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
    from rwt_protocol.fragments import FragmentLimits, cut
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
        GoalStatus,
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
    from rwt_protocol.session import Refusal, Session, WireLimits
    from rwt_protocol.stateless import EncodingName, dump, parse
    from rwt_protocol.transport import DropReason, Endpoint, Flow, FlowRules, Frame, PeerInfo, Sink, Traffic

_HOMES: Final = {
    "parse": "rwt_protocol.stateless",
    "dump": "rwt_protocol.stateless",
    "EncodingName": "rwt_protocol.stateless",
    "Session": "rwt_protocol.session",
    "Refusal": "rwt_protocol.session",
    "WireLimits": "rwt_protocol.session",
    "Dispatcher": "rwt_protocol.dispatcher",
    "AnyOp": "rwt_protocol.ops",
    "OpToServer": "rwt_protocol.ops",
    "OpToClient": "rwt_protocol.ops",
    "Op": "rwt_protocol.ops",
    "OPS": "rwt_protocol.ops",
    "inbound": "rwt_protocol.ops",
    "Direction": "rwt_protocol.ops",
    "ReplyTo": "rwt_protocol.ops",
    "Advertise": "rwt_protocol.ops",
    "Unadvertise": "rwt_protocol.ops",
    "Publish": "rwt_protocol.ops",
    "Subscribe": "rwt_protocol.ops",
    "Unsubscribe": "rwt_protocol.ops",
    "Qos": "rwt_protocol.ops",
    "CallService": "rwt_protocol.ops",
    "ServiceResponse": "rwt_protocol.ops",
    "AdvertiseService": "rwt_protocol.ops",
    "UnadvertiseService": "rwt_protocol.ops",
    "SendActionGoal": "rwt_protocol.ops",
    "CancelActionGoal": "rwt_protocol.ops",
    "ActionFeedback": "rwt_protocol.ops",
    "ActionResult": "rwt_protocol.ops",
    "GoalStatus": "rwt_protocol.ops",
    "AdvertiseAction": "rwt_protocol.ops",
    "UnadvertiseAction": "rwt_protocol.ops",
    "Status": "rwt_protocol.ops",
    "SetLevel": "rwt_protocol.ops",
    "Auth": "rwt_protocol.ops",
    "Fragment": "rwt_protocol.ops",
    "Png": "rwt_protocol.ops",
    "Encodable": "rwt_protocol.payloads",
    "RawJson": "rwt_protocol.payloads",
    "Decoded": "rwt_protocol.payloads",
    "FragmentLimits": "rwt_protocol.fragments",
    "cut": "rwt_protocol.fragments",
    "Profile": "rwt_protocol.profiles",
    "PROFILES": "rwt_protocol.profiles",
    "COMPAT": "rwt_protocol.profiles",
    "ROS1": "rwt_protocol.profiles",
    "ROS2_2024": "rwt_protocol.profiles",
    "V2_0_0": "rwt_protocol.profiles",
    "Frame": "rwt_protocol.transport",
    "Sink": "rwt_protocol.transport",
    "Flow": "rwt_protocol.transport",
    "FlowRules": "rwt_protocol.transport",
    "Endpoint": "rwt_protocol.transport",
    "PeerInfo": "rwt_protocol.transport",
    "Traffic": "rwt_protocol.transport",
    "DropReason": "rwt_protocol.transport",
    "protocol_schema": "rwt_protocol.schema",
    "protocol_asyncapi": "rwt_protocol.schema",
    "ProtocolError": "rwt_protocol.errors",
    "Refused": "rwt_protocol.errors",
    "MalformedMessage": "rwt_protocol.errors",
    "MalformedPayload": "rwt_protocol.errors",
    "EncodingUnavailable": "rwt_protocol.errors",
    "IncompleteDispatcher": "rwt_protocol.errors",
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
    "GoalStatus",
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
    "FragmentLimits",
    "cut",
    "Profile",
    "PROFILES",
    "COMPAT",
    "ROS1",
    "ROS2_2024",
    "V2_0_0",
    "Frame",
    "Sink",
    "Flow",
    "FlowRules",
    "Endpoint",
    "PeerInfo",
    "Traffic",
    "DropReason",
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
    """Import a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """The names for completion, imported or not."""
    return sorted({*globals(), *__all__})
