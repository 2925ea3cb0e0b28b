"""Type hashes of definitions: ROS 1's MD5 sum and ROS 2's type hash (RIHS01, REP 2016)."""

from __future__ import annotations

import hashlib
import json
from typing import TypedDict

from rwt_interfaces.definitions.actionlib import EVENT
from rwt_interfaces.definitions.model import Field, MessageDefinition, ServiceDefinition, WrittenType
from rwt_interfaces.definitions.parser import format_type
from rwt_interfaces.names import three_part
from rwt_interfaces.registry import Registry

_TIMES = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}
_PRIMITIVE_TIMES = {name: primitive for primitive, name in _TIMES.items()}
_TIME_FIELDS: tuple[Field, ...] = (
    Field("sec", WrittenType("int32")),
    Field("nanosec", WrittenType("uint32")),
)

#: Type numbers of RIHS01. A `char` of a .msg file is an octet of the wire, which RIHS01 sees as uint8.
NUMBERS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9,
    "float32": 10, "float64": 11, "char": 3, "bool": 15, "byte": 16, "string": 17, "wstring": 18,
}  # fmt: skip
_NESTED = 1
#: A bounded string is a different type: 17 becomes 21, 18 becomes 22.
_BOUNDED_STRING = 4
_ARRAY, _BOUNDED_SEQUENCE, _SEQUENCE = 48, 96, 144
#: Member of ROS 2 messages without fields, because C has no empty struct.
FILLER = Field("structure_needs_at_least_one_member", WrittenType("uint8"))


def md5(definition: MessageDefinition, lookup: Registry) -> str:
    """Return ROS 1's MD5 sum of a message, 32 hexadecimal digits; raises UnknownType."""
    return _md5(_md5_text(definition, lookup, {}))


def service_md5(definition: ServiceDefinition, lookup: Registry) -> str:
    """Return ROS 1's MD5 sum of a service, 32 hexadecimal digits; raises UnknownType."""
    parts = (definition.request, definition.response)
    return _md5("".join(_md5_text(part, lookup, {}) for part in parts))


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


def _md5_text(definition: MessageDefinition, lookup: Registry, known: dict[str, str]) -> str:
    lines = [f"{item.type.name} {item.name}={item.text}" for item in definition.constants]
    for item in definition.fields:
        name = item.type.name
        if item.type.is_primitive:
            lines.append(f"{format_type(item.type)} {item.name}")
        elif name in _PRIMITIVE_TIMES:
            lines.append(f"{format_type(item.type).replace(name, _PRIMITIVE_TIMES[name], 1)} {item.name}")
        else:
            if name not in known:
                known[name] = _md5(_md5_text(lookup.definition(name), lookup, known))
            lines.append(f"{known[name]} {item.name}")
    return "\n".join(lines)


class FieldType(TypedDict):
    """Type of a field as RIHS01 describes it, with the numbers of `type_description_interfaces`."""

    type_id: int
    capacity: int
    string_capacity: int
    nested_type_name: str


class FieldDescription(TypedDict):
    """Field as RIHS01 describes it."""

    name: str
    type: FieldType


class Individual(TypedDict):
    """One message or service as RIHS01 describes it."""

    type_name: str
    fields: list[FieldDescription]


class Description(TypedDict):
    """Type with all that it contains, sorted by name: what RIHS01 hashes."""

    type_description: Individual
    referenced_type_descriptions: list[Individual]


def description(definition: MessageDefinition, lookup: Registry) -> Description:
    """Return ROS 2's description of a message; raises UnknownType."""
    nested: dict[str, Individual] = {}
    described = _described(lookup.full_name(definition.name), definition.fields, lookup, nested)
    return _description(described, nested)


def service_description(definition: ServiceDefinition, full_name: str, lookup: Registry) -> Description:
    """Return ROS 2's description of a service with that three-part name; raises UnknownType."""
    parts = {
        "request": definition.request.name,
        "response": definition.response.name,
        "event": f"{definition.name}{EVENT}",
    }
    fields = tuple(Field(f"{part}_message", WrittenType(name)) for part, name in parts.items())
    nested: dict[str, Individual] = {}
    return _description(_described(full_name, fields, lookup, nested), nested)


def rihs01(definition: MessageDefinition, lookup: Registry) -> str:
    """Return ROS 2's type hash: ``RIHS01_`` and 64 hexadecimal digits; raises UnknownType."""
    return hash_of(description(definition, lookup))


def service_rihs01(definition: ServiceDefinition, full_name: str, lookup: Registry) -> str:
    """Return ROS 2's type hash of a service with that three-part name; raises UnknownType."""
    return hash_of(service_description(definition, full_name, lookup))


def hash_of(description: Description) -> str:
    """Return the type hash of a description: ``RIHS01_`` and 64 hexadecimal digits."""
    return f"RIHS01_{hashlib.sha256(json.dumps(description).encode()).hexdigest()}"


def _description(described: Individual, nested: dict[str, Individual]) -> Description:
    return {
        "type_description": described,
        "referenced_type_descriptions": [nested[name] for name in sorted(nested)],
    }


def _described(
    name: str, fields: tuple[Field, ...], lookup: Registry, nested: dict[str, Individual]
) -> Individual:
    return {
        "type_name": name,
        "fields": [
            {"name": field.name, "type": _field_type(field.type, lookup, nested)}
            for field in fields or (FILLER,)
        ],
    }


def _field_type(field_type: WrittenType, lookup: Registry, nested: dict[str, Individual]) -> FieldType:
    if field_type.is_primitive and field_type.name not in _TIMES:
        number, nested_name = NUMBERS[field_type.name], ""
        if field_type.string_bound is not None:
            number += _BOUNDED_STRING
    else:
        number, nested_name = _NESTED, _nested(field_type.name, lookup, nested)
    if field_type.is_array:
        unbounded = field_type.length is None and field_type.bound is None
        number += _SEQUENCE if unbounded else _BOUNDED_SEQUENCE if field_type.length is None else _ARRAY
    return {
        "type_id": number,
        "capacity": field_type.length or field_type.bound or 0,
        "string_capacity": field_type.string_bound or 0,
        "nested_type_name": nested_name,
    }


def _nested(name: str, lookup: Registry, nested: dict[str, Individual]) -> str:
    """Describe a nested message once, and return its three-part name."""
    # ROS 1's time is a primitive; RIHS01 only knows the message that replaced it.
    full = three_part(_TIMES[name], "msg") if name in _TIMES else lookup.full_name(name)
    if full not in nested:
        fields = _TIME_FIELDS if name in _TIMES else lookup.definition(name).fields
        nested[full] = {"type_name": full, "fields": []}  # A message that contains itself ends here.
        nested[full] = _described(full, fields, lookup, nested)
    return full
