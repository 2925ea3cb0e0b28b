"""`rclpy._rclpy_pybind11`: exceptions and enums of rclpy's C extension that programs import."""

from __future__ import annotations

import sys
from typing import Any

from rwt_rclpy.actions.server import GoalEvent as GoalEvent
from rwt_rclpy.clocks.clock import ClockChange as ClockChange
from rwt_rclpy.clocks.time import ClockType as ClockType
from rwt_rclpy.endpoints.qos import QoSCompatibility as QoSCompatibility
from rwt_rclpy.exceptions import InvalidHandle as InvalidHandle
from rwt_rclpy.exceptions import NodeNameNonExistentError as NodeNameNonExistentError
from rwt_rclpy.exceptions import RCLError as RCLError
from rwt_rclpy.exceptions import RCLInvalidROSArgsError as RCLInvalidROSArgsError
from rwt_rclpy.exceptions import RMWError as RMWError
from rwt_rclpy.exceptions import TimerCancelledError as TimerCancelledError
from rwt_rclpy.exceptions import UnknownROSArgsError as UnknownROSArgsError
from rwt_rclpy.exceptions import UnsupportedEventTypeError as UnsupportedEventTypeError

#: Name of the extension in `rclpy.impl.implementation_singleton`.
rclpy_implementation = sys.modules[__name__]


def rclpy_get_rmw_implementation_identifier() -> str:
    """Return the identifier of the middleware, as `rclpy.get_rmw_implementation_identifier` does."""
    from rwt_rclpy.client_library import get_rmw_implementation_identifier

    return get_rmw_implementation_identifier()


def __getattr__(name: str) -> Any:
    raise AttributeError(
        f"rclpy's C extension, and so its {name!r}, is not available without ROS; use rclpy's Python modules"
    )
