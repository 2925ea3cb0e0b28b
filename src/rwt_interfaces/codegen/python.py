"""Generator of a Python module of pydantic models without other dependencies."""

from __future__ import annotations

import keyword
import math
from collections.abc import Iterator
from typing import Final, cast

from pydantic import BaseModel

from rwt_interfaces import field_types
from rwt_interfaces.codegen.type_selection import ClassNames, TypeSelection, time_name
from rwt_interfaces.definitions.model import Constant
from rwt_interfaces.field_types import FieldType, Slot
from rwt_interfaces.struct_fields import default_maker, slot_default
from rwt_interfaces.structs import ActionType, MessageType, ServiceType, named_parts

_HEAD: Final = '''\
"""Typed ROS messages ({distro}), made by `rwt interface generate --lang python`: do not edit.

Every field has a default. `Twist.model_validate_json(text)` reads what rosbridge sends, and
`twist.model_dump_json()` writes what it takes.
"""

from __future__ import annotations

import base64
import math
import typing

import pydantic

__all__ = [{names}]


def _from_base64(value: object) -> object:
    """Octets as rosbridge sends them: base64, or a list of numbers."""
    if isinstance(value, str):
        return base64.b64decode(value, validate=True)
    return bytes(value) if isinstance(value, list) else value


def _to_base64(octets: bytes) -> str:
    return base64.b64encode(octets).decode()


def _from_null(value: object) -> object:
    """JSON has no NaN, so rosbridge sends null."""
    return math.nan if value is None else value


_Bool = typing.Annotated[bool, pydantic.Field(strict=True)]
{ints}
_Float = typing.Annotated[float, pydantic.BeforeValidator(_from_null), pydantic.Field(strict=True)]
_String = typing.Annotated[str, pydantic.Field(strict=True)]
_Octets = typing.Annotated[
    bytes,
    pydantic.BeforeValidator(_from_base64),
    pydantic.PlainSerializer(_to_base64, return_type=str, when_used="json"),
]


class _Message(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", serialize_by_alias=True, validate_assignment=True)
'''
_INT: Final = "_{name} = typing.Annotated[int, pydantic.Field(strict=True, ge={low}, le={high})]"
_BITS: Final = (8, 16, 32, 64)

#: Reserved field names: those of pydantic, and those that annotations refer to.
_TAKEN: Final = frozenset(dir(BaseModel)) | frozenset(
    {"bytes", "int", "float", "str", "bool", "list", "typing", "pydantic", "math", "base64", "ROS_TYPE"}
)


def python_stubs(chosen: TypeSelection) -> str:
    """Return the text of the module."""
    return _PythonStubs(chosen).text()


