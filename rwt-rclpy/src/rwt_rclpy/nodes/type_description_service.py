"""`rclpy.type_description_service`: `~/get_type_description`, which describes types."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.structs import MessageType
from rwt_rclpy.messages.loaded import classes, message_class

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node

START_TYPE_DESCRIPTION_SERVICE_PARAM = "start_type_description_service"


class TypeDescriptionService:
    """Type description service of a node, unless `start_type_description_service` is false."""

    def __init__(self, node: Node) -> None:
        name = START_TYPE_DESCRIPTION_SERVICE_PARAM
        if not node.has_parameter(name):
            descriptor = message_class("rcl_interfaces/ParameterDescriptor")(
                description="If enabled, start the ~/get_type_description service.", read_only=True
            )
            node.declare_parameter(name, True, descriptor)
        self.enabled = bool(node.get_parameter(name).value)
        self.service_name = f"{node._rwt_full_name}/get_type_description"
        if self.enabled:
            service = classes().service("type_description_interfaces/GetTypeDescription")
            node.create_service(service, self.service_name, self._answer)

    def _answer(self, request: Any, response: Any) -> Any:
        registry = classes().registry
        try:
            message = registry.message(request.type_name)
        except InterfaceError as error:
            response.failure_reason = str(error)
            return response
        if request.type_hash and request.type_hash != message.rihs01:
            response.failure_reason = f"{request.type_name} has the hash {message.rihs01} here"
            return response
        described = message_class("type_description_interfaces/TypeDescription")()
        described.type_description = _individual(message)
        nested = _nested(message)
        described.referenced_type_descriptions = [_individual(each) for each in nested]
        response.type_description = described
        if request.include_type_sources:
            source = message_class("type_description_interfaces/TypeSource")
            response.type_sources = [
                source(
                    type_name=registry.type_name(each), encoding="msg", raw_file_contents=each.definition.text
                )
                for each in (message, *nested)
            ]
        response.successful = True
        return response


def _nested(message: MessageType) -> list[MessageType]:
    found: dict[str, MessageType] = {}

    def collect(one: MessageType) -> None:
        for field in one.definition.fields:
            if not field.type.is_primitive and field.type.name not in found:
                found[field.type.name] = one.registry.message(field.type.name)
                collect(found[field.type.name])

    collect(message)
    return [found[name] for name in sorted(found)]


def _individual(message: MessageType) -> Any:
    """Return one message as `type_description_interfaces/IndividualTypeDescription`."""
    field_class = message_class("type_description_interfaces/Field")
    type_class = message_class("type_description_interfaces/FieldType")
    fields = []
    for field in message.definition.fields:
        written = field.type
        kind = _type_id(written.name, written.string_bound, array=written)
        fields.append(
            field_class(
                name=field.name,
                type=type_class(
                    type_id=kind,
                    capacity=written.length or written.bound or 0,
                    string_capacity=written.string_bound or 0,
                    nested_type_name=""
                    if written.is_primitive
                    else message.registry.type_name(message.registry.message(written.name)),
                ),
                default_value="" if field.default is None else str(field.default),
            )
        )
    individual = message_class("type_description_interfaces/IndividualTypeDescription")
    return individual(type_name=message.registry.type_name(message), fields=fields)


#: `type_description_interfaces/FieldType` of scalars; arrays add 48, bounded sequences 96, others 144.
_TYPE_IDS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9,
    "float32": 10, "float64": 11, "char": 13, "bool": 15, "byte": 16, "string": 17, "wstring": 18,
}  # fmt: skip


def _type_id(name: str, string_bound: int | None, *, array: Any) -> int:
    kind = _TYPE_IDS.get(name, 1)
    if string_bound is not None:
        kind += 4
    if array.is_array:
        kind += 48 if array.length is not None else 96 if array.bound is not None else 144
    return kind


__all__ = ["START_TYPE_DESCRIPTION_SERVICE_PARAM", "TypeDescriptionService"]
