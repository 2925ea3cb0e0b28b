"""`rclpy.serialization`: messages as CDR."""

from __future__ import annotations

from typing import Any

from rwt_interfaces.payload import Payload
from rwt_rclpy.endpoints.type_support import message_type
from rwt_rclpy.messages.classes import Message


def serialize_message(message: Any) -> bytes:
    """Return a message in CDR, with its encapsulation header."""
    return payload_of(message).cdr()


def deserialize_message(serialized_message: bytes, message_type: Any) -> Any:
    """Return a message from CDR. Raises InvalidMessage if it does not fit the type."""
    payload = Payload.from_cdr(_type(message_type), bytes(serialized_message))
    return message_of(payload, message_type)


def _type(cls: Any) -> Any:
    return message_type(cls)


def payload_of(message: Message) -> Payload:
    """Return a message in the graph's form: large arrays are copied once, and not traversed."""
    cls = type(message)
    return Payload(message_type(cls), None, cls._rwt_to_graph(message))


def message_of(payload: Payload, cls: type[Message]) -> Any:
    """Return a message of the graph as an object of its class, which the program may change."""
    return cls._rwt_from_graph(payload.value())
