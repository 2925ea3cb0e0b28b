"""Message types as JSON Schema (2020-12), each once per direction: sent and received."""

from __future__ import annotations

from typing import Final

from rwt_interfaces import field_types
from rwt_interfaces.field_types import FieldType, Slot
from rwt_interfaces.structs import MessageType

Schema = dict[str, object]

_SEXTET: Final = "[A-Za-z0-9+/]"

INCOMING: Final = ".Input"
"""Suffix of the name of a received type's schema, in which missing fields take their defaults."""


class Schemas:
    """Schemas of the requested types and their nested types, for a place given as a JSON Pointer.

    Attributes:
        found: by name; a name is that of the type with a dot for its slash.
    """

    def __init__(self, place: str = "#/components/schemas/") -> None:
        self.found: dict[str, Schema] = {}
        self._place = place

    def reference(self, message: MessageType, *, incoming: bool = False) -> Schema:
        """Return a reference to the schema of a message; in an `incoming` one, fields may be left out."""
        time = message.time
        if time is not None:
            return self._time(time, incoming=incoming)
        name = message.name.replace("/", ".") + (INCOMING if incoming else "")
        if name not in self.found:
            self.found[name] = {}  # Reserve its position before nested types.
            self.found[name] = self._object(message, incoming=incoming)
        return {"$ref": self._place + name}

    def _object(self, message: MessageType, *, incoming: bool) -> Schema:
        properties = {slot.name: self._field(slot, incoming=incoming) for slot in message.slots}
        # No title: generators would give both forms of a type the same name.
        constants = [f"{each.name} = {each.value!r}" for each in message.definition.constants]
        name = message.registry.type_name(message)
        schema: Schema = {
            "type": "object",
            "description": f"{name}; constants: {', '.join(constants)}" if constants else name,
            "properties": properties,
            "additionalProperties": False,
        }
        if properties and not incoming:
            schema["required"] = list(properties)
        return schema

    def _field(self, slot: Slot, *, incoming: bool) -> Schema:
        schema = self._of(slot.type, incoming=incoming)
        if incoming and isinstance(slot.default, bool | int | float | str):
            schema = {**schema, "default": slot.default}
        return schema

    def _of(self, type: FieldType, *, incoming: bool) -> Schema:
        match type:
            case field_types.Bool():
                return {"type": "boolean"}
            case field_types.Int():
                return {"type": "integer", "minimum": type.low, "maximum": type.high}
            case field_types.Float():
                # NaN and infinities are null, both ways.
                return {"type": ["number", "null"], "format": "float" if type.code == "f" else "double"}
            case field_types.String():
                return {"type": "string"} | ({} if type.bound is None else {"maxLength": type.bound})
            case field_types.Time():
                return self._time(type, incoming=incoming)
            case field_types.Octets():
                return {"type": "string", "contentEncoding": "base64", "pattern": _base64(type.length)}
            case field_types.Message():
                return self.reference(type.type, incoming=incoming)
            case field_types.Array():
                return self._array(type, incoming=incoming)

    def _array(self, type: field_types.Array, *, incoming: bool) -> Schema:
        schema: Schema = {"type": "array", "items": self._of(type.element, incoming=incoming)}
        if type.length is not None:
            schema["minItems"] = schema["maxItems"] = type.length
        elif type.bound is not None:
            schema["maxItems"] = type.bound
        return schema

    def _time(self, type: field_types.Time, *, incoming: bool) -> Schema:
        kind = "Duration" if type.is_duration else "Time"
        name = f"builtin_interfaces.{kind}" + (INCOMING if incoming else "")
        if name not in self.found:
            numbers = zip(type.keys, (type.seconds, type.nanoseconds), strict=True)
            schema: Schema = {
                "type": "object",
                "properties": {key: self._of(number, incoming=incoming) for key, number in numbers},
            }
            if not incoming:  # Other members of a received time are ignored (JSN-05).
                schema["required"] = list(type.keys)
                schema["additionalProperties"] = False
            self.found[name] = schema
        return {"$ref": self._place + name}


def _base64(length: int | None) -> str:
    """Return the pattern of so many octets in padded base64 (RFC 4648 section 4); None: any number."""
    if length is None:
        return f"^({_SEXTET}{{4}})*({_SEXTET}{{2}}==|{_SEXTET}{{3}}=)?$"
    rest = ("", "{2}==", "{3}=")[length % 3]
    return f"^({_SEXTET}{{4}}){{{length // 3}}}{_SEXTET + rest if rest else ''}$"


def document(message: MessageType) -> Schema:
    """Return the stand-alone schema of one type, with nested types as its `$defs`."""
    schemas = Schemas("#/$defs/")
    reference = schemas.reference(message)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **reference, "$defs": schemas.found}