class _PythonStubs:
    def __init__(self, chosen: TypeSelection) -> None:
        self._chosen = chosen
        self._names = ClassNames(chosen, keyword.kwlist)
        self._taken = _TAKEN | self._names.all()

    def text(self) -> str:
        head = _HEAD.format(
            distro=self._chosen.registry.distro.name,
            names=", ".join(f'"{name}"' for name in sorted(self._names.all())),
            ints="\n".join(_int_types()),
        )
        return f"{head}{''.join(self._classes())}"

    def _classes(self) -> Iterator[str]:
        for time in self._chosen.times:
            yield self._time(time)
        for message in self._chosen.messages:
            yield self._message(message)
        yield from map(self._parts, self._chosen.services)
        yield from map(self._parts, self._chosen.actions)

    def _time(self, time: field_types.Time) -> str:
        halves = zip(time.keys, (time.seconds, time.nanoseconds), strict=True)
        lines = [f"{key}: _{half.name.capitalize()} = 0" for key, half in halves]
        return self._class(time_name(time), f"{time_name(time).replace('/', '/msg/')}", lines)

    def _message(self, message: MessageType) -> str:
        lines = [self._constant(constant) for constant in message.definition.constants]
        lines += [self._field(slot) for slot in message.slots]
        return self._class(message.name, message.registry.type_name(message), lines)

    def _class(self, name: str, ros_type: str, lines: list[str]) -> str:
        body = "\n    ".join([f'ROS_TYPE: typing.ClassVar[str] = "{ros_type}"', *lines])
        return f'\n\nclass {self._names.of(name)}(_Message):\n    """{ros_type}."""\n\n    {body}\n'

    def _parts(self, interface: ServiceType | ActionType) -> str:
        ros_type = self._chosen.registry.type_name(interface)
        lines = [f'ROS_TYPE: typing.ClassVar[str] = "{ros_type}"']
        parts = named_parts(interface).items()
        lines += [f"{part} = {self._names.of(message.name)}" for part, message in parts]
        body = "\n    ".join(lines)
        return f'\n\nclass {self._names.of(interface.name)}:\n    """{ros_type}."""\n\n    {body}\n'

    def _constant(self, constant: Constant) -> str:
        name = f"{constant.name}_" if self._is_taken(constant.name) else constant.name
        kind = type(constant.value).__name__
        return f"{name}: typing.ClassVar[{kind}] = {_literal(constant.value)}"

    def _is_taken(self, name: str) -> bool:
        return keyword.iskeyword(name) or name in self._taken or name.startswith("model_")

    def _field(self, slot: Slot) -> str:
        kind, default = self._type(slot.type), self._default(slot)
        if not self._is_taken(slot.name):
            if default.startswith("default"):
                return f"{slot.name}: {kind} = pydantic.Field({default})"
            return f"{slot.name}: {kind} = {default}"
        names = (
            f'validation_alias=pydantic.AliasChoices("{slot.name}", "{slot.name}_"), '
            f'serialization_alias="{slot.name}"'
        )
        given = default if default.startswith("default") else f"default={default}"
        return f"{slot.name}_: {kind} = pydantic.Field({given}, {names})"

    def _type(self, field_type: FieldType) -> str:
        match field_type:
            case field_types.Bool():
                return "_Bool"
            case field_types.Int():
                bits = (field_type.high - field_type.low).bit_length()
                return f"_{'Int' if field_type.low < 0 else 'Uint'}{bits}"
            case field_types.Float():
                return "_Float"
            case field_types.String(bound=bound):
                return "_String" if bound is None else _bounded("_String", 0, bound)
            case field_types.Octets(length=length):
                return "_Octets" if length is None else _bounded("_Octets", length, length)
            case field_types.Time():
                return self._names.of(time_name(field_type))
            case field_types.Message(type=nested):
                return self._names.of(nested.name if nested.time is None else time_name(nested.time))
            case field_types.Array(element=element, length=length, bound=bound):
                items = f"list[{self._type(element)}]"
                most = length if length is not None else bound
                return items if most is None else _bounded(items, length or 0, most)

    def _default(self, slot: Slot) -> str:
        """Return the default as an expression, or as ``default_factory=…`` if it is mutable."""
        if isinstance(slot.type, field_types.Message | field_types.Time):
            return f"default_factory={self._type(slot.type)}"
        if not isinstance(slot.type, field_types.Array):
            return _literal(slot_default(slot)())
        length = slot.type.length or 0
        if slot.default is not None:
            values = cast("list[object]", slot_default(slot)())
            items = [_literal(value) for value in values]
            return f"default_factory=lambda: [{', '.join(items)}]"
        if not length:
            return f"default_factory=list[{self._type(slot.type.element)}]"
        if isinstance(slot.type.element, field_types.Message | field_types.Time):
            return f"default_factory=lambda: [{self._type(slot.type.element)}() for _ in range({length})]"
        return f"default_factory=lambda: [{_literal(default_maker(slot.type.element)())}] * {length}"


def _literal(value: object) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return "math.nan" if math.isnan(value) else f"{'-' if value < 0 else ''}math.inf"
    if isinstance(value, bytes) and len(value) > 8 and not any(value):
        return f"bytes({len(value)})"
    return repr(value)


def _bounded(kind: str, least: int, most: int) -> str:
    bounds = f"min_length={least}, max_length={most}" if least else f"max_length={most}"
    return f"typing.Annotated[{kind}, pydantic.Field({bounds})]"


def _int_types() -> Iterator[str]:
    for bits in _BITS:
        yield _INT.format(name=f"Int{bits}", low=-(1 << bits - 1), high=(1 << bits - 1) - 1)
        yield _INT.format(name=f"Uint{bits}", low=0, high=(1 << bits) - 1)
