"""Message definitions in rosapi's form: a flat list of TypeDefs, the requested type first (API-03)."""

from __future__ import annotations

from rwt.nodes.rosapi.service import CONVENTIONS
from rwt_interfaces.definitions.model import Field, MessageDefinition, WrittenType
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType

TypeDef = dict[str, str | list[str] | list[int]]

#: ROS 2's rosapi names scalars as IDL does (API-04).
_IDL_NAMES = {"bool": "boolean", "float32": "float", "float64": "double", "byte": "octet", "char": "uint8"}

#: ROS 1's times are not messages, but rosapi describes them as messages (API-03).
_TIMES: dict[str, TypeDef] = {
    name: {
        "type": name,
        "fieldnames": ["secs", "nsecs"],
        "fieldtypes": [half, half],
        "fieldarraylen": [-1, -1],
        "examples": ["0", "0"],
        "constnames": [],
        "constvalues": [],
    }
    for name, half in (("time", "uint32"), ("duration", "int32"))
}


def typedefs(message: MessageType, registry: Registry) -> list[TypeDef]:
    """Return the message and its nested messages, depth first, each once."""
    found: dict[str, TypeDef] = {}
    _collect(message.definition, registry, found)
    return list(found.values())


def _collect(definition: MessageDefinition, registry: Registry, found: dict[str, TypeDef]) -> None:
    found[definition.name] = _typedef(definition, registry)
    for field in definition.fields:
        name = field.type.name
        if name in found:
            continue
        if name in _TIMES:
            found[name] = _TIMES[name]
        elif not field.type.is_primitive:
            _collect(registry.definition(name), registry, found)


def _typedef(definition: MessageDefinition, registry: Registry) -> TypeDef:
    idl = CONVENTIONS[registry.distro.name].has_idl_names
    return {
        "type": definition.name,
        "fieldnames": [field.name for field in definition.fields],
        "fieldtypes": [
            _IDL_NAMES.get(field.type.name, field.type.name) if idl else field.type.name
            for field in definition.fields
        ],
        "fieldarraylen": [_array_length(field.type) for field in definition.fields],
        "examples": [_example(field) for field in definition.fields],
        "constnames": [constant.name for constant in definition.constants],
        "constvalues": [str(constant.value) for constant in definition.constants],
    }


def _array_length(field: WrittenType) -> int:
    """Return -1 for a scalar, 0 for a sequence, N for an array of N."""
    if not field.is_array:
        return -1
    return field.length or 0


def _example(field: Field) -> str:
    """Return the text of a field's default value (API-05)."""
    kind = field.type
    if kind.is_array:
        return "[]"
    if not kind.is_primitive or kind.name in _TIMES:
        return "{}"
    if field.default is not None:
        return str(field.default)
    if kind.name in ("string", "wstring"):
        return ""
    if kind.name == "bool":
        return "False"
    return "0.0" if kind.name.startswith("float") else "0"
