"""`rclpy.utilities`."""

from rwt_rclpy.client_library import get_available_rmw_implementations as get_available_rmw_implementations
from rwt_rclpy.client_library import get_rmw_implementation_identifier as get_rmw_implementation_identifier
from rwt_rclpy.client_library import ok as ok
from rwt_rclpy.client_library import remove_ros_args as remove_ros_args
from rwt_rclpy.client_library import timeout_sec_to_nsec as timeout_sec_to_nsec
from rwt_rclpy.execution.context import Context as Context
from rwt_rclpy.execution.context import get_default_context as get_default_context


def shutdown(*, context: Context | None = None) -> None:
    """Shut down the context. Raises RuntimeError if it is not initialised, or was shut down."""
    (get_default_context(shutting_down=True) if context is None else context).shutdown()


def try_shutdown(*, context: Context | None = None) -> None:
    """Shut down the context, unless that was done already."""
    (get_default_context(shutting_down=True) if context is None else context).try_shutdown()
