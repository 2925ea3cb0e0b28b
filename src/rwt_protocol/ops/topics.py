"""Ops for topics: advertise, unadvertise, publish, subscribe, unsubscribe."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from rwt_protocol.error_text import Expected
from rwt_protocol.ops.base import (
    MOST,
    MOST_SECONDS,
    Count,
    Direction,
    Flag,
    Message,
    NoEffect,
    Op,
    OpSpec,
    OptionalText,
    Text,
    Whole,
    whole_number,
)
from rwt_protocol.ops.control import refuse_with_status
from rwt_protocol.payloads import EMPTY


def _lower(value: object) -> object:
    """Accept names of policies in any case (ADV-11)."""
    return value.lower() if isinstance(value, str) else value


class Duration(BaseModel):
    """Alternative form of a number of seconds."""

    model_config = ConfigDict(
        frozen=True, strict=True, extra="ignore", hide_input_in_errors=True, defer_build=True
    )

    secs: Annotated[int, Field(ge=0, le=MOST_SECONDS)]
    nsecs: Annotated[int, Field(ge=0, le=MOST)]


_Seconds = Annotated[float, Field(ge=0, le=MOST_SECONDS, allow_inf_nan=False)]


class _DurationSchema:
    """JSON Schema of :class:`Duration`, made when the schema of an op is."""

    def __get_pydantic_json_schema__(
        self, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        # Written out, since pydantic before 2.12 loses a model that only the schema of an input refers to.
        schema = Duration.model_json_schema()
        return {key: schema[key] for key in ("type", "properties", "required")}


_Object = Annotated[dict[str, int], _DurationSchema()]


def _seconds(value: object) -> object:
    """Return seconds from a number, ``{secs, nsecs}``, or a name in any case."""
    if isinstance(value, dict):
        duration = Duration.model_validate(value)
        return duration.secs + duration.nsecs / 1e9
    return _lower(value)


class Qos(BaseModel):
    """Quality of service that a client requests; None leaves a policy to the server (ADV-11).

    Attributes:
        history: which messages are kept: the newest `depth`, or all.
        depth: number of messages kept with the history `keep_last`.
        reliability: whether messages may be lost in transit.
        durability: `transient_local` keeps messages for late subscribers.
        deadline: maximum seconds between two messages.
        lifespan: age in seconds after which a message is no longer delivered.
    """

    model_config = ConfigDict(
        frozen=True, strict=True, extra="ignore", hide_input_in_errors=True, defer_build=True
    )

    history: Annotated[
        Literal["keep_last", "keep_all"] | None,
        BeforeValidator(_lower),
        Expected('"keep_last" or "keep_all"'),
    ] = None
    depth: Annotated[Count | None, Expected("a whole number, zero or more")] = None
    reliability: Annotated[
        Literal["reliable", "best_effort", "best_available"] | None,
        BeforeValidator(_lower),
        Expected('"reliable", "best_effort" or "best_available"'),
    ] = None
    durability: Annotated[
        Literal["volatile", "transient_local", "best_available"] | None,
        BeforeValidator(_lower),
        Expected('"volatile", "transient_local" or "best_available"'),
    ] = None
    deadline: Annotated[
        _Seconds | Literal["infinite", "best_available"] | None,
        BeforeValidator(
            _seconds,
            json_schema_input_type=_Seconds | _Object | Literal["infinite", "best_available"] | None,
        ),
        Expected('seconds, {"secs", "nsecs"}, "infinite" or "best_available"'),
    ] = None
    lifespan: Annotated[
        _Seconds | Literal["infinite"] | None,
        BeforeValidator(_seconds, json_schema_input_type=_Seconds | _Object | Literal["infinite"] | None),
        Expected('seconds, {"secs", "nsecs"} or "infinite"'),
    ] = None


def _as_tuple(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


_Metres = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
_Box = tuple[_Metres, _Metres, _Metres, _Metres, _Metres, _Metres]
_Six = Annotated[list[_Metres], Field(min_length=6, max_length=6)]
_Names = Annotated[tuple[Annotated[str, Field(max_length=256)], ...], Field(max_length=256)]


class Compact(BaseModel):
    """Reduced form of large messages that a subscriber requests (SUB-19).

    Attributes:
        precision: largest error of x, y and z in metres, and of an intensity 1/256 of its range; 0 for exact.
        fields: names of the fields of a point; all by default.
        crop: box of the points in the cloud's frame: smallest x, y and z, then the largest.
        voxel: edge in metres of the cubes of which one point is sent; 0 for all points.
        stride: every so many points are sent; in organised clouds so many rows and columns.
        order: `any` permits another order of the points of a cloud without an order.
        format: form of a compressed cloud; `draco` is the one that point_cloud_transport reads.
    """

    model_config = ConfigDict(
        frozen=True, strict=True, extra="ignore", hide_input_in_errors=True, defer_build=True
    )

    precision: Annotated[float, Field(ge=0, le=1000, allow_inf_nan=False), Expected("metres, 0 to 1000")] = (
        0.001
    )
    fields: Annotated[
        _Names | None,
        BeforeValidator(_as_tuple, json_schema_input_type=list[str] | None),
        Expected("at most 256 names"),
    ] = None
    crop: Annotated[
        _Box | None,
        BeforeValidator(_as_tuple, json_schema_input_type=_Six | None),
        Expected("six numbers: smallest x, y and z, then the largest"),
    ] = None
    voxel: Annotated[float, Field(ge=0, le=1000, allow_inf_nan=False), Expected("metres, 0 to 1000")] = 0.0
    stride: Annotated[
        int, Field(ge=1, le=10_000), BeforeValidator(whole_number), Expected("a whole number, 1 to 10000")
    ] = 1
    order: Annotated[Literal["keep", "any"], BeforeValidator(_lower), Expected('"keep" or "any"')] = "keep"
    format: Annotated[
        Literal["rwt_planes", "draco"], BeforeValidator(_lower), Expected('"rwt_planes" or "draco"')
    ] = "rwt_planes"


OptionalCompact = Annotated[Compact | None, Expected("an object")]
OptionalQos = Annotated[Qos | None, Expected("an object")]
OptionalCount = Annotated[Count | None, Expected("a whole number, zero or more")]
QueueSize = Annotated[OptionalCount, NoEffect("a topic in memory has no queue to a network")]
CompressionOfReply = Annotated[Text, NoEffect("replies are JSON (PNG-08)")]


class Advertise(Op):
    """Advertises a topic that the sender will publish on (ADV-01).

    `latch` and `queue_size` are ROS 1 terms (ADV-06).

    Attributes:
        type: type of the topic's messages, `std_msgs/String` or `std_msgs/msg/String`.
        latch: keep the last message for late subscribers.
        qos: quality of service of the topic's publisher (ADV-11); takes precedence over `latch`.
    """

    op: Literal["advertise"] = "advertise"
    topic: Text
    type: Text
    latch: Flag = False
    queue_size: QueueSize = None
    qos: OptionalQos = None


class Unadvertise(Op):
    """Withdraws the advertisement with this id, or all of the sender's for the topic (UNA-03)."""

    op: Literal["unadvertise"] = "unadvertise"
    topic: Text


