"""`rclpy.type_support`: types of the classes of messages, services and actions."""

from __future__ import annotations

from typing import Any, TypeVar

from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_rclpy.exceptions import NoTypeSupportImportedException
from rwt_rclpy.release import FROM_KILTED

T = TypeVar("T", MessageType, ServiceType, ActionType)


def check_for_type_support(msg_or_srv_type: Any) -> None:
    """Check that a class was generated from a definition.

    Raises:
        AttributeError: it was not, such as a class of ROS 1.
        NoTypeSupportImportedException: it has no type.
    """
    try:
        support = (msg_or_srv_type if FROM_KILTED else msg_or_srv_type.__class__)._TYPE_SUPPORT
    except AttributeError as error:
        raise AttributeError(
            f"{error} This might be a ROS 1 message type but it should be a ROS 2 message type. Make sure to"
            " source your ROS 2 workspace after your ROS 1 workspace."
        ) from None
    if support is None:
        msg_or_srv_type.__class__.__import_type_support__()
    if msg_or_srv_type.__class__._TYPE_SUPPORT is None:
        raise NoTypeSupportImportedException


def _type_of(cls: Any, kind: type[T], wrong: str) -> T:
    check_for_type_support(cls)
    found = cls.__class__._TYPE_SUPPORT
    if not isinstance(found, kind):
        raise RuntimeError(wrong)
    return found


def check_is_valid_msg_type(msg_type: Any) -> None:
    """Check that a class is a message. Raises RuntimeError, or as :func:`check_for_type_support`."""
    message_type(msg_type)


def check_is_valid_srv_type(srv_type: Any) -> None:
    """Check that a class is a service. Raises RuntimeError, or as :func:`check_for_type_support`."""
    service_type(srv_type)


def message_type(msg_type: Any) -> MessageType:
    """Return the type of a message class. Raises RuntimeError for other classes."""
    return _type_of(
        msg_type,
        MessageType,
        f"The message type provided is not valid ({msg_type!r}), this might be a service or action",
    )


def service_type(srv_type: Any) -> ServiceType:
    """Return the type of a service class. Raises RuntimeError for other classes."""
    return _type_of(
        srv_type,
        ServiceType,
        f"The service type provided is not valid ({srv_type!r}), this might be a message or action",
    )


def action_type(cls: Any) -> ActionType:
    """Return the type of an action class. Raises RuntimeError for other classes."""
    return _type_of(
        cls,
        ActionType,
        f"The action type provided is not valid ({cls!r}), this might be a message or service",
    )
