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

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt_protocol.dispatcher import Dispatcher as Dispatcher
    from rwt_protocol.errors import EncodingUnavailable as EncodingUnavailable
    from rwt_protocol.errors import IncompleteDispatcher as IncompleteDispatcher
    from rwt_protocol.errors import MalformedMessage as MalformedMessage
    from rwt_protocol.errors import MalformedPayload as MalformedPayload
    from rwt_protocol.errors import ProtocolError as ProtocolError
    from rwt_protocol.errors import Refused as Refused
    from rwt_protocol.fragments import cut as cut
    from rwt_protocol.frames import Frame as Frame
    from rwt_protocol.limits import WireLimits as WireLimits
    from rwt_protocol.ops import OPS as OPS
    from rwt_protocol.ops import ActionFeedback as ActionFeedback
    from rwt_protocol.ops import ActionResult as ActionResult
    from rwt_protocol.ops import Advertise as Advertise
    from rwt_protocol.ops import AdvertiseAction as AdvertiseAction
    from rwt_protocol.ops import AdvertiseService as AdvertiseService
    from rwt_protocol.ops import AnyOp as AnyOp
    from rwt_protocol.ops import Auth as Auth
    from rwt_protocol.ops import CallService as CallService
    from rwt_protocol.ops import CancelActionGoal as CancelActionGoal
    from rwt_protocol.ops import Direction as Direction
    from rwt_protocol.ops import Fragment as Fragment
    from rwt_protocol.ops import Op as Op
    from rwt_protocol.ops import OpToClient as OpToClient
    from rwt_protocol.ops import OpToServer as OpToServer
    from rwt_protocol.ops import Png as Png
    from rwt_protocol.ops import Publish as Publish
    from rwt_protocol.ops import Qos as Qos
    from rwt_protocol.ops import ReplyTo as ReplyTo
    from rwt_protocol.ops import SendActionGoal as SendActionGoal
    from rwt_protocol.ops import ServiceResponse as ServiceResponse
    from rwt_protocol.ops import SetLevel as SetLevel
    from rwt_protocol.ops import Status as Status
    from rwt_protocol.ops import Subscribe as Subscribe
    from rwt_protocol.ops import Unadvertise as Unadvertise
    from rwt_protocol.ops import UnadvertiseAction as UnadvertiseAction
    from rwt_protocol.ops import UnadvertiseService as UnadvertiseService
    from rwt_protocol.ops import Unsubscribe as Unsubscribe
    from rwt_protocol.ops import inbound as inbound
    from rwt_protocol.payloads import Decoded as Decoded
    from rwt_protocol.payloads import Encodable as Encodable
    from rwt_protocol.payloads import RawJson as RawJson
    from rwt_protocol.profiles import COMPAT as COMPAT
    from rwt_protocol.profiles import PROFILES as PROFILES
    from rwt_protocol.profiles import ROS1 as ROS1
    from rwt_protocol.profiles import ROS2_2024 as ROS2_2024
    from rwt_protocol.profiles import V2_0_0 as V2_0_0
    from rwt_protocol.profiles import Profile as Profile
    from rwt_protocol.schema import protocol_asyncapi as protocol_asyncapi
    from rwt_protocol.schema import protocol_schema as protocol_schema
    from rwt_protocol.session import Refusal as Refusal
    from rwt_protocol.session import Session as Session
    from rwt_protocol.stateless import EncodingName as EncodingName
    from rwt_protocol.stateless import dump as dump
    from rwt_protocol.stateless import parse as parse

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
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
    },
)