class Publish(Op):
    """Message on a topic (PUB-01).

    Attributes:
        type: type of the topic, used if it has not been advertised (X12).
        msg: the message. Missing fields get their defaults (PUB-04).
        latch: as on `advertise`; applies to the first message on a topic that has not been advertised.
        qos: as on `advertise`: policies of the publisher that the message creates, or that the existing one
            must have.
        id: on the first message on a topic that has not been advertised: id of the resulting advertisement,
            for `unadvertise` (UNA-06).
    """

    op: Literal["publish"] = "publish"
    topic: Text
    type: OptionalText = None
    msg: Message = Field(EMPTY, strict=False)
    latch: Flag = False
    queue_size: QueueSize = None
    qos: OptionalQos = None


class Subscribe(Op):
    """Subscribes to a topic.

    Attributes:
        type: expected type; None accepts the type of the topic (SUB-01).
        throttle_rate: minimum milliseconds between two messages; 0 and less: none (SUB-12, THR-09).
        queue_length: number of messages queued while throttled, keeping the newest (THR-03).
        compression: encoding of the messages (SUB-08); unknown words mean `none` (SUB-10).
        qos: queueing for a slow connection, and which retained messages are sent first: `depth`, `history`
            and `reliability` set the queue, `volatile` requests no retained messages (SUB-17).
        compact: request for a smaller form of large messages; ignored for types that have none (SUB-19).
    """

    op: Literal["subscribe"] = "subscribe"
    topic: Text
    type: OptionalText = None
    throttle_rate: Whole = 0
    queue_length: Count = 0
    fragment_size: OptionalCount = None
    compression: Text = "none"
    qos: OptionalQos = None
    compact: OptionalCompact = None


class Unsubscribe(Op):
    """Ends the subscription with this id, or all of the sender's on the topic (UNS-01)."""

    op: Literal["unsubscribe"] = "unsubscribe"
    topic: Text


SPECS = (
    OpSpec(Advertise, Direction.TO_SERVER, refuse_with_status),
    OpSpec(Unadvertise, Direction.TO_SERVER, refuse_with_status),
    OpSpec(Publish, Direction.BOTH, refuse_with_status),
    OpSpec(Subscribe, Direction.TO_SERVER, refuse_with_status),
    OpSpec(Unsubscribe, Direction.TO_SERVER, refuse_with_status),
)
