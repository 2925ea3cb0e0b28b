"""Messages of Foxglove clients: models of JSON messages, and binary frames with a little-endian head.

The protocol versions `foxglove.websocket.v1` and `foxglove.sdk.v1` have the same messages
(https://github.com/foxglove/ws-protocol, https://github.com/foxglove/foxglove-sdk). Unknown fields are
ignored, as in the protocol's own servers.
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct as Layout
from struct import error as LayoutError
from typing import Annotated, Final, Literal

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from rwt.extensions.foxglove.errors import InvalidFrame
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.serialise.json import require_quick_numbers
from rwt_interfaces.steps import finished

MAX_BYTES: Final = 1024 * 1024
"""Maximum bytes of a text frame. Payloads are binary; each byte of JSON can cost fifty bytes once decoded."""

Id = Annotated[int, Meta(ge=0, le=2**32 - 1)]
"""Id that a client chooses: 32 bits on the wire."""

ChannelId = Annotated[int, Meta(ge=0, le=2**63 - 1)]
"""Id of a channel of the server, which occurs in text frames only."""

Name = Annotated[str, Meta(max_length=4096)]
"""A name or an address."""


class ChannelSubscription(Struct, frozen=True, rename="camel"):
    """Requested subscription, under an id of the client."""

    id: Id
    channel_id: ChannelId


class ClientChannel(Struct, frozen=True, rename="camel"):
    """Channel on which a client publishes, in the encoding ``cdr``, ``ros1`` or ``json``."""

    id: Id
    topic: Name
    encoding: Name
    schema_name: Name


class Parameter(Struct, frozen=True):
    """Parameter that a client sets, or deletes if it gives no value."""

    name: Name
    value: object = UNSET
    type: Literal["byte_array", "float64", "float64_array"] | UnsetType | None = UNSET


class _Text(Struct, frozen=True, rename="camel", tag_field="op"):
    """Base of the messages in text frames."""


class SubscribeChannels(_Text, frozen=True, tag="subscribe"):
    """Request to subscribe to channels."""

    subscriptions: list[ChannelSubscription]


class UnsubscribeChannels(_Text, frozen=True, tag="unsubscribe"):
    """Request to end subscriptions."""

    subscription_ids: list[Id]


class AdvertiseChannels(_Text, frozen=True, tag="advertise"):
    """Advertisement of channels on which the client will publish."""

    channels: list[ClientChannel]


class UnadvertiseChannels(_Text, frozen=True, tag="unadvertise"):
    """Request to withdraw advertised channels."""

    channel_ids: list[Id]


class GetParameters(_Text, frozen=True, tag="getParameters"):
    """Request for the values of parameters, or of all if none is named."""

    parameter_names: list[Name]
    id: Name | None = None


class SetParameters(_Text, frozen=True, tag="setParameters"):
    """Request to set parameters; with an id, the new values are sent back."""

    parameters: list[Parameter]
    id: Name | None = None


class SubscribeParameterUpdates(_Text, frozen=True, tag="subscribeParameterUpdates"):
    """Request to watch parameters, or all if none is named."""

    parameter_names: list[Name]


class UnsubscribeParameterUpdates(_Text, frozen=True, tag="unsubscribeParameterUpdates"):
    """Request to stop watching parameters, or all if none is named."""

    parameter_names: list[Name]


class SubscribeConnectionGraph(_Text, frozen=True, tag="subscribeConnectionGraph"):
    """Request for the connection graph, now and after every change."""


class UnsubscribeConnectionGraph(_Text, frozen=True, tag="unsubscribeConnectionGraph"):
    """Request to end updates of the connection graph."""


class FetchAsset(_Text, frozen=True, tag="fetchAsset"):
    """Request for a file by its URI."""

    uri: Name
    request_id: Id


class MessageData(Struct, frozen=True):
    """Message on one of the client's channels."""

    channel_id: int
    data: memoryview


class ServiceCallRequest(Struct, frozen=True):
    """Service call."""

    service_id: int
    call_id: int
    encoding: str
    data: memoryview


class PlaybackControlRequest(Struct, frozen=True):
    """Request to play, pause, seek, or change the speed, in recorded seconds per second.

    Attributes:
        seek_ns: nanoseconds since the epoch; None keeps the position.
    """

    plays: bool  # False pauses the playback.
    speed: float
    seek_ns: int | None
    request_id: bytes


