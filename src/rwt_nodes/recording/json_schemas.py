"""JSON Schema of messages as rosbridge writes them in JSON, for the `jsonschema` channels of MCAP files.

The root is an object and nested messages stand where they are used, without ``$ref``: what reads recordings
(Foxglove, Lichtblick) wants it so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from rwt_interfaces.field_types import Array, Bool, FieldType, Float, Int, Octets, String, Time

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
        "properties": {slot.name: _schema(slot.type) for slot in message.slots},
    }


def _schema(field_type: FieldType) -> Schema:
    if isinstance(field_type, Octets):
        return {"type": "string", "contentEncoding": "base64"}
    if isinstance(field_type, Array):
        found: Schema = {"type": "array", "items": _schema(field_type.element)}
        if field_type.length is not None:
            found |= {"minItems": field_type.length, "maxItems": field_type.length}
        elif field_type.bound is not None:
            found["maxItems"] = field_type.bound
        return found
    if isinstance(field_type, Bool):
        return {"type": "boolean"}
    if isinstance(field_type, Int):
        return {"type": "integer", "minimum": field_type.low, "maximum": field_type.high}
    if isinstance(field_type, Float):
        return {"type": "number"}
    if isinstance(field_type, String):
        return {"type": "string"}
    return _time(field_type) if isinstance(field_type, Time) else _message(field_type.type)


def _time(field_type: Time) -> Schema:
    seconds, nanoseconds = field_type.keys
    return {
        "title": str(field_type),
        "type": "object",
        "properties": {seconds: {"type": "integer"}, nanoseconds: {"type": "integer"}},
    }


__all__ = ["json_schema"]
