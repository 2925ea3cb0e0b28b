"""Stateless conversion between frames and ops, for tools, logs and tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final, Literal, overload

from rwt_protocol.codecs import JSON, bson_codec, cbor_codec, codec_of, png
from rwt_protocol.codecs.base import Codec
from rwt_protocol.codecs.envelope import PAYLOADS
from rwt_protocol.errors import EncodingUnavailable, MalformedMessage, MalformedPayload, Refused
from rwt_protocol.limits import WIRE_LIMITS, WireLimits
from rwt_protocol.ops import Direction, Op, Png
from rwt_protocol.payloads import RawJson
from rwt_protocol.profiles import COMPAT, Profile
from rwt_protocol.session import Refusal, Session

EncodingName = Literal["json", "cbor", "bson", "png"]
"""Encodings of whole messages. `png` is JSON as the pixels of an image, within an op `png`."""

_CODECS: Final[Mapping[str, Callable[[], Codec]]] = MappingProxyType(
    {"json": lambda: JSON, "png": lambda: JSON, "cbor": cbor_codec, "bson": bson_codec}
)


class _Stateless(Session):
    """Session that returns all ops and handles none."""

    def _do(self, op: Op, now: float) -> Sequence[Op | Refusal]:
        return (op,)


def parse(
    frame: str | bytes | bytearray | memoryview,
    encoding: EncodingName | None = None,
    *,
    profile: Profile = COMPAT,
    direction: Direction = Direction.BOTH,
    limits: WireLimits = WIRE_LIMITS,
) -> list[Op]:
    """Return the ops of one frame, in order; usually one.

    `fragment` and `png` ops are returned unchanged. With the encoding `png`, the messages in the images are
    returned instead.

    Args:
        frame: the whole frame, as text or as bytes.
        encoding: encoding of the frame; None: CBOR if it begins with the first byte of a map, else JSON.
        profile: version of the protocol.
        direction: possible senders: `TO_SERVER` a client, `TO_CLIENT` a server, `BOTH` either.
        limits: maximum size and depth.

    Raises:
        MalformedMessage: the frame holds something other than messages of that version; the text names the
            member.
        MalformedPayload: the payload of a large message is not JSON.
        EncodingUnavailable: the encoding needs a package that is not installed.
    """
    data = frame.encode("utf-8", "surrogatepass") if isinstance(frame, str) else bytes(frame)
    # Given as the exclusive codec, so that the session does not look for another one by the first byte.
    codec = codec_of(data) if encoding is None else _codec(encoding)
    session = _Stateless(profile, direction, limits, codec)
    ops = [_checked(found) for found in session.decode(data, False, 0.0)]
    if encoding != "png":
        return ops
    return [
        inner
        for op in ops
        for inner in parse(_text_in(op, limits), "json", profile=profile, direction=direction, limits=limits)
    ]


@overload
def dump(op: Op, encoding: Literal["json", "png"] = "json") -> str: ...
@overload
def dump(op: Op, encoding: Literal["cbor", "bson"]) -> bytes: ...
@overload
def dump(op: Op, encoding: EncodingName) -> str | bytes: ...
def dump(op: Op, encoding: EncodingName = "json") -> str | bytes:
    """Encode one op: as text in JSON and PNG, as bytes in CBOR and BSON.

    Writes required and given members, payloads, and members that readers rely on.

    Raises:
        MalformedPayload: a member holds a value that the encoding does not support, such as a lone surrogate.
        EncodingUnavailable: the encoding needs a package that is not installed.
    """
    try:
        # Ops made by `model_construct` are unvalidated, so any value may reach the encoder.
        frame = _codec(encoding).encode(op)
        data = (png.encode(frame) if encoding == "png" else frame).data
    except (ValueError, OverflowError) as error:
        raise MalformedPayload(f"{op.op}: a member that {encoding} has not: {error}") from None
    return data if frame.binary else data.decode()


def _codec(encoding: str) -> Codec:
    if encoding not in _CODECS:
        raise EncodingUnavailable(f"no encoding {encoding!r}: expected one of {', '.join(_CODECS)}")
    return _CODECS[encoding]()


def _checked(found: Op | Refusal) -> Op:
    """Return an op with validated payloads; raises MalformedMessage or MalformedPayload."""
    if isinstance(found, Refusal):
        raise MalformedMessage(found.reason, found.op, found.id, found.name)
    payloads = {name: getattr(found, name) for name in PAYLOADS[found.op]}
    # Here nobody decodes payloads by a message type, which would check them.
    checked = {
        name: payload.validated()
        for name, payload in payloads.items()
        if isinstance(payload, RawJson) and not payload.is_validated
    }
    return found.model_copy(update=checked) if checked else found


def _text_in(op: Op, limits: WireLimits) -> bytes:
    """Return the text in the image of a `png` message; raises MalformedMessage if there is none."""
    if not isinstance(op, Png):
        raise MalformedMessage(f'{op.op}: expected a message "png"', op.op, op.id)
    try:
        return png.decode(op.data, limits.max_message_size)
    except Refused as refused:
        raise MalformedMessage(refused.reason, op.op, op.id) from None
