"""`rclpy.serialization`: messages as CDR."""

from __future__ import annotations

from typing import Any

from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_rclpy.endpoints.type_support import message_type as type_behind
from rwt_rclpy.exceptions import RMWError
from rwt_rclpy.messages.classes import Message


def serialize_message(message: Any) -> bytes:
    """Return a message in CDR, with its encapsulation header."""
    return payload_of(message).cdr()


def deserialize_message(serialized_message: bytes, message_type: Any) -> Any:
    """Return a message from CDR. Raises RMWError for what is none of that type."""
    kind = type_behind(message_type)
    if not isinstance(serialized_message, (bytes, bytearray, memoryview)):
        raise TypeError(
            "rclpy_deserialize(): incompatible function arguments. The following argument types are"
            f" supported:\n    bytes, not {type(serialized_message).__name__}"
        )
    try:
        return message_of(Payload.from_cdr(kind, bytes(serialized_message)), message_type)
    except InvalidMessage as error:
        package, _, name = kind.name.partition("/")
        raise RMWError(
            "failed to deserialize ROS message: Fast CDR exception deserializing message of type"
            f" {package}::msg::dds_::{name}_.\n    {error}"
        ) from error


def payload_of(message: Message) -> Payload:
    """Return a message in the graph's form: large arrays are copied once, and not traversed."""
    cls = type(message)
    return Payload(type_behind(cls), cls._rwt_to_graph(message))


def message_of(payload: Payload, cls: type[Message]) -> Any:
    """Return a message of the graph as an object of its class, which the program may change."""
    return cls._rwt_from_graph(payload.value())
