"""The JSON encoding (ENV-01): one object a frame, in UTF-8.

On the way out text is compact, and characters beyond ASCII are written as themselves, not as escapes. A
payload is never encoded here: its bytes are spliced in.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec
from pydantic import BaseModel

from rwt_protocol.codecs.base import Fault, Members
from rwt_protocol.codecs.envelope import DECODER, PAYLOADS, RELIED_ON
from rwt_protocol.codecs.full_split import split_whole
from rwt_protocol.codecs.head_tail_split import LARGE, split_large
from rwt_protocol.decoded import Decoded
from rwt_protocol.ops import OPS, Op
from rwt_protocol.rawjson import RawJson
from rwt_protocol.transport import Buffer, Frame

_decode: Final = DECODER.decode
_encode: Final = msgspec.json.Encoder().encode


class JsonCodec:
    """The JSON encoding; see :class:`rwt_protocol.codecs.base.Codec`."""

    name: Final = "json"

    def split(self, data: bytes, max_depth: int) -> Sequence[Members | Fault]:
        """The messages in one frame, in order. Never raises."""
        size = len(data)
        if size <= 2 * max_depth and data.isascii():
            # The usual frame: short, so not deep, and of one object.
            try:
                return (_decode(data),)
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                return split_whole(data, max_depth)
        if size > LARGE:
            members = split_large(data, max_depth)
            if members is not None:
                return (members,)
        return split_whole(data, max_depth)

    def encode(self, op: Op) -> Frame:
        """One op as a text frame, its members in the order of ENV-16.

        Written are the members that the model requires, that were given, payloads, and what readers rely on;
        a member that is None is left out.
        """
        parts: list[Buffer] = []
        text = b'{"op":' + _encode(op.op)
        given = op.model_fields_set
        for name, key, always in _LAYOUT[type(op)]:
            value: object = getattr(op, name)
            if value is None or not (always or name in given):
                continue
            text += key
            if isinstance(value, RawJson):
                parts += (text, value.proven().data)
                text = b""
            elif isinstance(value, Decoded):
                text += _encode(value.value)
            else:
                text += _encode(
                    value.model_dump(exclude_none=True) if isinstance(value, BaseModel) else value
                )
        return Frame(*parts, text + b"}")


def publish_prefix(topic: str) -> bytes:
    """What stands before the payload in every message of `topic`: computed once, kept by the caller."""
    return b'{"op":"publish","topic":' + _encode(topic) + b',"msg":'


def publish_frame(prefix: bytes, payload: Buffer) -> Frame:
    """One message of the topic of `prefix`; `payload` is JSON in UTF-8, and is spliced in."""
    return Frame(prefix, payload, b"}")


def response_frame(service: str, values: Buffer, id: str | int | None = None) -> Frame:  # as on the wire
    """The reply to a call that succeeded; `values` is JSON in UTF-8, and is spliced in (SRV-01)."""
    end = b',"result":true}' if id is None else b',"result":true,"id":' + _encode(id) + b"}"
    return Frame(b'{"op":"service_response","service":' + _encode(service) + b',"values":', values, end)


def call_frame(service: str, args: Buffer, id: str | int) -> Frame:  # as on the wire
    """A call to a provider; `args` is JSON in UTF-8, and is spliced in (SVP-01, SVP-02)."""
    head = b'{"op":"call_service","id":' + _encode(id) + b',"service":' + _encode(service) + b',"args":'
    return Frame(head, args, b"}")


def _layout(model: type[Op]) -> tuple[tuple[str, bytes, bool], ...]:
    """Name, written key, and whether it is always written, of each member in the order of the wire."""
    fields = model.model_fields
    name_of_op = str(fields["op"].default)
    always = PAYLOADS[name_of_op] | RELIED_ON
    names = model.wire_order or tuple(name for name in fields if name != "op")
    return tuple(
        (name, f',"{name}":'.encode(), fields[name].is_required() or name in always) for name in names
    )


_LAYOUT: Final = {spec.model: _layout(spec.model) for spec in OPS.values()}
