"""Settings of the rosbridge gateway: the model alone."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rwt.access.settings import CALL_SECONDS, LINGER_SECONDS, AccessSettings, Bytes, SecondsOrNone
from rwt_protocol.limits import MAX_MESSAGE_BYTES


class BridgeSettings(AccessSettings):
    """All settings of a :class:`rwt.gateways.rosbridge.bridge.Bridge`."""

    profile: Annotated[
        Literal["compat", "ros1", "ros2-2024", "2.0.0"],
        Field(description="protocol version; `compat` accepts every client"),
    ] = "compat"
    max_message_size: Annotated[Bytes, Field(description="largest message from a client, in bytes")] = (
        MAX_MESSAGE_BYTES
    )
    default_call_service_timeout: Annotated[
        SecondsOrNone,
        Field(description="timeout of service calls without one of their own, in seconds; 0: none"),
    ] = CALL_SECONDS
    unregister_timeout: Annotated[
        SecondsOrNone, Field(description="seconds that a topic remains after its last rosbridge publisher")
    ] = LINGER_SECONDS
    bson_only_mode: Annotated[
        bool, Field(description="BSON for every message in both directions; needs the extra `bson`")
    ] = False
