"""Settings of the rosbridge gateway: the model alone."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from rwt.access.settings import CALL_SECONDS, LINGER_SECONDS, AccessSettings, Bytes, SecondsOrNone
from rwt_protocol.limits import MAX_MESSAGE_BYTES


class BridgeSettings(AccessSettings):
    """All settings of a :class:`rwt.rosbridge.Bridge`."""

    profile: Literal["compat", "ros1", "ros2-2024", "2.0.0"] = Field(
        "compat", description="protocol version; `compat` accepts every client"
    )
    max_message_size: Bytes = Field(MAX_MESSAGE_BYTES, description="largest message from a client, in bytes")
    default_call_service_timeout: SecondsOrNone = Field(
        CALL_SECONDS, description="timeout of service calls without one of their own, in seconds; 0: none"
    )
    unregister_timeout: SecondsOrNone = Field(
        LINGER_SECONDS, description="seconds that a topic remains after its last rosbridge publisher"
    )
    bson_only_mode: bool = Field(
        False, description="BSON for every message in both directions; needs the extra `bson`"
    )