Text = (
    SubscribeChannels
    | UnsubscribeChannels
    | AdvertiseChannels
    | UnadvertiseChannels
    | GetParameters
    | SetParameters
    | SubscribeParameterUpdates
    | UnsubscribeParameterUpdates
    | SubscribeConnectionGraph
    | UnsubscribeConnectionGraph
    | FetchAsset
)
"""A message in a text frame."""

Binary = MessageData | ServiceCallRequest | PlaybackControlRequest
"""A message in a binary frame."""

_decode: Final[Callable[[bytes | memoryview], Text]] = msgspec.json.Decoder(Text).decode

MESSAGE_DATA: Final = 1
SERVICE_CALL_REQUEST: Final = 2
PLAYBACK_CONTROL_REQUEST: Final = 3

_CHANNEL: Final = Layout("<BI")
_CALL: Final = Layout("<BIII")
_PLAYBACK: Final = Layout("<BBfBQI")

#: Maximum size of the id of a request, which is returned in the response, in bytes.
_LONGEST_ID: Final = 4096


def parse_text(data: bytes | memoryview) -> Text:
    """Return the message in a text frame. Raises InvalidFrame, and nothing else, whatever the bytes."""
    if len(data) > MAX_BYTES:
        raise InvalidFrame(
            f"a text of {len(data)} bytes, and {MAX_BYTES} are taken: publish in binary frames, and ask for"
            " less at once"
        )
    try:
        # Before decoding: many numbers with large exponents would hold the event loop for seconds.
        finished(require_quick_numbers(data))
    except InvalidMessage as error:
        raise InvalidFrame(str(error)) from None
    try:
        return _decode(data)
    except msgspec.ValidationError as error:
        # Cut, because msgspec quotes an unknown `op` of any length.
        raise InvalidFrame(f"no message of the protocol: {error}"[:500]) from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InvalidFrame(f"not JSON that can be read: {error}"[:500]) from None


def parse_binary(data: bytes | memoryview) -> Binary:
    """Return the message in a binary frame, with a view of its payload. Raises InvalidFrame alone."""
    view = memoryview(data)
    if not view:
        raise InvalidFrame("an empty binary frame: the first byte says what follows")
    try:
        if view[0] == MESSAGE_DATA:
            _, channel_id = _CHANNEL.unpack_from(view)
            return MessageData(channel_id, view[_CHANNEL.size :])
        if view[0] == SERVICE_CALL_REQUEST:
            return _call(view)
        if view[0] == PLAYBACK_CONTROL_REQUEST:
            return _playback(view)
    except LayoutError:
        raise InvalidFrame(
            f"a binary frame of opcode {view[0]} and {len(view)} bytes: its head is longer"
        ) from None
    raise InvalidFrame(
        f"a binary frame of opcode {view[0]}: clients send {MESSAGE_DATA} (message data),"
        f" {SERVICE_CALL_REQUEST} (service call) and {PLAYBACK_CONTROL_REQUEST} (playback control)"
    )


def addressee(data: bytes | memoryview) -> tuple[int, int]:
    """Return the opcode of a binary frame, and the id of its channel or service; (0, 0) if it has none."""
    return (data[0], int.from_bytes(data[1:5], "little")) if len(data) >= _CHANNEL.size else (0, 0)


def _call(view: memoryview) -> ServiceCallRequest:
    _, service_id, call_id, length = _CALL.unpack_from(view)
    encoding = _utf8(view[_CALL.size :], length, "the encoding of a service call", 64)
    return ServiceCallRequest(service_id, call_id, encoding.decode(), view[_CALL.size + length :])


def _playback(view: memoryview) -> PlaybackControlRequest:
    _, command, speed, has_seek, seek_ns, length = _PLAYBACK.unpack_from(view)
    if command > 1:
        raise InvalidFrame(f"playback command {command}: expected 0 (play) or 1 (pause)")
    request_id = _utf8(view[_PLAYBACK.size :], length, "the id of a playback request", _LONGEST_ID)
    return PlaybackControlRequest(command == 0, speed, seek_ns if has_seek else None, request_id)


def _utf8(rest: memoryview, length: int, what: str, most: int) -> bytes:
    """Return the first `length` bytes of `rest`, a valid UTF-8 string of at most `most` bytes.

    Raises:
        InvalidFrame: the string is longer, is cut off, or is not UTF-8.
    """
    if length > min(len(rest), most):
        raise InvalidFrame(f"{what} has {length} bytes: {len(rest)} follow, and {most} is the most")
    string = bytes(rest[:length])
    try:
        string.decode()
    except UnicodeDecodeError:
        raise InvalidFrame(f"{what} is not UTF-8") from None
    return string
