"""JSON Schema of types that viewers cannot read in the robot's serialisation; these are sent as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rwt_interfaces import field_types

if TYPE_CHECKING:
    from rwt_interfaces.field_types import FieldType
    from rwt_interfaces.structs import MessageType

Schema = dict[str, object]

_MAX_FIELDS: Final = 10_000
"""Maximum number of fields of a schema; nested types count at each use."""


def schema_where_needed(message: MessageType) -> Schema | None:
    """Return the JSON Schema of a type with a ``wstring``; None for other types and for too large schemas.

    DDS leaves the encoding of ``wstring`` open (OMG DDS-XTypes 1.3, section 7.4.1), so Foxglove and
    Lichtblick reject such types. They only read schemas with inlined types and one type per value.
    """
    if not _has_wide(message, set()):
        return None
    try:
        return _Schemas().of_message(message)
    except _TooLarge:
        return None


def _has_wide(message: MessageType, seen: set[str]) -> bool:
    """Return True if a type outside `seen` has a ``wstring``."""
    if message.name in seen:
        return False
    seen.add(message.name)
    for slot in message.slots:
        type = slot.type.element if isinstance(slot.type, field_types.Array) else slot.type
        if isinstance(type, field_types.String) and type.wide:
            return True
        if isinstance(type, field_types.Message) and _has_wide(type.type, seen):
            return True
    return False


class _TooLarge(Exception):
    """Schema with too many fields."""


class _Schemas:
    """Builder of one schema, which counts its fields."""

    def __init__(self) -> None:
        self._fields = 0

    def of_message(self, message: MessageType) -> Schema:
        self._fields += len(message.slots)
        if self._fields > _MAX_FIELDS:
            raise _TooLarge
        return {"type": "object", "properties": {slot.name: self._of(slot.type) for slot in message.slots}}

    def _of(self, type: FieldType) -> Schema:
        match type:
            case field_types.Bool():
                return {"type": "boolean"}
            case field_types.Int():
                return {"type": "integer", "minimum": type.low, "maximum": type.high}
            case field_types.Float():
                return {"type": "number"}
            case field_types.String():
                return {"type": "string"}
            case field_types.Octets():
                return {"type": "string", "contentEncoding": "base64"}
            case field_types.Time():
                return {"type": "object", "properties": {key: {"type": "integer"} for key in type.keys}}
            case field_types.Message():
                return self.of_message(type.type)
            case field_types.Array():
                return {"type": "array", "items": self._of(type.element)}
