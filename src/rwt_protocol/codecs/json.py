"""JSON encoding (ENV-01): one UTF-8 object per frame.

Output is compact and does not escape non-ASCII characters. Payloads are spliced in, never encoded here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec
from pydantic import BaseModel

from rwt_protocol.codecs.base import DecodeFailure, Members, PublishEncoder
from rwt_protocol.codecs.envelope import DECODER, PAYLOADS, RELIED_ON
from rwt_protocol.codecs.full_split import split_whole
from rwt_protocol.codecs.head_tail_split import LARGE, split_large
from rwt_protocol.frames import Buffer, Frame
from rwt_protocol.limits import WireLimits, has_more_brackets
from rwt_protocol.ops import OPS, Op
from rwt_protocol.payloads import Encodable, PublishedMessage

_decode: Final = DECODER.decode


def _plain_model(value: object) -> object:
    """Return a nested model, such as `Qos`, as plain objects."""
    if isinstance(value, BaseModel):
        return value.model_dump(exclude_none=True)
    raise TypeError(f"{type(value).__name__} has no JSON")


_encode: Final = msgspec.json.Encoder(enc_hook=_plain_model).encode


class JsonCodec:
    """JSON encoding; see :class:`rwt_protocol.codecs.base.Codec`."""

    def split(self, data: bytes, limits: WireLimits) -> Sequence[Members | DecodeFailure]:
        """Return the messages of a frame, in order. Never raises."""
        size, max_depth = len(data), limits.max_depth
        if size <= 2 * max_depth and data.isascii():
            # The usual frame is one short object, so it cannot be nested too deeply.
            try:
                return (_decode(data),)
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                return split_whole(data, max_depth)
        if size > LARGE:
            most = limits.structure_bytes
            dense = ""
            if size > most and has_more_brackets(data, most // 2):
                dense = f"more than {most} brackets (limits.structure_bytes)"
            members = split_large(data, max_depth, dense)
            if members is not None:
                return (members,)
            # A full parse would make an object for each bracket of the payload.
            if dense:
                return (DecodeFailure(dense),)
        return split_whole(data, max_depth)

    def encode(self, op: Op) -> Frame:
        """Encode an op as a text frame, its members in the order of ENV-16.

        Writes required and given members, payloads, and members that readers rely on; omits None.
        """
        # Bytes collect in `text` until a payload, so that a frame has as few parts as possible.
        text, layout = _LAYOUT[type(op)]
        given = op.model_fields_set
        # Faster than attributes, which Python looks up in the model's class first.
        members = op.__dict__
        parts: list[Buffer] = []
        for name, key, always, is_payload in layout:
            value = members[name]
            if value is None or not (always or name in given):
                continue
            text += key
            if is_payload and not isinstance(value, str):
                parts += (text, value.json())
                text = b""
            else:
                text += _encode(value)
        return Frame(*parts, text + b"}")

    def response(self, service: str, values: Encodable, id: str | int | None = None) -> Frame:
        """Encode the response to a successful call (SRV-01)."""
        end = b',"result":true}' if id is None else b',"result":true,"id":' + _encode(id) + b"}"
        head = b'{"op":"service_response","service":' + _encode(service) + b',"values":'
        return Frame(head, values.json(), end)

    def call(self, service: str, args: Encodable, id: str | int) -> Frame:
        """Encode a call to a provider (SVP-01, SVP-02)."""
        head = b'{"op":"call_service","id":' + _encode(id) + b',"service":' + _encode(service) + b',"args":'
        return Frame(head, args.json(), b"}")

    def publish_encoder(self, topic: str) -> PublishEncoder:
        """Return an encoder for the samples of `topic`."""
        prefix = publish_prefix(topic)

        def encode(sample: PublishedMessage) -> Frame:
            return Frame(prefix, *sample.payload.json_parts(), b"}")

        return encode


def publish_prefix(topic: str, id: str | None = None) -> bytes:
    """Return the bytes before the payload in all messages of `topic`, for the caller to keep."""
    named = b"" if id is None else b',"id":' + _encode(id)
    return b'{"op":"publish"' + named + b',"topic":' + _encode(topic) + b',"msg":'


def publish_frame(prefix: bytes, payload: Buffer) -> Frame:
    """Return a message of the prefix's topic; `payload` is JSON in UTF-8 and is spliced in."""
    return Frame(prefix, payload, b"}")


_Layout = tuple[bytes, tuple[tuple[str, bytes, bool, bool], ...]]


def _layout(model: type[Op]) -> _Layout:
    """Return an op's first bytes, and per member: name, encoded key, is always written, is payload."""
    fields = model.model_fields
    op = str(fields["op"].default)
    payloads = PAYLOADS[op]
    names = model.wire_order or tuple(name for name in fields if name != "op")
    return b'{"op":' + _encode(op), tuple(
        (
            name,
            f',"{name}":'.encode(),
            fields[name].is_required() or name in payloads | RELIED_ON,
            name in payloads,
        )
        for name in names
    )


_LAYOUT: Final = {spec.model: _layout(spec.model) for spec in OPS.values()}
