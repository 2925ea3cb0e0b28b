"""Generator of a TypeScript module of interfaces, as used by roslib and other clients."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Final

from rwt_interfaces import field_types
from rwt_interfaces.codegen.type_selection import ClassNames, TypeSelection, time_name
from rwt_interfaces.definitions.model import Constant
from rwt_interfaces.field_types import FieldType
from rwt_interfaces.structs import ActionType, MessageType, ServiceType, named_parts

_HEAD: Final = """\
// Typed ROS messages ({distro}), made by `rwt interface generate --lang typescript`: do not edit.
//
// Octets (uint8[]) are base64 in JSON, and a Uint8Array where a topic comes as CBOR.
"""
_RESERVED: Final = (
    "any", "bigint", "boolean", "never", "null", "number", "object", "string", "symbol", "undefined",
    "unknown", "void", "Uint8Array", "MessageTypes", "ServiceTypes", "ActionTypes",
)  # fmt: skip
_LARGEST_EXACT: Final = 2**53


def typescript_stubs(chosen: TypeSelection) -> str:
    """Return the text of the module."""
    return "".join(_TypeScriptStubs(chosen).parts())


class _TypeScriptStubs:
    def __init__(self, chosen: TypeSelection) -> None:
        self._chosen = chosen
        self._names = ClassNames(chosen, _RESERVED)

    def parts(self) -> Iterator[str]:
        registry = self._chosen.registry
        yield _HEAD.format(distro=registry.distro.name)
        for time in self._chosen.times:
            name = time_name(time)
            yield self._interface(name, name.replace("/", "/msg/"), [f"{key}: number;" for key in time.keys])
        for message in self._chosen.messages:
            yield self._message(message)
        yield self._table(
            "MessageTypes",
            [(registry.type_name(each), self._names.of(each.name)) for each in self._chosen.messages],
        )
        for table, types in (("ServiceTypes", self._chosen.services), ("ActionTypes", self._chosen.actions)):
            yield self._table(table, [(registry.type_name(each), self._record(each)) for each in types])

    def _message(self, message: MessageType) -> str:
        lines = [f"{slot.name}: {self._type(slot.type)};{_remark(slot.type)}" for slot in message.slots]
        text = self._interface(message.name, message.registry.type_name(message), lines)
        constants = message.definition.constants
        if not constants:
            return text
        values = "".join(f"  {each.name}: {_constant(each)},\n" for each in constants)
        return f"{text}\nexport const {self._names.of(message.name)} = {{\n{values}}} as const;\n"

    def _interface(self, name: str, ros_type: str, lines: list[str]) -> str:
        body = "".join(f"  {line}\n" for line in lines)
        return f"\n/** {ros_type} */\nexport interface {self._names.of(name)} {{\n{body}}}\n"

    def _table(self, name: str, rows: list[tuple[str, str]]) -> str:
        body = "".join(f"  {json.dumps(ros_type)}: {kind};\n" for ros_type, kind in sorted(rows))
        return f"\n/** Types by their names in ROS. */\nexport interface {name} {{\n{body}}}\n"

    def _record(self, interface: ServiceType | ActionType) -> str:
        parts = named_parts(interface).items()
        return f"{{ {'; '.join(f'{part.lower()}: {self._names.of(each.name)}' for part, each in parts)} }}"

    def _type(self, field_type: FieldType) -> str:
        match field_type:
            case field_types.Bool():
                return "boolean"
            case field_types.Int() | field_types.Float():
                return "number"
            case field_types.String():
                return "string"
            case field_types.Octets():
                return "string | Uint8Array"
            case field_types.Time():
                return self._names.of(time_name(field_type))
            case field_types.Message(type=nested):
                return self._names.of(nested.name if nested.time is None else time_name(nested.time))
            case field_types.Array(element=element):
                return f"{self._type(element)}[]"


def _remark(field_type: FieldType) -> str:
    """Return a comment on what TypeScript cannot express about a field."""
    match field_type:
        case (
            field_types.Bool()
            | field_types.Message()
            | field_types.Time()
            | field_types.String(bound=None)
            | field_types.Float()
        ):
            return ""
        case field_types.Array(
            element=field_types.Message() | field_types.Time() | field_types.String(bound=None)
        ) if field_type.length is None and field_type.bound is None:
            return ""
        case _:
            return f" // {field_type}"


def _constant(constant: Constant) -> str:
    value = constant.value
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else f"{'-' if value < 0 else ''}Infinity"
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > _LARGEST_EXACT:
        return f"{value} as number"
    return json.dumps(value)
