"""JSON Schema of messages as rosbridge writes them in JSON, for the `jsonschema` channels of MCAP files.

The root is an object and nested messages stand where they are used, without ``$ref``: what reads recordings
(Foxglove, Lichtblick) wants it so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from rwt_interfaces.field_types import Array, Bool, Float, Int, Octets, Shape, String, Time

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

Schema = dict[str, object]


def json_schema(message: MessageType) -> bytes:
    """The schema of one message type, as JSON text."""
    return msgspec.json.encode(_message(message))


def _message(message: MessageType) -> Schema:
    if message.time is not None:
        return _time(message.time)
    return {
        "title": message.name,
        "type": "object",
        "properties": {slot.name: _shape(slot.shape) for slot in message.slots},
    }


def _shape(shape: Shape) -> Schema:
    if isinstance(shape, Octets):
        return {"type": "string", "contentEncoding": "base64"}
    if isinstance(shape, Array):
        found: Schema = {"type": "array", "items": _shape(shape.element)}
        if shape.length is not None:
            found |= {"minItems": shape.length, "maxItems": shape.length}
        elif shape.bound is not None:
            found["maxItems"] = shape.bound
        return found
    if isinstance(shape, Bool):
        return {"type": "boolean"}
    if isinstance(shape, Int):
        return {"type": "integer", "minimum": shape.low, "maximum": shape.high}
    if isinstance(shape, Float):
        return {"type": "number"}
    if isinstance(shape, String):
        return {"type": "string"}
    return _time(shape) if isinstance(shape, Time) else _message(shape.type)


def _time(shape: Time) -> Schema:
    seconds, nanoseconds = shape.keys
    return {
        "title": str(shape),
        "type": "object",
        "properties": {seconds: {"type": "integer"}, nanoseconds: {"type": "integer"}},
    }


__all__ = ["json_schema"]
