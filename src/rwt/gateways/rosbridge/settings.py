"""What an operator can set about the rosbridge protocol: the models alone."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rwt.access.settings import (
    MIB,
    AccessSettings,
    Bytes,
    ClientLimits,
    Count,
    CountOrNone,
    Seconds,
    SecondsOrNone,
)


class BridgeLimits(ClientLimits):
    """What one client may send, and what it is sent."""

    messages_per_second: Annotated[
        CountOrNone,
        Field(description="messages that one client may send each second in the long run; 0 for any number"),
    ] = 0
    messages_burst: Annotated[
        Count, Field(description="messages that one client may send at once before their rate counts")
    ] = 20_000
    max_depth: Annotated[
        int,
        Field(ge=4, le=500, description="objects and arrays open at once in one message, itself included"),
    ] = 100
    structure_bytes: Annotated[
        Bytes,
        Field(
            description="bytes of one message in CBOR or BSON beside its long strings and typed arrays;"
            " brackets of one in JSON, unless its payload has every field of its type as ROS writes it"
        ),
    ] = 256 * 1024
    fragmented_messages: Annotated[
        Count, Field(description="messages of one client that may be in pieces at the same time")
    ] = 16
    fragment_characters: Annotated[
        Count, Field(description="characters of all pieces of one client together")
    ] = 10_000_000
    fragment_seconds: Annotated[
        Seconds, Field(description="time after the last piece until the others are forgotten")
    ] = 600.0
    outgoing_message_bytes: Annotated[
        Bytes,
        Field(description="largest message to a client; a larger reply fails its call, a sample is dropped"),
    ] = 256 * MIB
    data_bytes: Annotated[
        Bytes,
        Field(
            description="samples queued for one client behind its connection, and as many again behind its"
            " throttles; beyond it the oldest of the topic is dropped"
        ),
    ] = 8 * MIB


class BridgeSettings(AccessSettings):
    """The settings that a :class:`rwt.gateways.rosbridge.Bridge` honours, every one of them."""

    profile: Annotated[
        Literal["compat", "ros1", "ros2-2024", "2.0.0"],
        Field(description="protocol text to follow; `compat` takes what any client sends"),
    ] = "compat"
    max_message_size: Annotated[Bytes, Field(description="largest message taken from a client, bytes")] = (
        10_000_000
    )
    default_call_service_timeout: Annotated[
        SecondsOrNone,
        Field(description="seconds a service call may take when its caller says nothing; 0 waits for ever"),
    ] = 5.0
    unregister_timeout: Annotated[
        SecondsOrNone, Field(description="seconds a topic outlives its last rosbridge publisher")
    ] = 10.0
    bson_only_mode: Annotated[
        bool, Field(description="whether every message, both ways, is BSON; needs the extra `bson`")
    ] = False
    limits: BridgeLimits = BridgeLimits()
