"""Selection of the type supports that fit the middleware."""

from __future__ import annotations

import logging
from functools import cache
from typing import Any, Protocol

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from rwt.extensions.ros2.type_supports.calls import Forms
from rwt.extensions.ros2.type_supports.defined import DefinedTypes
from rwt.extensions.ros2.type_supports.fast_cdr import Unsupported
from rwt.extensions.ros2.type_supports.installed import InstalledTypes
from rwt_interfaces.structs import MessageType, ServiceType

logger = logging.getLogger(__name__)


class TypeSupports(Protocol):
    """Type supports of a process."""

    def message(self, type: MessageType) -> Any:
        """Return the class of a message for raw publishers and subscriptions; raises Ros2Error."""

    def service(self, type: ServiceType) -> tuple[Any, Forms]:
        """Return the class of a service, and the forms of one endpoint of it; raises Ros2Error."""


@cache
def type_supports() -> TypeSupports:
    """Return the type supports of this process: made from definitions, if the middleware allows that.

    The check runs once, and takes about 10 ms.
    """
    try:
        return DefinedTypes()
    except Unsupported as error:
        logger.warning(
            "only types whose packages are installed here are exchanged with ROS 2, because of %s: %s; "
            "install the packages of the robot's types, or set RMW_IMPLEMENTATION=rmw_fastrtps_cpp",
            _rclpy.rclpy_get_rmw_implementation_identifier(),
            error,
        )
        return InstalledTypes()
