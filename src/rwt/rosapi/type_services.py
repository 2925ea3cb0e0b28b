"""Services about types: names, fields and constants."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from rwt.rosapi.service import CONVENTIONS, Answer, Service
from rwt_graph.disclosure import NOTHING
from rwt_graph.nodes.node import Node
from rwt_interfaces.definitions.model import Field, MessageDefinition, WrittenType
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.names import KINDS, Kind
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import ServiceFailed

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
    idl = CONVENTIONS[registry.distro.conventions].has_idl_names
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


def interfaces(node: Node, _: Any) -> Answer:
    """Return the names of all known messages, services and actions."""
    spell = node.graph.registry.distro.type_name
    return {
        "interfaces": sorted(spell(name, kind) for kind in KINDS for name in node.graph.registry.names(kind))
    }


def _details(kind: Kind, part: str) -> Callable[[Node, Any], Answer]:
    def answer(node: Node, request: Any) -> Answer:
        registry = node.graph.registry
        find = {"msg": registry.message, "srv": registry.service, "action": registry.action}[kind]
        try:
            known = find(request.type)
        except InterfaceError as error:
            raise ServiceFailed(str(error)) from error
        message = known if isinstance(known, MessageType) else getattr(known, part)
        return {"typedefs": typedefs(message, registry)}

    return answer


SERVICES: Final = (
    Service("message_details", "MessageDetails", _details("msg", ""), NOTHING),
    Service("service_request_details", "ServiceRequestDetails", _details("srv", "request"), NOTHING),
    Service("service_response_details", "ServiceResponseDetails", _details("srv", "response"), NOTHING),
    Service("action_goal_details", "ActionGoalDetails", _details("action", "goal"), NOTHING),
    Service("action_result_details", "ActionResultDetails", _details("action", "result"), NOTHING),
    Service("action_feedback_details", "ActionFeedbackDetails", _details("action", "feedback"), NOTHING),
    Service("interfaces", "Interfaces", interfaces, NOTHING),
)
