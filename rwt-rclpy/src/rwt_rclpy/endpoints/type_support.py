"""`rclpy.type_support`: types of the classes of messages, services and actions."""

from __future__ import annotations

from typing import Any

from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_rclpy.exceptions import NoTypeSupportImportedException


def check_for_type_support(msg_or_srv_type: Any) -> None:
    """Check that a class was generated from a definition.

    Raises:
        AttributeError: it was not, such as a class of ROS 1.
        NoTypeSupportImportedException: it has no type.
    """
    try:
        support = msg_or_srv_type.__class__._TYPE_SUPPORT
    except AttributeError as error:
        raise AttributeError(
            f"{msg_or_srv_type!r} is no message, service or action of ROS 2: expected a class such as"
            " std_msgs.msg.String",
            *error.args,
        ) from None
    if support is None:
        msg_or_srv_type.__class__.__import_type_support__()
    if msg_or_srv_type.__class__._TYPE_SUPPORT is None:
        raise NoTypeSupportImportedException


def check_is_valid_msg_type(msg_type: Any) -> None:
    """Check that a class is a message. Raises RuntimeError, or as :func:`check_for_type_support`."""
    check_for_type_support(msg_type)
    if not isinstance(msg_type.__class__._TYPE_SUPPORT, MessageType):
        raise RuntimeError(f"The message type {msg_type!r} provided is not valid")


def check_is_valid_srv_type(srv_type: Any) -> None:
    """Check that a class is a service. Raises RuntimeError, or as :func:`check_for_type_support`."""
    check_for_type_support(srv_type)
    if not isinstance(srv_type.__class__._TYPE_SUPPORT, ServiceType):
        raise RuntimeError(f"The service type {srv_type!r} provided is not valid")


def message_type(msg_type: Any) -> MessageType:
    """Return the type of a message class."""
    check_is_valid_msg_type(msg_type)
    found: MessageType = msg_type.__class__._TYPE_SUPPORT
    return found


def service_type(srv_type: Any) -> ServiceType:
    """Return the type of a service class."""
    check_is_valid_srv_type(srv_type)
    found: ServiceType = srv_type.__class__._TYPE_SUPPORT
    return found


def action_type(cls: Any) -> ActionType:
    """Return the type of an action class. Raises RuntimeError for other classes."""
    check_for_type_support(cls)
    found = cls.__class__._TYPE_SUPPORT
    if not isinstance(found, ActionType):
        raise RuntimeError(f"{cls!r} is not an action")
    return found
